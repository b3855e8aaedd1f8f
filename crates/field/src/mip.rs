//! mip-NeRF (Barron et al. 2021): a network of conical frusta, not of points.

use std::fmt;

use burn::module::Module;
use burn::tensor::Tensor;
use infonerf_ops::mlp::{Activation, Precision};
use infonerf_ops::{RayGaussians, frustum_gaussians, integrated_encode};
use infonerf_schedule::{Fault, Moment, Schedule};
use serde::{Deserialize, Serialize};

use crate::check::{check_detail, check_range};
use crate::detail::frequency_window;
use crate::field::{Field, FieldSetup, FieldSpec, FieldTraits, Footprint};
use crate::init::Init;
use crate::mlp::{Mlp, MlpSize};
use crate::points::{Extent, FieldOutput, Points};

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
    /// Precision of the factors of the network's matrix products: "f32", or "bf16" (8 significant bits; not on `ndarray`).
    #[serde(default)]
    pub precision: Precision,
}

impl fmt::Display for MipConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "mip MLP of {} layers of {}", self.layers, self.width)
    }
}

impl MipConfig {
    fn size(&self) -> MlpSize {
        let &Self { layers, width, skip, position_frequencies, direction_frequencies, precision, .. } = self;
        MlpSize { inputs: 6 * position_frequencies, layers, width, skip, direction_frequencies, precision }
    }
}

impl FieldSpec for MipConfig {
    type Field = MipNerf;

    fn validate(&self) -> Result<(), Fault> {
        self.size().validate()?;
        check_range("position_frequencies", 1..=20, self.position_frequencies)?;
        check_detail(&self.detail)
    }

    fn build(&self, setup: &FieldSetup<'_>) -> Result<MipNerf, Fault> {
        Ok(MipNerf { mlp: self.size().build(Init::Glorot, setup)?, config: self.clone() })
    }

    fn footprint(&self) -> Footprint {
        Footprint::dense(self.layers, self.width)
    }

    fn traits(&self) -> FieldTraits {
        FieldTraits { intervals: true, ..FieldTraits::default() }
    }

    fn coarse(&self) -> Option<Self> {
        None
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

/// Excess of the colour's sigmoid over [0, 1] on both sides (released code: `rgb_padding`).
const COLOR_PADDING: f32 = 0.001;

impl Field for MipNerf {
    fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
        let frequencies = self.config.position_frequencies;
        let window = frequency_window(frequencies, self.config.detail.at(at));
        let (means, variances) = gaussians(points);
        let encoded = integrated_encode(means, variances, frequencies, &window);
        let out = self.mlp.forward(encoded, points, color, Activation::ShiftedSoftplus);
        FieldOutput { color: out.color.map(|color| color * (1.0 + 2.0 * COLOR_PADDING) - COLOR_PADDING), ..out }
    }
}

/// Computes mean and variance along each axis of the Gaussians of `points`, both `[M, 3]` (mip-NeRF, Eq. 8 and 16).
fn gaussians(points: &Points) -> (Tensor<2>, Tensor<2>) {
    let positions = points.positions.clone();
    let (t, delta, radii) = match &points.extent {
        Extent::Ball { variance } => return (positions.clone(), positions.full_like(*variance)),
        Extent::Cones { t, delta, radii } => (t.clone(), delta.clone(), radii.clone()),
    };
    let radii = points.segments.spread(radii.unsqueeze_dim(1)).squeeze_dim(1);
    let RayGaussians { mean, along, across } = frustum_gaussians(t.clone(), delta, radii);
    let directions = points.sample_directions();
    let squares = directions.clone().square();
    let across = (squares.clone().neg() + 1.0).clamp_min(0.0) * across.unsqueeze_dim(1);
    (positions + directions * (mean - t).unsqueeze_dim(1), squares * along.unsqueeze_dim(1) + across)
}
