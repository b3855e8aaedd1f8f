//! Products of matrices within slices. A product runs in one thread, in tiles of the result that stay in registers.

use super::simd::{self, Job};

/// Layout of a matrix in a slice: element (r, c) at `start` + r·`row` + c·`column`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Matrix {
    /// Index of the first element.
    pub(crate) start: usize,
    /// Distance between rows.
    pub(crate) row: usize,
    /// Distance between columns.
    pub(crate) column: usize,
}

impl Matrix {
    /// Creates the layout of contiguous rows, `row` apart.
    pub(crate) fn rows(start: usize, row: usize) -> Self {
        Self { start, row, column: 1 }
    }

    /// Returns the layout of the transposed matrix.
    #[must_use]
    pub(crate) fn transposed(self) -> Self {
        Self { row: self.column, column: self.row, ..self }
    }

    /// Returns whether a matrix of `rows` × `columns` with this layout lies within `length` elements.
    fn fits(self, rows: usize, columns: usize, length: usize) -> bool {
        self.start + (rows - 1) * self.row + (columns - 1) * self.column < length
    }
}

/// Initial value of a product's sums.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum InitialSum<'a> {
    /// 0
    Zero,
    /// Previous value of the element.
    Previous,
    /// Bias of the column.
    Bias(&'a [f32]),
}

/// Number of columns of the narrowest tile.
pub(crate) const COLUMNS: usize = 16;

/// Computes y = a b, y += a b or y = bias + a b, with y `[m, n]`, a `[m, k]` and b `[k, n]` for sizes `[m, n, k]`.
///
/// Each element is one sum in the order of k. Fastest where n is a multiple of 16.
///
/// # Panics
/// If rows of y or b are not contiguous, rows of y overlap, or a matrix reaches beyond its slice.
pub(crate) fn product(
    [m, n, k]: [usize; 3],
    initial: InitialSum<'_>,
    (y, y_at): (&mut [f32], Matrix),
    (a, a_at): (&[f32], Matrix),
    (b, b_at): (&[f32], Matrix),
) {
    if m == 0 || n == 0 || k == 0 {
        assert!(k > 0 || initial == InitialSum::Previous, "an empty sum is not written");
        return;
    }
    assert!(y_at.column == 1 && b_at.column == 1 && y_at.row >= n, "contiguous rows");
    assert!(y_at.fits(m, n, y.len()) && a_at.fits(m, k, a.len()) && b_at.fits(k, n, b.len()), "matrices within slices");
    let whole = n - n % COLUMNS;
    simd::run(Product { sizes: [m, whole, k], initial, y: (y, y_at), a: (a, a_at), b: (b, b_at) });
    if whole == n {
        return;
    }
    // The last n mod 16 columns, padded with zeros to 16.
    let filled = |from: &[f32], at: Matrix, rows: usize| -> Vec<f32> {
        let row = |r: usize| &from[at.start + r * at.row + whole..at.start + r * at.row + n];
        let padding = std::iter::repeat_n(0.0, COLUMNS - (n - whole));
        (0..rows).flat_map(|r| row(r).iter().copied().chain(padding.clone())).collect()
    };
    let rows = Matrix::rows(0, COLUMNS);
    let (mut last, b) = (filled(y, y_at, m), filled(b, b_at, k));
    let bias = if let InitialSum::Bias(bias) = initial { filled(bias, rows, 1) } else { Vec::new() };
    let initial = if let InitialSum::Bias(_) = initial { InitialSum::Bias(&bias) } else { initial };
    simd::run(Product { sizes: [m, COLUMNS, k], initial, y: (&mut last, rows), a: (a, a_at), b: (&b, rows) });
    for (r, last) in last.chunks_exact(COLUMNS).enumerate() {
        y[y_at.start + r * y_at.row..][whole..n].copy_from_slice(&last[..n - whole]);
    }
}

/// Min number of rows of the result for which copying b's columns to contiguous memory is faster.
const PACKED: usize = 96;

