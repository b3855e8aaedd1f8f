//! Entropy of the distributions along rays.

use burn::tensor::{FloatDType, Int, Tensor};
use serde::{Deserialize, Serialize};

use crate::Segments;
use crate::composite::{MIN_ALPHA_SUM, Padding, plain_alpha, working_dtype};
use crate::dispatch::dispatch;

/// Which distribution along a ray an entropy is of. `αᵢ = 1 − e^−τᵢ`, `wᵢ = Tᵢ αᵢ`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum RayDistribution {
    /// `pᵢ = αᵢ/Σα` (InfoNeRF, Eq. 4): how opacity is spread over the samples. A ray whose opacities sum to nothing has
    /// entropy 0 and no gradient, and thin fog has the same entropy as thick fog.
    #[default]
    Alpha,
    /// The same with the background as one more sample that is opaque: `pᵢ = αᵢ/(Σα + 1)` and `1/(Σα + 1)`. This is what
    /// the released code computes in effect where a ray's last interval is 1e10 long and its density is not 0.
    AlphaBackground,
    /// Where the ray ends: `w₁ … w_N`, and the rest `1 − Σw` for the background. Fog of any thickness has a positive
    /// entropy, and neither a ray that hits nothing nor one that ends at one sample has any.
    Termination,
}

/// The result of [`ray_entropy`], one number per ray.
#[derive(Clone, Debug)]
pub struct RayEntropy {
    /// `H = −Σ p log₂(p + ε)` in bits (InfoNeRF, Eq. 5), `[R]`.
    pub bits: Tensor<1>,
    /// Cumulative ray density `Q = Σα` (InfoNeRF, Eq. 7), `[R]`.
    pub alpha_sum: Tensor<1>,
}

/// Entropy of each ray's distribution, differentiable in `tau`.
///
/// - `tau`: optical depths τ = σδ ≥ 0, packed `[M]`.
/// - `epsilon` ≥ 0 is added inside the logarithm (the released code has 1e-10).
///
/// The gradients, with `gᵢ = −ln(pᵢ + ε) − pᵢ/(pᵢ + ε)` and the background as sample N + 1 where there is one:
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
    assert_eq!(tau.dims(), [segments.samples()], "tau holds one number per packed sample");
    dispatch! {
        &tau.device();
        host => split(crate::ray_kernel::apply(host::EntropyKernel { segments: segments.clone(), distribution, epsilon }, tau)),
        cube if segments.samples() > 0 && distribution == RayDistribution::Alpha => {
            let [bits, alpha_sum] = crate::cube::entropy(tau, segments, epsilon);
            RayEntropy { bits, alpha_sum }
        },
        plain => plain(tau, segments, distribution, epsilon),
    }
}

#[cfg(feature = "flex")]
fn split(packed: Tensor<2>) -> RayEntropy {
    let column = |i: usize| packed.clone().narrow(1, i, 1).squeeze_dim::<1>(1);
    RayEntropy { bits: column(0), alpha_sum: column(1) }
}

/// [`ray_entropy`] from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, segments: &Segments, distribution: RayDistribution, epsilon: f32) -> RayEntropy {
    let device = tau.device();
    if segments.longest() == 0 {
        let zeros = Tensor::<1>::zeros([segments.rays()], &device);
        return RayEntropy { bits: zeros.clone(), alpha_sum: zeros };
    }
    let tau = Padding::new(segments, &device).apply(tau.cast(working_dtype(&device)));
    let alpha = plain_alpha(tau.clone());
    let alpha_sum = alpha.clone().sum_dim(1);
    let mass = match distribution {
        RayDistribution::Alpha => alpha,
        RayDistribution::AlphaBackground => {
            let background = alpha_sum.ones_like();
            Tensor::cat(vec![alpha, background], 1)
        }
        RayDistribution::Termination => {
            let nothing = alpha_sum.zeros_like();
            let depths = Tensor::cat(vec![nothing, tau], 1).cumsum(1);
            let [_, samples] = alpha.dims();
            let background = depths.clone().narrow(1, samples, 1).neg().exp();
            Tensor::cat(vec![depths.narrow(1, 0, samples).neg().exp() * alpha, background], 1)
        }
    };
    RayEntropy {
        bits: plain_bits(mass, epsilon).cast(FloatDType::F32),
        alpha_sum: alpha_sum.squeeze_dim::<1>(1).cast(FloatDType::F32),
    }
}

