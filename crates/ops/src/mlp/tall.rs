//! Products of tall matrices, cut into parts so that all of a large GPU works on them.

use burn::backend::tensor::FloatTensor;
use burn::backend::{Backend, TensorMetadata};
use burn::tensor::Shape;

/// Minimal number of rows of a part.
const MIN_ROWS: usize = 256;
/// Maximal number of parts.
const MAX_PARTS: usize = 128;

/// Computes xᵀ y, `[k, n]`, of `x`, `[M, k]`, and `y`, `[M, n]`, with `product` for products of matrices and batches of matrices.
///
/// The k × n results are few tiles, each of which sums over all M rows: on an H100 a handful of 132 processors would work. The
/// products of parts of the rows are one batch, whose results are added.
pub(super) fn transposed_product<B: Backend>(
    x: FloatTensor<B>,
    y: FloatTensor<B>,
    product: impl Fn(FloatTensor<B>, FloatTensor<B>) -> FloatTensor<B>,
) -> FloatTensor<B> {
    let ([rows, k], [_, n]) = (x.shape().dims(), y.shape().dims());
    let parts = parts(rows);
    if parts < 2 {
        return product(B::float_transpose(x), y);
    }
    let (each, rest) = (rows / parts, rows % parts);
    let range = |tensor: &FloatTensor<B>, range: std::ops::Range<usize>| {
        let columns = tensor.shape().dims::<2>()[1];
        B::float_slice(tensor.clone(), &[range.into(), (0..columns).into()])
    };
    let cut = |tensor: &FloatTensor<B>, columns: usize| {
        let whole = if rest == 0 { tensor.clone() } else { range(tensor, 0..each * parts) };
        B::float_reshape(whole, Shape::new([parts, each, columns]))
    };
    let products = product(B::float_transpose(cut(&x, k)), cut(&y, n));
    let sum = B::float_reshape(B::float_sum_dim(products, 0), Shape::new([k, n]));
    if rest == 0 {
        return sum;
    }
    let last = each * parts..rows;
    B::float_add(sum, product(B::float_transpose(range(&x, last.clone())), range(&y, last)))
}

/// Returns into how many parts `rows` are cut: a number that divides them, if one close to the greatest does.
fn parts(rows: usize) -> usize {
    let most = (rows / MIN_ROWS).min(MAX_PARTS);
    (most / 2 + 1..=most).rev().find(|parts| rows.is_multiple_of(*parts)).unwrap_or(most)
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
        // One part, parts without a rest, and with one.
        for rows in [7, 4 * MIN_ROWS, 4 * MIN_ROWS + 7] {
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
