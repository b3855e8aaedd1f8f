//! The MLP of NeRF (Mildenhall et al. 2020, Fig. 7).

use std::fmt;

use burn::module::Module;
use burn::tensor::Device;
use infonerf_ops::frequency::{encoded_width, frequency_encode};
use infonerf_ops::mlp::Precision;
use infonerf_schedule::{Fault, Moment, Schedule};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::check::{check, check_detail, check_mlp, check_precision};
use crate::detail::frequency_window;
use crate::init::Init;
use crate::mlp::{Mlp, MlpSize};
use crate::{DensityActivation, Field, FieldOutput, FieldSetup, FieldSpec, Footprint, Points};

/// Sizes of [`NerfMlp`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NerfConfig {
    /// Hidden layers of the trunk (paper: 8).
    pub layers: usize,
    /// Width of the trunk (paper: 256); the view branch has half of it.
    pub width: usize,
    /// Index of the trunk layer that the encoded position is concatenated to (paper: 5); none if not below `layers`.
    pub skip: usize,
    /// Frequencies of the position's encoding (paper: 10).
    pub position_frequencies: usize,
    /// Frequencies of the direction's encoding (paper: 4).
    pub direction_frequencies: usize,
    /// How raw density becomes σ.
    pub density: DensityActivation,
    /// Share of the position's frequencies in use, lowest first (FreeNeRF anneals it from 0 to 1); 1 for all.
    pub detail: Schedule,
    /// Precision of the factors of the network's matrix products: "f32", or "bf16" (8 significant bits; not on `ndarray`).
    #[serde(default)]
    pub precision: Precision,
}

impl fmt::Display for NerfConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "MLP of {} layers of {}", self.layers, self.width)
    }
}

impl FieldSpec for NerfConfig {
    type Field = NerfMlp;

    fn validate(&self) -> Result<(), Fault> {
        check_mlp(self.layers, self.width, self.direction_frequencies)?;
        let frequencies = self.position_frequencies;
        check("position_frequencies", "0 to 20", frequencies, frequencies <= 20)?;
        check_detail(&self.detail)
    }

    fn build(&self, setup: &FieldSetup<'_>) -> Result<NerfMlp, Fault> {
        check_precision(self.precision, setup.device)?;
        let size = MlpSize {
            inputs: encoded_width(3, self.position_frequencies),
            layers: self.layers,
            width: self.width,
            skip: self.skip,
            direction_frequencies: self.direction_frequencies,
            precision: self.precision,
        };
        let mut rng = ChaCha8Rng::seed_from_u64(setup.seed);
        Ok(NerfMlp { mlp: Mlp::new(size, Init::FanIn, &mut rng, setup.device), config: self.clone() })
    }

    fn footprint(&self) -> Footprint {
        Footprint::dense(self.layers, self.width)
    }
}

/// Positional encoding → MLP → density and colour.
#[derive(Module, Debug)]
pub struct NerfMlp {
    mlp: Mlp,
    #[module(skip)]
    config: NerfConfig,
}

impl Field for NerfMlp {
    fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
        let c = &self.config;
        let window = frequency_window(c.position_frequencies, c.detail.at(at));
        let encoded = frequency_encode(points.positions.clone(), c.position_frequencies, &window);
        self.mlp.forward(encoded, points, color, c.density.into())
    }

    fn device(&self) -> Device {
        self.mlp.device()
    }
}
