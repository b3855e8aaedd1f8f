//! The MLP of NeRF (Mildenhall et al. 2020, Fig. 7).

use burn::module::Module;
use burn::tensor::{Device, activation::sigmoid};
use infonerf_ops::frequency::{encoded_width, frequency_encode};
use rand::Rng;

use crate::anneal::anneal_window;
use crate::init::Init;
use crate::mlp::{Mlp, MlpSize};
use crate::{NerfConfig, Points, Sampled};

/// Positions, encoded as points, through the MLP.
#[derive(Module, Debug)]
pub struct NerfMlp {
    mlp: Mlp,
    #[module(skip)]
    config: NerfConfig,
}

impl NerfMlp {
    pub(crate) fn new(config: &NerfConfig, rng: &mut impl Rng, device: &Device) -> Self {
        let size = MlpSize {
            inputs: encoded_width(3, config.position_octaves),
            layers: config.layers,
            width: config.width,
            skip: config.skip,
            direction_octaves: config.direction_octaves,
        };
        Self { mlp: Mlp::new(size, Init::FanIn, rng, device), config: config.clone() }
    }

    pub(crate) fn evaluate(&self, points: Points<'_>, color: bool, progress: f32) -> Sampled {
        let c = &self.config;
        let window = anneal_window(c.position_octaves, c.anneal, progress);
        let encoded = frequency_encode(points.positions, 3, c.position_octaves, &window, &self.device());
        let (sigma, color) = self.mlp.forward(encoded, points, color);
        Sampled { sigma: c.density.apply(sigma), color: color.map(sigmoid) }
    }

    pub(crate) fn device(&self) -> Device {
        self.mlp.device()
    }
}
