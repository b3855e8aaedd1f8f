//! Compositing along rays.

#[cfg(feature = "ndarray")]
use burn::backend::DispatchDevice;
use burn::tensor::{Bool, Device, FloatDType, Int, Tensor};

use crate::dispatch::dispatch;
use crate::{Segments, upload};

/// Least Σα of a ray that hits something. Below it, entropy and divergence are 0 with zero gradient.
///
/// The gradient of an entropy or divergence goes with 1/(ε Σα): with ε ≥ 1e-12 and upstream gradients up to 1e6, this
/// keeps it within `f32`.
pub const MIN_ALPHA_SUM: f32 = 1e-20;

/// The result of [`composite`], one row per ray.
#[derive(Clone, Debug)]
pub struct Composite {
    /// Σ wᵢ vᵢ of the given per-sample values, `[R, C]`.
    pub values: Tensor<2>,
    /// Accumulated opacity Σ wᵢ = 1 − exp(−Σ τᵢ), `[R]`.
    pub acc: Tensor<1>,
}

/// Composites packed samples.
///
/// wᵢ = Tᵢ αᵢ with Tᵢ = exp(−Σ_{j<i} τⱼ) and αᵢ = −expm1(−τᵢ) (InfoNeRF, Eq. 1, in optical depth).
///
/// - `tau`: optical depths τ = σδ ≥ 0, `[M]`.
/// - `values`: what to integrate (colour, distance, features), `[M, C]`.
///
/// Differentiable in both; with `tau = sigma * delta` as tensors, so is it in the intervals δ.
///
/// An empty ray gives zeros. Values and gradients are finite for every τ in [0, ∞].
///
/// # Panics
/// If the shapes do not match `segments`.
pub fn composite(tau: Tensor<1>, values: Tensor<2>, segments: &Segments) -> Composite {
    let [samples, channels] = values.dims();
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one number per packed sample");
    assert_eq!(samples, segments.samples(), "values holds one row per packed sample");
    dispatch! {
        &tau.device();
        host => split(crate::ray_kernel::apply(host::CompositeKernel { segments: segments.clone(), channels }, (tau, values)), channels),
        cube if samples > 0 => {
            let (values, _, acc) = crate::cube::composite(tau, Some(values), None, None, segments);
            Composite { values: values.expect("values were given"), acc }
        },
        plain => plain(tau, values, segments),
    }
}

#[cfg(feature = "flex")]
fn split(packed: Tensor<2>, channels: usize) -> Composite {
    Composite { acc: packed.clone().narrow(1, channels, 1).squeeze_dim(1), values: packed.narrow(1, 0, channels) }
}

/// The result of [`composite_over`], one row per ray.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Σ wᵢ cᵢ + (1 − Σ wᵢ) · background, `[R, 3]`, where colours were given.
    pub color: Option<Tensor<2>>,
    /// Σ wᵢ tᵢ, `[R]`.
    pub depth: Tensor<1>,
    /// Σ wᵢ, `[R]`.
    pub acc: Tensor<1>,
}

/// Composites the colours of packed samples, `[M, 3]`, over a background, and their `distances`, `[M]`, which have no gradient.
/// Otherwise as [`composite`].
///
/// # Panics
/// If the shapes do not match `segments`.
pub fn composite_over(
    tau: Tensor<1>,
    color: Option<Tensor<2>>,
    distances: Tensor<1>,
    background: [f32; 3],
    segments: &Segments,
) -> Seen {
    let samples = segments.samples();
    assert_eq!([tau.dims(), distances.dims()], [[samples]; 2], "τ and distance are one number per packed sample");
    dispatch! {
        &tau.device();
        host => over(tau, color, distances, background, segments),
        cube if samples > 0 => {
            let background = color.is_some().then_some(background);
            let (color, depth, acc) = crate::cube::composite(tau, color, Some(distances), background, segments);
            Seen { color, depth, acc }
        },
        plain => over(tau, color, distances, background, segments),
    }
}

