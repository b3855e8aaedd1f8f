//! Entropy of the distributions along rays.

#[cfg(feature = "cube")]
mod gpu;
#[cfg(feature = "flex")]
mod host;
mod plain;

use burn::tensor::Tensor;
use serde::{Deserialize, Serialize};

pub use self::plain::plain;
use crate::dispatch::dispatch;
use crate::segments::Segments;

/// Distribution along a ray whose entropy is measured. `αᵢ = 1 − e^−τᵢ`, `wᵢ = Tᵢ αᵢ`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RayDistribution {
    /// `pᵢ = αᵢ/Σα` (InfoNeRF, Eq. 4): how opacity is spread over the samples. A ray whose opacities sum to nothing has
    /// entropy 0 and no gradient, and thin fog has the same entropy as thick fog.
    #[default]
    Alpha,
    /// `pᵢ = αᵢ/(Σα + 1)` and `1/(Σα + 1)`: the background is one more sample that is opaque. The released code computes this
    /// in effect if a ray's last interval is 1e10 long and its density is not 0.
    AlphaBackground,
    /// `w₁ … w_N`, and `1 − Σw` for the background: where the ray ends. Fog of any thickness has positive entropy; a ray
    /// that hits nothing, or that ends at one sample, has entropy 0.
    Termination,
}

/// The result of [`ray_entropy`], one value per ray.
#[derive(Clone, Debug)]
pub struct RayEntropy {
    /// `H = −Σ p log₂(p + ε)` in bits (InfoNeRF, Eq. 5), `[R]`.
    pub bits: Tensor<1>,
    /// Cumulative ray density `Q = Σα` (InfoNeRF, Eq. 7), `[R]`.
    pub alpha_sum: Tensor<1>,
}

/// Computes the entropy of each ray's distribution, differentiable in `tau`.
///
/// - `tau`: optical depths τ = σδ ≥ 0, packed `[M]`.
/// - `epsilon` ≥ 0 is added inside the logarithm (the released code has 1e-10).
///
/// The gradients, with `gᵢ = −ln(pᵢ + ε) − pᵢ/(pᵢ + ε)` and the background, if any, as sample N + 1:
/// `∂H/∂τᵢ = e^−τᵢ/S · (gᵢ − Σ pⱼ gⱼ)` for the two distributions of α with sum S, and
/// `∂H/∂τᵢ = Tᵢ₊₁ gᵢ − Σ_{j>i} wⱼ gⱼ` for [`RayDistribution::Termination`], both over ln 2.
///
/// Values and gradients are finite for every τ in [0, ∞].
///
/// # Panics
/// If the shape does not match `segments`.
///
/// # Examples
/// Two equally opaque samples, and a single one:
/// ```
/// # #[cfg(feature = "flex")] {
/// use burn::tensor::{Device, Tensor};
/// use infonerf_ops::{RayDistribution, Segments, ray_entropy};
///
/// let tau = Tensor::<1>::from_floats([3.0, 3.0, 5.0], &Device::flex());
/// let rays = Segments::from_counts([2, 1]);
/// let entropy = ray_entropy(tau, &rays, RayDistribution::Alpha, 0.0);
/// assert_eq!(entropy.bits.into_data().to_vec::<f32>().unwrap(), [1.0, 0.0]);
/// # }
/// ```
pub fn ray_entropy(tau: Tensor<1>, segments: &Segments, distribution: RayDistribution, epsilon: f32) -> RayEntropy {
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one value per packed sample");
    dispatch! {
        &tau.device();
        host => {
            let kernel = host::EntropyKernel { distribution, epsilon };
            let packed = crate::ray_kernel::apply(kernel, segments, [segments.rays(), host::COLUMNS], tau);
            let column = |i: usize| packed.clone().narrow(1, i, 1).squeeze_dim::<1>(1);
            RayEntropy { bits: column(0), alpha_sum: column(1) }
        },
        cube if segments.samples() > 0 && distribution == RayDistribution::Alpha => {
            let [bits, alpha_sum] = gpu::entropy(tau, segments, epsilon);
            RayEntropy { bits, alpha_sum }
        },
        plain => plain(tau, segments, distribution, epsilon),
    }
}
