//! Entropy of rays.

#[cfg(feature = "cube")]
mod gpu;
#[cfg(feature = "flex")]
mod host;
mod plain;

use burn::tensor::Tensor;

pub use self::plain::plain;
use crate::dispatch::dispatch;
use crate::segments::Segments;

/// Min Σα of a ray that hits something. Below it, entropy and divergence are 0 with zero gradient.
///
/// Gradients of entropy and divergence scale with 1/(ε Σα). With ε ≥ 1e-12 and upstream gradients up to 1e6, this bound
/// keeps them within `f32`.
pub const MIN_ALPHA_SUM: f32 = 1e-20;

/// The result of [`ray_entropy`], one value per ray.
#[derive(Clone, Debug)]
pub struct RayEntropy {
    /// H = −Σ p log₂(p + ε) in bits (InfoNeRF, Eq. 5), `[R]`.
    pub bits: Tensor<1>,
    /// Cumulative ray density Q = Σα (InfoNeRF, Eq. 7), `[R]`.
    pub alpha_sum: Tensor<1>,
}

impl RayEntropy {
    /// Splits the result of a kernel, `[R, 2]`.
    #[cfg(any(feature = "flex", feature = "cube"))]
    fn from_columns(columns: Tensor<2>) -> Self {
        let column = |index: usize| columns.clone().narrow(1, index, 1).squeeze_dim(1);
        Self { bits: column(0), alpha_sum: column(1) }
    }
}

/// Computes the entropy H = −Σ pᵢ log₂(pᵢ + ε) of each ray in bits, with pᵢ = αᵢ/Σα (InfoNeRF, Eq. 4–5), and Σα (Eq. 7), `[R]` each.
///
/// - `tau`: optical depths τ = σδ ≥ 0, packed `[M]`.
/// - `epsilon` ≥ 0 is added inside the logarithm (the released code has 1e-10).
///
/// Differentiable in `tau`: ∂H/∂τᵢ = e^−τᵢ/Σα · (gᵢ − Σ pⱼ gⱼ)/ln 2 with gᵢ = −ln(pᵢ + ε) − pᵢ/(pᵢ + ε). Values and gradients are
/// finite for every τ in [0, ∞]. A ray with Σα below [`MIN_ALPHA_SUM`] has entropy 0 and no gradient. As p is normalised, thin fog
/// has the same entropy as thick fog; Σα tells them apart.
///
/// # Panics
/// If the shape does not match `segments`.
///
/// # Examples
/// Two equally opaque samples, and a single one:
/// ```
/// # #[cfg(feature = "flex")] {
/// use burn::tensor::{Device, Tensor};
/// use infonerf_ops::{Segments, ray_entropy};
///
/// let tau = Tensor::<1>::from_floats([3.0, 3.0, 5.0], &Device::flex());
/// let rays = Segments::from_counts([2, 1]);
/// let entropy = ray_entropy(tau, &rays, 0.0);
/// assert_eq!(entropy.bits.into_data().to_vec::<f32>().unwrap(), [1.0, 0.0]);
/// # }
/// ```
pub fn ray_entropy(tau: Tensor<1>, segments: &Segments, epsilon: f32) -> RayEntropy {
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one value per packed sample");
    dispatch! {
        &tau.device();
        host => {
            let (kernel, shape) = (host::EntropyKernel { epsilon }, [segments.rays(), host::COLUMNS]);
            RayEntropy::from_columns(crate::host::rays::apply(kernel, segments, shape, [tau.into_dispatch()]))
        },
        cube if segments.samples() > 0 => {
            let kernel = gpu::GpuEntropy { segments: segments.clone(), epsilon };
            RayEntropy::from_columns(crate::cube::apply(kernel, [tau.into_dispatch()]))
        },
        plain => plain(tau, segments, epsilon),
    }
}