/// [`composite_over`] by way of [`composite`].
fn over(
    tau: Tensor<1>,
    color: Option<Tensor<2>>,
    distances: Tensor<1>,
    background: [f32; 3],
    segments: &Segments,
) -> Seen {
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
    Seen { color, depth, acc }
}

/// Compositing weights `w` of packed samples on the host, `[M]`, without a gradient: for importance sampling.
pub fn weights(tau: &[f32], segments: &Segments) -> Vec<f32> {
    let mut weights = vec![0.0; tau.len()];
    for range in segments.ranges() {
        let mut depth = 0f64;
        for i in range {
            weights[i] = (-depth).exp() as f32 * crate::numeric::alpha(tau[i]);
            depth += f64::from(tau[i]);
        }
    }
    weights
}

/// [`composite`] from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, values: Tensor<2>, segments: &Segments) -> Composite {
    let (rays, channels) = (segments.rays(), values.dims()[1]);
    let device = tau.device();
    let dtype = working_dtype(&device);
    let longest = segments.longest();
    if longest == 0 {
        return Composite { values: Tensor::zeros([rays, channels], &device), acc: Tensor::zeros([rays], &device) };
    }
    let padding = Padding::new(segments, &device);
    let tau = padding.apply(tau.cast(dtype));
    let alpha = plain_alpha(tau.clone());
    // Σw from the depth: its gradient is what leaves the ray, and not a difference of sums.
    let acc = plain_alpha(tau.clone().sum_dim(1));
    // An exclusive sum by shifting: subtracting τᵢ from an inclusive one would lose what is before a huge interval.
    let nothing = tau.clone().narrow(1, 0, 1).zeros_like();
    let before = Tensor::cat(vec![nothing, tau], 1).cumsum(1).narrow(1, 0, longest);
    let weights = before.neg().exp() * alpha;
    let values = values.cast(dtype).select(0, padding.indices.clone()).reshape([rays, longest, channels]);
    let values = (values * weights.unsqueeze_dim::<3>(2)).sum_dim(1).squeeze_dim::<2>(1);
    Composite { values: values.cast(FloatDType::F32), acc: acc.squeeze_dim::<1>(1).cast(FloatDType::F32) }
}

/// From packed samples `[M]` to rays padded with empty samples `[R, longest]`.
pub(crate) struct Padding {
    indices: Tensor<1, Int>,
    empty: Tensor<2, Bool>,
}

impl Padding {
    pub(crate) fn new(segments: &Segments, device: &Device) -> Self {
        let shape = [segments.rays(), segments.longest()];
        let (indices, valid) = segments.padded();
        let empty: Vec<bool> = valid.iter().map(|valid| !valid).collect();
        Self { indices: upload(indices, [shape[0] * shape[1]], device), empty: upload(empty, shape, device) }
    }

    pub(crate) fn apply(&self, packed: Tensor<1>) -> Tensor<2> {
        let [rays, longest] = self.empty.dims();
        packed.select(0, self.indices.clone()).reshape([rays, longest]).mask_fill(self.empty.clone(), 0.0)
    }
}

/// The float type of plain tensor operations: `f64` on `ndarray`, where sums over a ray would lose digits in `f32`.
pub(crate) fn working_dtype(device: &Device) -> FloatDType {
    match device.clone().inner().as_dispatch() {
        #[cfg(feature = "ndarray")]
        DispatchDevice::NdArray(_) => FloatDType::F64,
        _ => FloatDType::F32,
    }
}

/// α = 1 − e^−τ: by its series below 0.1, where the difference would cancel.
pub(crate) fn plain_alpha<const D: usize>(tau: Tensor<D>) -> Tensor<D> {
    let small = tau.clone().lower_elem(0.1);
    // Both branches are computed, so the series is kept off large inputs.
    let t = tau.clone().clamp(0.0, 0.1);
    // 1 − t/2 + t²/6 − …: nine terms are exact in `f64`.
    let horner =
        (1..=9).rev().fold(t.zeros_like() + 1.0, |sum: Tensor<D>, n| sum * t.clone() / -(n as f64 + 1.0) + 1.0);
    (tau.neg().exp().neg() + 1.0).mask_where(small, horner * t)
}

