//! The additive march of Neural Volumes, as optical depths.

#[cfg(feature = "flex")]
mod host;
mod plain;

use burn::tensor::Tensor;

pub use self::plain::plain;
use crate::dispatch::dispatch;
use crate::segments::Segments;

/// Computes optical depths τ′ whose [compositing](crate::composite()) is the additive march of Neural Volumes (Lombardi et al. 2019,
/// Eq. 7), `[M]`, differentiable in `tau`.
///
/// In that march a sample adds `wᵢ = min(Aᵢ + τᵢ, 1) − Aᵢ` to the opacity `Aᵢ = Σ_{j<i} wⱼ` in front of it: the weights are the
/// optical depths themselves until their sum reaches 1. Compositing has `wᵢ = (1 − Aᵢ)(1 − e^−τ′ᵢ)`, so the same weights
/// follow from
///
/// `τ′ᵢ = −ln(1 − τᵢ/(1 − Aᵢ))`.
///
/// τ′ is infinite for the sample that fills the ray, and 0 for the samples behind it; the gradient is 0 for all of these, as in
/// PyTorch's `clamp`. Operations on optical depths, such as entropy and importance sampling, thus also serve the additive march.
///
/// - `tau`: optical depths τ = σδ ≥ 0, packed `[M]`.
///
/// # Panics
/// If `tau` does not match `segments`.
///
/// # Examples
/// Three samples of 0.4: the third adds 0.2, which fills the ray.
/// ```
/// # #[cfg(feature = "flex")] {
/// use burn::tensor::{Device, Tensor};
/// use infonerf_ops::{Segments, additive_depth, composite::weights, to_host};
///
/// let rays = Segments::from_counts([3]);
/// let depths = additive_depth(Tensor::from_floats([0.4, 0.4, 0.4], &Device::flex()), &rays);
/// let w = weights(&to_host(depths), &rays);
/// assert!(w.iter().zip([0.4, 0.4, 0.2]).all(|(w, expected)| (w - expected).abs() < 1e-6));
/// # }
/// ```
pub fn additive_depth(tau: Tensor<1>, segments: &Segments) -> Tensor<1> {
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one value per packed sample");
    dispatch! {
        &tau.device();
        host => {
            let kernel = host::AdditiveKernel { segments: segments.clone() };
            crate::host::apply(kernel, tau.dims(), [tau.into_dispatch()])
        },
        plain => plain(tau, segments),
    }
}
