/// Number of neighbours of a site in each convolution, itself among them.
pub(super) const NEIGHBOURS: usize = 27;

/// The occupied cells of a grid, in the order of their numbers; x runs fastest, z slowest.
#[derive(Clone, Debug)]
pub(super) struct Sites {
    /// Cells along x, y and z.
    pub(super) size: [usize; 3],
    cells: Vec<[usize; 3]>,
    /// Site at each cell of the grid, an index in `cells`; the length of `cells` for an empty cell.
    pub(super) rows: Vec<i32>,
}

impl Sites {
    /// Collects the sites `cells` of a grid; a cell counts once.
    pub(super) fn new(size: [usize; 3], cells: impl IntoIterator<Item = [usize; 3]>) -> Self {
        let mut occupied = vec![false; size.iter().product()];
        for cell in cells {
            occupied[number(size, cell)] = true;
        }
        let cell = |n: usize| [n % size[0], n / size[0] % size[1], n / size[0] / size[1]];
        let cells: Vec<[usize; 3]> = (0..occupied.len()).filter(|&n| occupied[n]).map(cell).collect();
        let mut rows = vec![cells.len() as i32; occupied.len()];
        cells.iter().enumerate().for_each(|(row, &cell)| rows[number(size, cell)] = row as i32);
        Self { size, cells, rows }
    }

    pub(super) fn len(&self) -> usize {
        self.cells.len()
    }

    /// Returns the place of an occupied `cell` among the sites.
    pub(super) fn row(&self, cell: [usize; 3]) -> i32 {
        self.rows[number(self.size, cell)]
    }

    /// Returns the sites of a convolution of stride 2 and padding 1: the cells whose kernel reaches a site.
    pub(super) fn halved(&self) -> Self {
        let size = self.size.map(|n| n.div_ceil(2));
        // Cell o reaches 2o − 1, 2o and 2o + 1.
        let along = |axis: usize, i: usize| (i / 2..=i.div_ceil(2)).filter(move |&o| o < size[axis]);
        let reaching = self.cells.iter().flat_map(move |&[x, y, z]| {
            along(0, x).flat_map(move |x| along(1, y).flat_map(move |y| along(2, z).map(move |z| [x, y, z])))
        });
        Self::new(size, reaching)
    }

    /// Returns the sites in the 3³ cells about `stride` times each site of `out`, x fastest; [`Self::len`] for an empty cell.
    pub(super) fn neighbours(&self, out: &Self, stride: usize) -> Vec<i32> {
        let empty = self.len() as i32;
        let at = |cell: [usize; 3], k: usize| {
            let offset = [k % 3, k / 3 % 3, k / 9];
            let place = [0, 1, 2].map(|axis| (stride * cell[axis] + offset[axis]).wrapping_sub(1));
            let inside = (0..3).all(|axis| place[axis] < self.size[axis]);
            if inside { self.row(place) } else { empty }
        };
        out.cells.iter().flat_map(|&cell| (0..NEIGHBOURS).map(move |k| at(cell, k))).collect()
    }
}

fn number(size: [usize; 3], [x, y, z]: [usize; 3]) -> usize {
    (z * size[1] + y) * size[0] + x
}