#[cfg(feature = "flex")]
mod host {
    use crate::Segments;
    use crate::groups::Group;
    use crate::numeric::Opacity;
    use crate::ray_kernel::RayKernel;

    #[derive(Debug)]
    pub(super) struct CompositeKernel {
        pub(super) segments: Segments,
        pub(super) channels: usize,
    }

    /// Of τ and values to one row per ray: its integrated values and Σw.
    impl RayKernel<2> for CompositeKernel {
        fn segments(&self) -> &Segments {
            &self.segments
        }

        fn shape(&self) -> Vec<usize> {
            vec![self.segments.rays(), self.channels + 1]
        }

        fn widths(&self) -> [usize; 2] {
            [1, self.channels]
        }

        #[inline(always)]
        fn forward<const FMA: bool>(&self, group: Group<'_>, [tau, values]: [&[f32]; 2], out: &mut [f32]) {
            let channels = self.channels;
            let opacity = Opacity::of::<FMA>(tau);
            let mut sums = vec![0f64; channels];
            for (range, out) in group.ranges().zip(out.chunks_exact_mut(channels + 1)) {
                sums.fill(0.0);
                // Sums of positive numbers: Σw keeps its digits where 1 − T would not.
                let (mut trans, mut acc) = (1f64, 0f64);
                for i in range {
                    let w = trans * opacity.alpha[i];
                    trans *= opacity.through[i];
                    acc += w;
                    for (sum, &value) in sums.iter_mut().zip(&values[i * channels..]) {
                        *sum += w * f64::from(value);
                    }
                }
                for (out, sum) in out.iter_mut().zip(&sums) {
                    *out = *sum as f32;
                }
                out[channels] = acc as f32;
            }
        }

        #[inline(always)]
        fn backward<const FMA: bool>(
            &self,
            group: Group<'_>,
            [tau, values]: [&[f32]; 2],
            grad: &[f32],
            [mut dtau, mut dvalues]: [Option<&mut [f32]>; 2],
        ) {
            let channels = self.channels;
            let opacity = Opacity::of::<FMA>(tau);
            // T_{i+1} of each sample, and what it is worth: uᵢ = ∂L/∂wᵢ.
            let mut trans_after = vec![0f64; tau.len()];
            let mut worths = vec![0f64; tau.len()];
            for (range, grad) in group.ranges().zip(grad.chunks_exact(channels + 1)) {
                let (integrated, dacc) = (&grad[..channels], f64::from(grad[channels]));
                let mut trans = 1f64;
                for i in range.clone() {
                    let w = (trans * opacity.alpha[i]) as f32;
                    trans *= opacity.through[i];
                    trans_after[i] = trans;
                    let of_sample = i * channels..(i + 1) * channels;
                    let products = values[of_sample.clone()].iter().zip(integrated);
                    worths[i] = products.fold(dacc, |u, (&value, &g)| u + f64::from(g) * f64::from(value));
                    if let Some(dvalues) = &mut dvalues {
                        dvalues[of_sample].iter_mut().zip(integrated).for_each(|(dvalue, g)| *dvalue = g * w);
                    }
                }
                let Some(dtau) = &mut dtau else { continue };
                // dL/dτᵢ = uᵢ T_{i+1} − Σ_{j>i} uⱼ wⱼ = T_{i+1} eᵢ, where eᵢ is how much more the sample is worth than what
                // lies behind it: eᵢ = uᵢ − uᵢ₊₁ + e^−τᵢ₊₁ eᵢ₊₁, and behind the last there is nothing. No sum is subtracted
                // from another, so the little that reaches through an opaque ray keeps its digits.
                let (mut behind, mut worth) = (0f64, 0f64);
                for i in range.rev() {
                    worth += worths[i] - behind;
                    behind = worths[i];
                    dtau[i] = (trans_after[i] * worth) as f32;
                    worth *= opacity.through[i];
                }
            }
        }
    }
}
