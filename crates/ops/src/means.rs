//! Sums over all rays that make a loss.

use burn::tensor::Tensor;

use crate::dispatch::dispatch;

/// Mean of (a − b)² over all numbers, `[1]`; differentiable in `a`.
pub fn mean_squared_difference<const D: usize>(a: Tensor<D>, b: Tensor<D>) -> Tensor<1> {
    let plain = |a: Tensor<D>, b: Tensor<D>| (a - b.detach()).square().mean();
    dispatch! {
        &a.device();
        host => plain(a, b),
        cube if a.dims() == b.dims() && !a.dims().contains(&0) => {
            let count = a.dims().iter().product::<usize>() as f32;
            crate::cube::sum([a, b], crate::cube::Summand::SquaredDifference, 0.0, 1.0 / count)
        },
        plain => plain(a, b),
    }
}

/// Sum of `values` `[R]` where `measure` `[R]` is above `threshold`, `[1]`; differentiable in `values`.
pub fn sum_above(values: Tensor<1>, measure: Tensor<1>, threshold: f32) -> Tensor<1> {
    let plain = |values, measure: Tensor<1>| mask_above(values, measure, threshold).sum();
    dispatch! {
        &values.device();
        host => plain(values, measure),
        cube if values.dims() != [0] => crate::cube::sum([values, measure], crate::cube::Summand::Above, threshold, 1.0),
        plain => plain(values, measure),
    }
}

/// `values` `[R]`, and 0 for those whose `measure` `[R]`, which has no gradient, is not above `threshold`.
pub fn mask_above(values: Tensor<1>, measure: Tensor<1>, threshold: f32) -> Tensor<1> {
    values * measure.detach().greater_elem(threshold).float()
}
