//! Compositing along rays.

#[cfg(feature = "cube")]
mod gpu;
#[cfg(feature = "flex")]
mod host;
mod plain;

use burn::tensor::Tensor;

pub use self::plain::plain;
use crate::dispatch::dispatch;
use crate::segments::Segments;
use crate::traffic::upload;

/// The result of [`composite`], one row per ray.
#[derive(Clone, Debug)]
pub struct Composite {
    /// Σ wᵢ vᵢ of the given per-sample values, `[R, C]`.
    pub values: Tensor<2>,
    /// Accumulated opacity Σ wᵢ = 1 − exp(−Σ τᵢ), `[R]`.
    pub acc: Tensor<1>,
}

/// Composites packed samples: Σ wᵢ vᵢ, `[R, C]`, and Σ wᵢ, `[R]`, of each ray, with wᵢ = Tᵢ αᵢ, Tᵢ = exp(−Σ_{j<i} τⱼ) and
/// αᵢ = 1 − e^−τᵢ (InfoNeRF, Eq. 1, in optical depth).
///
/// - `tau`: optical depths τ = σδ ≥ 0, `[M]`.
/// - `values`: quantities v to integrate (colour, distance, features), `[M, C]`.
///
/// Differentiable in both, and in the intervals δ if `tau` is computed from them as `sigma * delta`. An empty ray gives zeros.
/// Values and gradients are finite for every τ in [0, ∞]. Kernels compute no gradient as a difference of sums, so that small ones
/// behind an opaque sample keep their digits.
///
/// # Panics
/// If the shapes do not match `segments`.
pub fn composite(tau: Tensor<1>, values: Tensor<2>, segments: &Segments) -> Composite {
    let [samples, channels] = values.dims();
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one value per packed sample");
    assert_eq!(samples, segments.samples(), "values holds one row per packed sample");
    dispatch! {
        &tau.device();
        host => {
            let (kernel, shape) = (host::CompositeKernel { channels }, [segments.rays(), channels + 1]);
            let inputs = [tau.into_dispatch(), values.into_dispatch()];
            let packed = crate::host::rays::apply(kernel, segments, shape, inputs);
            Composite { acc: packed.clone().narrow(1, channels, 1).squeeze_dim(1), values: packed.narrow(1, 0, channels) }
        },
        cube if samples > 0 => {
            let (values, _, acc) = gpu::composite(tau, Some(values), None, None, segments);
            Composite { values: values.expect("values were given"), acc }
        },
        plain => plain(tau, values, segments),
    }
}

/// The result of [`composite_over`], one row per ray.
#[derive(Clone, Debug)]
pub struct CompositeOver {
    /// Σ wᵢ cᵢ + (1 − Σ wᵢ) · background, `[R, 3]`, if colours were given.
    pub color: Option<Tensor<2>>,
    /// Σ wᵢ tᵢ, `[R]`.
    pub depth: Tensor<1>,
    /// Σ wᵢ, `[R]`.
    pub acc: Tensor<1>,
}

/// Composites colours c, `[M, 3]`, over a background b, and distances t, `[M]`: Σ wᵢ cᵢ + (1 − Σ wᵢ) b, Σ wᵢ tᵢ in scene units, and
/// Σ wᵢ of each ray, with the weights of [`composite`]. Differentiable in `tau` and `color`. On GPUs it is one kernel.
///
/// # Panics
/// If the shapes do not match `segments`.
pub fn composite_over(
    tau: Tensor<1>,
    color: Option<Tensor<2>>,
    distances: Tensor<1>,
    background: [f32; 3],
    segments: &Segments,
) -> CompositeOver {
    let samples = segments.samples();
    assert_eq!([tau.dims(), distances.dims()], [[samples]; 2], "τ and distance are one value per packed sample");
    dispatch! {
        &tau.device();
        cube if samples > 0 => {
            let background = color.is_some().then_some(background);
            let (color, depth, acc) = gpu::composite(tau, color, Some(distances), background, segments);
            CompositeOver { color, depth, acc }
        },
        plain => {
            let (device, is_colored) = (tau.device(), color.is_some());
            let t = distances.detach().unsqueeze_dim(1);
            let values = match color {
                Some(color) => Tensor::cat(vec![color, t], 1),
                None => t,
            };
            let Composite { values, acc } = composite(tau, values, segments);
            let color = is_colored.then(|| {
                let behind = acc.clone().neg() + 1.0;
                let background = upload(background.to_vec(), [1, 3], &device);
                values.clone().narrow(1, 0, 3) + behind.unsqueeze_dim::<2>(1).mul(background)
            });
            let depth = values.narrow(1, if is_colored { 3 } else { 0 }, 1).reshape([segments.rays()]);
            CompositeOver { color, depth, acc }
        },
    }
}

/// Computes the opacity α = 1 − e^−τ of a sample without cancellation.
pub fn alpha(tau: f32) -> f32 {
    -(-tau).exp_m1()
}

/// Computes the compositing weights `w` of packed samples on the host, `[M]`, without a gradient: for importance sampling.
pub fn weights(tau: &[f32], segments: &Segments) -> Vec<f32> {
    let mut weights = vec![0.0; tau.len()];
    for range in segments.ranges() {
        let mut depth = 0f64;
        for i in range {
            weights[i] = (-depth).exp() as f32 * alpha(tau[i]);
            depth += f64::from(tau[i]);
        }
    }
    weights
}
