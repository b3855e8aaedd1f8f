//! Matrix products within slices, one thread each.

use gemm::{Parallelism, gemm};

/// Where a matrix stands in a slice: element (r, c) at `start` + r·`row` + c·`column`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Matrix {
    pub(crate) start: usize,
    pub(crate) row: usize,
    pub(crate) column: usize,
}

impl Matrix {
    pub(crate) fn transposed(self) -> Self {
        Self { row: self.column, column: self.row, ..self }
    }

    /// Whether `rows` × `columns` of it lie within `length` numbers.
    fn fits(self, rows: usize, columns: usize, length: usize) -> bool {
        self.start + (rows - 1) * self.row + (columns - 1) * self.column < length
    }

    /// Whether no two of its elements are the same number.
    fn is_injective(self, rows: usize, columns: usize) -> bool {
        (self.column > 0 && self.row >= columns * self.column) || (self.row > 0 && self.column >= rows * self.row)
    }
}

/// What a product is written onto.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Onto {
    /// Whatever was there is gone.
    Nothing,
    /// It is added to what was there.
    Sum,
}

/// y = a b, or y += a b, with y `[m, n]`, a `[m, k]` and b `[k, n]` for sizes `[m, n, k]`.
///
/// # Panics
/// If a matrix reaches beyond its slice, or elements of y overlap.
pub(crate) fn product(
    [m, n, k]: [usize; 3],
    onto: Onto,
    (y, y_at): (&mut [f32], Matrix),
    (a, a_at): (&[f32], Matrix),
    (b, b_at): (&[f32], Matrix),
) {
    if m == 0 || n == 0 || k == 0 {
        assert!(k > 0 || onto == Onto::Sum, "an empty sum is not written");
        return;
    }
    assert!(y_at.fits(m, n, y.len()) && a_at.fits(m, k, a.len()) && b_at.fits(k, n, b.len()), "matrices within slices");
    assert!(y_at.is_injective(m, n), "one place for each element");
    let stride = |at: Matrix| (at.column as isize, at.row as isize);
    let ((y_column, y_row), (a_column, a_row), (b_column, b_row)) = (stride(y_at), stride(a_at), stride(b_at));
    // SAFETY: the first and the last element of each matrix are within its slice by the assertion, so all are; y is
    // borrowed mutably, so that it overlaps neither a nor b.
    #[allow(unsafe_code, reason = "the library takes pointers")]
    unsafe {
        gemm(
            m,
            n,
            k,
            y.as_mut_ptr().add(y_at.start),
            y_column,
            y_row,
            onto == Onto::Sum,
            a.as_ptr().add(a_at.start),
            a_column,
            a_row,
            b.as_ptr().add(b_at.start),
            b_column,
            b_row,
            1.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_within_larger_matrices() {
        // a is the upper left 2×3 of a 4×4 matrix, b the transpose of a 2×3 one, y the right half of a 2×4 one.
        let a: Vec<f32> = (0..16).map(|x| x as f32).collect();
        let b = [1.0, 0.0, -1.0, 2.0, 1.0, 0.5];
        let mut y = [10.0; 8];
        let at = |start, row| Matrix { start, row, column: 1 };
        product([2, 2, 3], Onto::Sum, (&mut y, at(2, 4)), (&a, at(0, 4)), (&b, at(0, 3).transposed()));
        assert_eq!(y, [10.0, 10.0, 8.0, 12.0, 10.0, 10.0, 8.0, 26.0]);
        product([2, 2, 3], Onto::Nothing, (&mut y, at(2, 4)), (&a, at(0, 4)), (&b, at(0, 3).transposed()));
        assert_eq!(y, [10.0, 10.0, -2.0, 2.0, 10.0, 10.0, -2.0, 16.0]);
    }

    #[test]
    #[should_panic(expected = "matrices within slices")]
    fn what_reaches_out_is_refused() {
        let at = Matrix { start: 0, row: 2, column: 1 };
        product([2, 2, 2], Onto::Sum, (&mut [0.0; 4], at), (&[0.0; 3], at), (&[0.0; 4], at));
    }
}
