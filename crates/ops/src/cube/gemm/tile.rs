//! Sizes of the tiles that a product is computed in.

/// What a group of threads computes at a time: each thread has some rows and columns of it in registers, in fours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Tile {
    /// Threads along a column of the tile.
    pub(super) row_threads: usize,
    /// Threads along a row.
    pub(super) column_threads: usize,
    /// Rows of a thread, in fours.
    pub(super) row_fours: usize,
    /// Columns of a thread, in fours.
    pub(super) column_fours: usize,
}

/// Terms of each sum that are in shared memory at once.
pub(super) const STEP: usize = 8;

/// From the narrowest to the widest. Each takes less than the 16 KiB of shared memory that every device has.
const TILES: [Tile; 4] = [
    Tile { row_threads: 32, column_threads: 1, row_fours: 1, column_fours: 1 },
    Tile { row_threads: 16, column_threads: 4, row_fours: 2, column_fours: 1 },
    Tile { row_threads: 8, column_threads: 8, row_fours: 2, column_fours: 1 },
    Tile { row_threads: 8, column_threads: 8, row_fours: 2, column_fours: 2 },
];

impl Tile {
    /// The narrowest that a row of a matrix of so many columns fits in, else the widest.
    pub(super) fn of_columns(columns: usize) -> Self {
        TILES.into_iter().find(|tile| columns <= tile.columns()).unwrap_or(TILES[TILES.len() - 1])
    }

    pub(super) const fn threads(self) -> usize {
        self.row_threads * self.column_threads
    }

    pub(super) const fn rows(self) -> usize {
        4 * self.row_threads * self.row_fours
    }

    pub(super) const fn columns(self) -> usize {
        4 * self.column_threads * self.column_fours
    }

    /// Fours of a thread.
    pub(super) const fn fours(self) -> usize {
        4 * self.row_fours * self.column_fours
    }

    /// Tiles that cover a matrix of `[rows, columns]`.
    pub(super) const fn count(self, [rows, columns]: [usize; 2]) -> usize {
        rows.div_ceil(self.rows()) * columns.div_ceil(self.columns())
    }

    /// How the left factor's part of a step is brought to shared memory.
    pub(super) const fn left(self, along_terms: bool, is_split: bool) -> Staging {
        Staging { fours: self.rows() / 4, threads: self.threads(), along_terms, is_split }
    }

    /// The same of the right factor.
    pub(super) const fn right(self, along_terms: bool) -> Staging {
        Staging { fours: self.columns() / 4, threads: self.threads(), along_terms, is_split: false }
    }
}

/// How a factor's part of a step, `STEP` terms of as many outer indices as a tile has, is brought to shared memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct Staging {
    /// Outer indices, in fours.
    pub(super) fours: usize,
    /// Threads that share the work.
    pub(super) threads: usize,
    /// Whether the terms of a sum follow each other in memory, rather than outer indices.
    pub(super) along_terms: bool,
    /// Whether rows in memory are those of two matrices.
    pub(super) is_split: bool,
}

impl Staging {
    /// Fours of a thread, at most.
    pub(super) const fn shares(self) -> usize {
        (self.fours * STEP).div_ceil(self.threads)
    }

    /// Whether every thread has as many.
    pub(super) const fn is_even(self) -> bool {
        (self.fours * STEP).is_multiple_of(self.threads)
    }

    /// Fours from a term to the next in shared memory: one more than there are, as neighbouring threads would otherwise write to
    /// the same bank.
    pub(super) const fn pitch(self) -> usize {
        self.fours + 1
    }

    /// Fours in shared memory.
    pub(super) const fn shared(self) -> usize {
        STEP * self.pitch()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_fit_into_the_least_memory_that_devices_share() {
        const LEAST: usize = 16 << 10;
        for tile in TILES {
            let fours = tile.left(true, false).shared() + tile.right(true).shared();
            assert!(fours * 4 * size_of::<f32>() <= LEAST && tile.threads() <= 256);
        }
    }

    #[test]
    fn a_tile_is_no_wider_than_need_be() {
        let widths = [1, 4, 5, 16, 17, 32, 33, 1000].map(|columns| Tile::of_columns(columns).columns());
        assert_eq!(widths, [4, 4, 16, 16, 32, 32, 64, 64]);
        assert_eq!(Tile::of_columns(1000).count([65, 129]), 2 * 3);
    }
}
