//! mip-NeRF (Barron et al. 2021): a network of conical frusta, not of points.

use std::fmt;

use burn::module::Module;
use burn::tensor::{Device, activation::sigmoid};
use infonerf_ops::integrated::{integrated_encode, integrated_width};
use infonerf_ops::mlp::Precision;
use infonerf_ops::{from_host, frustum_gaussian};
use infonerf_schedule::{Fault, Moment, Schedule};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::check::{check, check_detail, check_mlp, check_precision};
use crate::detail::frequency_window;
use crate::init::Init;
use crate::mlp::{Mlp, MlpSize};
use crate::{DensityActivation, Extent, Field, FieldOutput, FieldSetup, FieldSpec, Footprint, Points};

/// Sizes of [`MipNerf`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MipConfig {
    /// Hidden layers of the trunk (mip-NeRF: 8).
    pub layers: usize,
    /// Width of the trunk (mip-NeRF: 256); the view branch has half of it.
    pub width: usize,
    /// Index of the trunk layer that the encoded position is concatenated to (mip-NeRF: 5); none if not below `layers`.
    pub skip: usize,
    /// Frequencies of the position's integrated encoding (mip-NeRF: 16).
    pub position_frequencies: usize,
    /// Frequencies of the direction's encoding (mip-NeRF: 4).
    pub direction_frequencies: usize,
    /// Share of the position's frequencies in use, lowest first (FreeNeRF anneals it from 0 to 1); 1 for all.
    pub detail: Schedule,
    /// Precision of the network's matrix products.
    #[serde(default)]
    pub precision: Precision,
}

impl fmt::Display for MipConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "mip MLP of {} layers of {}", self.layers, self.width)
    }
}

impl FieldSpec for MipConfig {
    type Field = MipNerf;

    fn validate(&self) -> Result<(), Fault> {
        check_mlp(self.layers, self.width, self.direction_frequencies)?;
        let frequencies = self.position_frequencies;
        check("position_frequencies", "1 to 20", frequencies, (1..=20).contains(&frequencies))?;
        check_detail(&self.detail)
    }

    fn build(&self, setup: &FieldSetup<'_>) -> Result<MipNerf, Fault> {
        check_precision(self.precision, setup.device)?;
        let size = MlpSize {
            inputs: integrated_width(self.position_frequencies),
            layers: self.layers,
            width: self.width,
            skip: self.skip,
            direction_frequencies: self.direction_frequencies,
            precision: self.precision,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(setup.seed);
        Ok(MipNerf { mlp: Mlp::new(size, Init::Glorot, &mut rng, setup.device), config: self.clone() })
    }

    fn footprint(&self) -> Footprint {
        Footprint::dense(self.layers, self.width)
    }

    fn shares_passes(&self) -> bool {
        true
    }

    fn needs_intervals(&self) -> bool {
        true
    }
}

/// Integrated positional encoding of each sample's conical frustum, as a Gaussian → MLP → density and colour.
///
/// One network serves the coarse and the fine pass, as the encoding contains a sample's size. Density is softplus(x − 1),
/// whose gradient does not vanish, and the sigmoid of colour is widened so that 0 and 1 are reached.
#[derive(Module, Debug)]
pub struct MipNerf {
    mlp: Mlp,
    #[module(skip)]
    config: MipConfig,
}

/// How far the colour's sigmoid reaches beyond [0, 1] on both sides (released code: `rgb_padding`).
const COLOR_PADDING: f32 = 0.001;

impl Field for MipNerf {
    fn evaluate(&self, points: Points<'_>, color: bool, at: Moment) -> FieldOutput {
        let frequencies = self.config.position_frequencies;
        let window = frequency_window(frequencies, self.config.detail.at(at));
        let (means, variances) = gaussians(points);
        let [means, variances] = [means, variances].map(|rows| from_host(&rows, 3, &self.device()));
        let encoded = integrated_encode(means, variances, frequencies, &window);
        let (sigma, color) = self.mlp.forward(encoded, points, color);
        FieldOutput {
            sigma: DensityActivation::Softplus.apply(sigma),
            color: color.map(|raw| sigmoid(raw) * (1.0 + 2.0 * COLOR_PADDING) - COLOR_PADDING),
        }
    }

    fn device(&self) -> Device {
        self.mlp.device()
    }
}

/// Mean and variance along each axis of the Gaussians that `points` stand for, both `[M, 3]` (mip-NeRF, Eq. 8 and 16).
fn gaussians(points: Points<'_>) -> (Vec<f32>, Vec<f32>) {
    let mut means = points.positions.to_vec();
    let (t, delta, radii) = match points.extent {
        Extent::Ball { variance } => {
            let variances = vec![variance; means.len()];
            return (means, variances);
        }
        Extent::Cones { t, delta, radii } => (t, delta, radii),
    };
    let mut variances = vec![0.0; means.len()];
    let rays = points.directions.chunks_exact(3).zip(radii).zip(points.segments.ranges());
    for ((direction, &radius), range) in rays {
        for sample in range {
            let gaussian = frustum_gaussian(t[sample], delta[sample], radius);
            for (axis, &d) in direction.iter().enumerate() {
                means[3 * sample + axis] += (gaussian.mean - t[sample]) * d;
                variances[3 * sample + axis] = gaussian.along * d * d + gaussian.across * (1.0 - d * d).max(0.0);
            }
        }
    }
    (means, variances)
}

#[cfg(test)]
mod tests {
    use infonerf_ops::Segments;

    use super::*;

    /// Two rays from the origin: one along y, one along the diagonal of x and y.
    #[test]
    fn gaussians_by_hand() {
        let (half, root) = (0.5f32, 0.5f32.sqrt());
        let segments = Segments::from_counts([1, 1]);
        let points = Points {
            positions: &[0.0, 2.0, 0.0, 2.0 * root, 2.0 * root, 0.0],
            directions: &[0.0, 1.0, 0.0, root, root, 0.0],
            segments: &segments,
            extent: Extent::Cones { t: &[2.0, 2.0], delta: &[1.0, 1.0], radii: &[0.1, 0.2] },
            tracked: None,
        };
        let (means, variances) = gaussians(points);
        let [straight, diagonal] = [0.1, 0.2].map(|radius| frustum_gaussian(2.0, 1.0, radius));
        let want_means = [0.0, straight.mean, 0.0, diagonal.mean * root, diagonal.mean * root, 0.0];
        let slanted = half * (diagonal.along + diagonal.across);
        let want = [straight.across, straight.along, straight.across, slanted, slanted, diagonal.across];
        for (got, want) in means.iter().zip(want_means).chain(variances.iter().zip(want)) {
            approx::assert_abs_diff_eq!(*got, want, epsilon = 1e-6);
        }
        let ball = gaussians(Points { extent: Extent::Ball { variance: 0.3 }, ..points });
        assert_eq!(ball, (points.positions.to_vec(), vec![0.3; 6]));
    }
}
