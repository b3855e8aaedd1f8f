//! Divergence of the distributions along neighbouring rays: InfoNeRF's information gain.

#[cfg(feature = "cube")]
mod gpu;
#[cfg(feature = "flex")]
mod host;
mod plain;

use burn::tensor::Tensor;

pub use self::plain::plain;
use crate::dispatch::dispatch;
use crate::segments::Segments;

/// Computes KL(P(r) ‖ P(r̃)) = Σ pᵢ [ln(pᵢ + ε) − ln(qᵢ + ε)] of paired rays in nats (InfoNeRF, Eq. 9), `[R]`, with p = α/Σα of `tau`
/// and q = α/Σα of `near`.
///
/// - `tau`, `near`: optical depths τ = σδ ≥ 0, both `[M]`, packed by the same `segments`; samples are paired by index.
/// - `epsilon` > 0 bounds the divergence of disjoint rays at −ln ε nats (the released code has 1e-10).
///
/// Differentiable in both. A pair in which either ray has Σα below [`MIN_ALPHA_SUM`](crate::entropy::MIN_ALPHA_SUM) gives 0 with zero
/// gradient. For the reverse direction of the released code swap the arguments.
///
/// # Panics
/// If the shapes do not match `segments`, or `epsilon` is not positive.
pub fn ray_divergence(tau: Tensor<1>, near: Tensor<1>, segments: &Segments, epsilon: f32) -> Tensor<1> {
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one value per packed sample");
    assert_eq!(near.dims(), [segments.samples()], "near holds one value per packed sample");
    assert!(epsilon > 0.0, "epsilon must be positive: it bounds the divergence");
    dispatch! {
        &tau.device();
        host => {
            let kernel = host::DivergenceKernel { epsilon };
            crate::host::rays::apply(kernel, segments, [segments.rays()], [tau, near].map(Tensor::into_dispatch))
        },
        cube if segments.samples() > 0 => {
            let kernel = gpu::GpuDivergence { segments: segments.clone(), epsilon };
            crate::cube::apply(kernel, [tau, near].map(Tensor::into_dispatch))
        },
        plain => plain(tau, near, segments, epsilon),
    }
}
