//! Means and sums over rays, from which losses are built.

use burn::tensor::Tensor;

/// Returns the mean of (a − b)² over all elements, `[1]`; differentiable in `a`.
pub fn mean_squared_difference<const D: usize>(a: Tensor<D>, b: Tensor<D>) -> Tensor<1> {
    (a - b.detach()).square().mean()
}

/// Sets `values` `[R]` to 0 where `measure` `[R]` does not exceed `threshold`; differentiable in `values` alone.
pub fn mask_above(values: Tensor<1>, measure: Tensor<1>, threshold: f32) -> Tensor<1> {
    values * measure.detach().greater_elem(threshold).float()
}

/// Computes Σ wᵢ xᵢ of `(xᵢ, wᵢ)`, each xᵢ being `[1]`; `None` without terms. Differentiable.
pub fn weighted_sum(terms: Vec<(Tensor<1>, f32)>) -> Option<Tensor<1>> {
    let scaled = |(x, weight): (Tensor<1>, f32)| if weight == 1.0 { x } else { x * weight };
    terms.into_iter().map(scaled).reduce(|sum, x| sum + x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traffic::{to_host, upload_rows};
    use burn::tensor::Device;

    #[test]
    fn values_and_gradients_by_hand() {
        for device in [Device::flex(), Device::ndarray()] {
            let device = device.autodiff();
            let a = upload_rows(&[1.0, 2.0, 4.0, 8.0], 2, &device).require_grad();
            let b = upload_rows(&[0.0, 2.0, 6.0, 8.5], 2, &device).require_grad();
            let mean = mean_squared_difference(a.clone(), b.clone());
            let grads = mean.clone().backward();
            assert_eq!(to_host(mean), [(1.0 + 4.0 + 0.25) / 4.0]);
            assert_eq!(to_host(a.grad(&grads).unwrap()), [0.5, 0.0, -1.0, -0.25]);
            assert!(b.grad(&grads).is_none());
            let flat = a.clone().flatten(0, 1);
            let sum = mask_above(flat, Tensor::from_floats([0.0, 0.5, 0.6, 9.0], &device), 0.5).sum();
            let grads = sum.clone().backward();
            assert_eq!(to_host(sum), [12.0]);
            assert_eq!(to_host(a.grad(&grads).unwrap()), [0.0, 0.0, 1.0, 1.0]);
            let [x, y] = [3.0, 5.0].map(|x| Tensor::<1>::from_floats([x], &device).require_grad());
            let sum = weighted_sum(vec![(x.clone(), 1.0), (y.clone(), -2.0)]).unwrap();
            let grads = sum.clone().backward();
            assert_eq!(to_host(sum), [-7.0]);
            assert_eq!([x, y].map(|x| to_host(x.grad(&grads).unwrap())), [[1.0], [-2.0]]);
        }
    }
}
