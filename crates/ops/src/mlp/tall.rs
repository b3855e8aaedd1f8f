//! Products of tall matrices, cut into parts so that all of a large GPU works on them.

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, TensorMetadata};
use burn::tensor::Shape;

/// Max number of parts.
const MAX_PARTS: usize = 128;
/// Min number of rows of a part.
const MIN_ROWS: usize = 256;
/// Max number of rows that a thread sums.
const SUMMED: usize = 64;

/// Computes xᵀ y, `[k, n]`, of `x`, `[M, k]`, and `y`, `[M, n]`, with `product` for products of matrices and batches of matrices.
///
/// The k × n results are few tiles, each of which sums over all M rows: on an H100 a handful of 132 processors would work. The
/// products of parts of the rows are one batch, whose results are added. The number of rows of a part is a power of two, and
/// zeros fill the last part: kernels are compiled for few sizes although M changes from step to step.
pub(super) fn transposed_product<B: Backend>(
    x: FloatTensor<B>,
    y: FloatTensor<B>,
    product: impl Fn(FloatTensor<B>, FloatTensor<B>) -> FloatTensor<B>,
) -> FloatTensor<B> {
    let ([rows, k], [_, n]) = (x.shape().dims(), y.shape().dims());
    let each = rows.div_ceil(MAX_PARTS).next_power_of_two().max(MIN_ROWS);
    let parts = rows.div_ceil(each);
    let cut = |tensor: FloatTensor<B>, columns: usize| {
        let missing = parts * each - rows;
        let (device, dtype) = (tensor.device(), tensor.dtype().into());
        let zeros = || B::float_zeros(Shape::new([missing, columns]), &device, dtype);
        let whole = if missing == 0 { tensor } else { B::float_cat(vec![tensor, zeros()], 0) };
        B::float_reshape(whole, Shape::new([parts, each, columns]))
    };
    let products = product(B::float_transpose(cut(x, k)), cut(y, n));
    B::float_reshape(sum_rows::<B>(B::float_reshape(products, Shape::new([parts, k * n]))), Shape::new([k, n]))
}

/// Computes the sum of the rows of `[rows, columns]`, `[1, columns]`, in steps of at most [`SUMMED`] rows where that divides them.
pub(super) fn sum_rows<B: Backend>(x: FloatTensor<B>) -> FloatTensor<B> {
    let [rows, columns] = x.shape().dims();
    if rows <= SUMMED || !rows.is_multiple_of(SUMMED) {
        return B::float_sum_dim(x, 0);
    }
    let rest = rows / SUMMED;
    let sums = B::float_sum_dim(B::float_reshape(x, Shape::new([SUMMED, rest * columns])), 0);
    sum_rows::<B>(B::float_reshape(sums, Shape::new([rest, columns])))
}

#[cfg(all(test, feature = "flex"))]
mod tests {
    use burn::backend::Flex;
    use burn::backend::ops::FloatTensorOps;
    use burn::tensor::TensorData;

    use super::*;

    #[test]
    fn products_of_parts_add_up() {
        let (k, n) = (5, 3);
        // Parts without a rest and with one; sums in one step and in two.
        for rows in [7, 4 * MIN_ROWS, 4 * MIN_ROWS + 7, MAX_PARTS * MIN_ROWS] {
            let [x, y] = [k, n]
                .map(|columns| (0..rows * columns).map(|i| (i * 37 % 101) as f32 / 101.0 - 0.5).collect::<Vec<f32>>());
            let tensor = |values: &[f32], columns: usize| {
                Flex::float_from_data(TensorData::new(values.to_vec(), [rows, columns]), &Default::default())
            };
            let got = transposed_product::<Flex>(tensor(&x, k), tensor(&y, n), Flex::float_matmul);
            let got =
                burn::tensor::try_read_sync(Flex::float_into_data(got)).unwrap().unwrap().try_to_vec::<f32>().unwrap();
            for (index, got) in got.into_iter().enumerate() {
                let (row, column) = (index / n, index % n);
                let want: f64 = (0..rows).map(|m| f64::from(x[m * k + row]) * f64::from(y[m * n + column])).sum();
                assert!((f64::from(got) - want).abs() < 1e-4, "{rows} rows, {row}, {column}: {got} for {want}");
            }
        }
    }
}