/// Product whose matrices are known to lie within their slices.
struct Product<'a> {
    sizes: [usize; 3],
    initial: InitialSum<'a>,
    y: (&'a mut [f32], Matrix),
    a: (&'a [f32], Matrix),
    b: (&'a [f32], Matrix),
}

impl Job for Product<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(mut self) {
        let mut column = 0;
        let mut panel = Vec::new();
        while column < self.sizes[1] {
            // Tile sizes whose sums fit into registers next to a row of b and an element of a.
            column += match (WIDE, FMA) {
                (true, _) if column + 32 <= self.sizes[1] => self.strip::<FMA, 12, 32>(column, &mut panel),
                (true, _) => self.strip::<FMA, 12, 16>(column, &mut panel),
                (false, true) => self.strip::<FMA, 6, 16>(column, &mut panel),
                (false, false) => self.strip::<FMA, 3, 16>(column, &mut panel),
            };
        }
    }
}

impl Product<'_> {
    /// Computes columns `column..column + N` of y in all rows, and returns `N`.
    #[inline(always)]
    fn strip<const FMA: bool, const R: usize, const N: usize>(&mut self, column: usize, panel: &mut Vec<f32>) -> usize {
        let rows = self.sizes[0];
        let (b, b_at) = self.b;
        let mut from = (b, Matrix { start: b_at.start + column, ..b_at });
        if rows >= PACKED && b_at.row >= 4 * N && self.sizes[2] <= 1024 {
            panel.clear();
            for i in 0..self.sizes[2] {
                let start = from.1.start + i * b_at.row;
                panel.extend_from_slice(&b[start..start + N]);
            }
            from = (panel, Matrix::rows(0, N));
        }
        let mut row = 0;
        while row + R <= rows {
            self.tile::<FMA, R, N>(row, column, from);
            row += R;
        }
        while row + 4 <= rows && R > 4 {
            self.tile::<FMA, 4, N>(row, column, from);
            row += 4;
        }
        while row < rows {
            self.tile::<FMA, 1, N>(row, column, from);
            row += 1;
        }
        N
    }

    /// Computes `R` rows of a strip. Rows are copied whole, and b by value, so that the compiler keeps all sums in registers.
    #[allow(clippy::needless_range_loop, reason = "iterators are not compiled for the chosen instruction set")]
    #[inline(always)]
    fn tile<const FMA: bool, const R: usize, const N: usize>(
        &mut self,
        row: usize,
        column: usize,
        (b, b_at): (&[f32], Matrix),
    ) {
        let ((y, y_at), (a, a_at)) = (&mut self.y, self.a);
        let (a_start, b_start) = (a_at.start + row * a_at.row, b_at.start);
        let y = &mut y[y_at.start + row * y_at.row + column..];
        let mut sums = [[0f32; N]; R];
        match self.initial {
            InitialSum::Zero => {}
            InitialSum::Previous => {
                for r in 0..R {
                    sums[r].copy_from_slice(&y[r * y_at.row..r * y_at.row + N]);
                }
            }
            InitialSum::Bias(bias) => {
                for r in 0..R {
                    sums[r].copy_from_slice(&bias[column..column + N]);
                }
            }
        }
        for i in 0..self.sizes[2] {
            // SAFETY: the last rows and columns of both matrices were asserted to lie within their slices before a
            // `Product` was made. A panel holds `N` elements of each row of b.
            #[allow(unsafe_code, reason = "checks would take longer than the sums")]
            let b: [f32; N] = unsafe { *b.as_ptr().add(b_start + i * b_at.row).cast() };
            for r in 0..R {
                #[allow(unsafe_code, reason = "as above")]
                let a = unsafe { *a.get_unchecked(a_start + r * a_at.row + i * a_at.column) };
                for c in 0..N {
                    sums[r][c] = if FMA { a.mul_add(b[c], sums[r][c]) } else { sums[r][c] + a * b[c] };
                }
            }
        }
        for r in 0..R {
            y[r * y_at.row..r * y_at.row + N].copy_from_slice(&sums[r]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_of_every_size_and_order() {
        let number = |i: usize| ((i * 37 + 11) % 19) as f32 - 9.0;
        for [m, n, k] in [[1, 16, 1], [3, 32, 5], [13, 48, 69], [40, 69, 33], [101, 149, 20], [5, 3, 2]] {
            let numbers = |count: usize| (0..count).map(number).collect::<Vec<f32>>();
            let (a, b, bias) = (numbers((m + 2) * (k + 3)), numbers(2 + k * (n + 5)), numbers(n));
            let b_at = Matrix::rows(2, n + 5);
            for a_at in [Matrix::rows(1, k + 3), Matrix::rows(1, m + 2).transposed()] {
                for initial in [InitialSum::Zero, InitialSum::Previous, InitialSum::Bias(&bias)] {
                    let mut y = vec![1.0; 3 + m * (n + 1)];
                    let at = |matrix: Matrix, r: usize, c: usize| matrix.start + r * matrix.row + c * matrix.column;
                    let y_at = Matrix::rows(3, n + 1);
                    product([m, n, k], initial, (&mut y, y_at), (&a, a_at), (&b, b_at));
                    for (r, c) in (0..m).flat_map(|r| (0..n).map(move |c| (r, c))) {
                        let before = match initial {
                            InitialSum::Zero => 0.0,
                            InitialSum::Previous => 1.0,
                            InitialSum::Bias(bias) => bias[c],
                        };
                        let sum: f32 = (0..k).map(|i| a[at(a_at, r, i)] * b[at(b_at, i, c)]).sum();
                        assert_eq!(y[at(y_at, r, c)], before + sum, "{m} {n} {k} {initial:?} at {r}, {c}");
                    }
                    assert!((0..m).all(|r| y[at(y_at, r, 0) - 1] == 1.0), "nothing next to it is written");
                }
            }
        }
    }

    #[test]
    fn products_without_rows_columns_or_terms_change_nothing() {
        let (mut y, at) = ([1.0; 16], Matrix::rows(0, 16));
        for (sizes, initial) in
            [([0, 16, 1], InitialSum::Zero), ([1, 0, 1], InitialSum::Zero), ([1, 16, 0], InitialSum::Previous)]
        {
            product(sizes, initial, (&mut y, at), (&[], at), (&[], at));
        }
        assert_eq!(y, [1.0; 16]);
    }

    #[test]
    fn every_instruction_set_gives_the_same_product() {
        let [m, n, k] = [29, 48, 7];
        let a: Vec<f32> = (0..m * k).map(|i| (i % 23) as f32 - 11.0).collect();
        let b: Vec<f32> = (0..k * n).map(|i| (i % 17) as f32 - 8.0).collect();
        let sum = |i: usize| (0..k).map(|j| a[i / n * k + j] * b[j * n + i % n]).sum::<f32>();
        for instructions in simd::Instructions::ALL.into_iter().filter(|instructions| instructions.present()) {
            let mut y = vec![f32::NAN; m * n];
            let [y_at, a_at, b_at] = [n, k, n].map(|row| Matrix::rows(0, row));
            let (initial, left, right) = (InitialSum::Zero, (&a[..], a_at), (&b[..], b_at));
            instructions.run(Product { sizes: [m, n, k], initial, y: (&mut y, y_at), a: left, b: right });
            assert!((0..m * n).all(|i| y[i] == sum(i)), "{instructions:?}");
        }
    }

    #[test]
    #[should_panic(expected = "matrices within slices")]
    fn matrices_beyond_their_slices_are_refused() {
        let at = Matrix::rows(0, 16);
        product([2, 16, 2], InitialSum::Zero, (&mut [0.0; 32], at), (&[0.0; 3], Matrix::rows(0, 2)), (&[0.0; 32], at));
    }
}