/// −Σ p log₂(p + ε) with p = mass/Σ mass, 0 where the sum is below [`MIN_ALPHA_SUM`]; inputs are masked before the logarithm.
fn plain_bits(mass: Tensor<2>, epsilon: f32) -> Tensor<1> {
    let sum = mass.clone().sum_dim(1);
    let missed = sum.clone().lower_elem(MIN_ALPHA_SUM);
    let sum = sum.mask_fill(missed.clone(), 1.0);
    // The largest p is 1 − (all others)/sum: where it is nearly 1, its logarithm is that of the others.
    let [rays, samples] = mass.dims();
    let places = Tensor::<1, Int>::arange(0..samples as i64, &mass.device()).unsqueeze::<2>().expand([rays, samples]);
    let top = places.equal(mass.clone().detach().argmax(1).expand([rays, samples]));
    let others = mass.clone().mask_fill(top.clone(), 0.0).sum_dim(1) / sum.clone();
    let p = mass.clone() / sum.clone();
    let certain = top.bool_and(p.clone().detach().greater_elem(0.5));
    // Both branches are computed, so this one is kept off what it is not meant for.
    let nearly = (others.clamp(0.0, 0.5).neg() + epsilon).log1p().expand([rays, samples]);
    let log = if epsilon > 0.0 {
        (p.clone() + epsilon).log()
    } else {
        // An empty sample counts as the smallest normal `f32`, so that it has a finite slope.
        mass.clamp_min(f32::MIN_POSITIVE).log() - sum.log()
    };
    let bits = (p * log.mask_where(certain, nearly)).sum_dim(1) * -std::f32::consts::LOG2_E;
    bits.mask_fill(missed, 0.0).squeeze_dim(1)
}

#[cfg(feature = "flex")]
mod host {
    use super::RayDistribution;
    use crate::Segments;
    use crate::distribution::Distributions;
    use crate::groups::Group;
    use crate::numeric::Opacity;
    use crate::ray_kernel::RayKernel;

    /// Entropy in bits, and Σα.
    const COLUMNS: usize = 2;

    #[derive(Debug)]
    pub(super) struct EntropyKernel {
        pub(super) segments: Segments,
        pub(super) distribution: RayDistribution,
        pub(super) epsilon: f32,
    }

    /// Of τ to entropy and Σα.
    impl RayKernel<1> for EntropyKernel {
        fn segments(&self) -> &Segments {
            &self.segments
        }

        fn shape(&self) -> Vec<usize> {
            vec![self.segments.rays(), COLUMNS]
        }

        #[inline(always)]
        fn forward<const FMA: bool>(&self, group: Group<'_>, [tau]: [&[f32]; 1], out: &mut [f32]) {
            let opacity = Opacity::of::<FMA>(tau);
            for (range, row) in group.ranges().zip(out.chunks_exact_mut(COLUMNS)) {
                row[1] = opacity.alpha[range].iter().sum::<f64>() as f32;
            }
            let distributions = Distributions::new(&opacity, &group, self.distribution);
            distributions.entropies::<FMA>(self.epsilon, |ray, nats| {
                out[ray * COLUMNS] = (nats * std::f64::consts::LOG2_E) as f32;
            });
        }

        #[inline(always)]
        fn backward<const FMA: bool>(
            &self,
            group: Group<'_>,
            [tau]: [&[f32]; 1],
            grad: &[f32],
            [dtau]: [Option<&mut [f32]>; 1],
        ) {
            let Some(dtau) = dtau else { return };
            let opacity = Opacity::of::<FMA>(tau);
            for (range, row) in group.ranges().zip(grad.chunks_exact(COLUMNS)).filter(|(_, row)| row[1] != 0.0) {
                for (dtau, through) in dtau[range.clone()].iter_mut().zip(&opacity.through[range]) {
                    *dtau = (f64::from(row[1]) * through) as f32;
                }
            }
            let scale = |ray: usize| f64::from(grad[ray * COLUMNS]) * std::f64::consts::LOG2_E;
            let distributions = Distributions::new(&opacity, &group, self.distribution);
            distributions.add_entropy_gradients::<FMA>(self.epsilon, scale, dtau);
        }
    }
}
