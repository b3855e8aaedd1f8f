//! The layers that NeRF and mip-NeRF share (Mildenhall et al. 2020, Fig. 7).

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor};
use infonerf_ops::frequency::encoded_width;
use infonerf_ops::mlp::{Activation, ColorBranch, Dense, Precision, RadianceMlp, radiance_mlp};
use infonerf_schedule::Fault;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::check::{check_precision, check_range, check_width};
use crate::field::FieldSetup;
use crate::init::Init;
use crate::points::{FieldOutput, Points};

#[derive(Clone, Copy, Debug)]
pub(crate) struct MlpSize {
    /// Width of the encoded position.
    pub(crate) inputs: usize,
    /// Hidden layers of the trunk.
    pub(crate) layers: usize,
    /// Width of the trunk; the view branch has half of it.
    pub(crate) width: usize,
    /// Index of the trunk layer that the encoded position is concatenated to.
    pub(crate) skip: usize,
    pub(crate) direction_frequencies: usize,
    pub(crate) precision: Precision,
}

impl MlpSize {
    pub(crate) fn validate(&self) -> Result<(), Fault> {
        check_range("layers", 1..=64, self.layers)?;
        check_width(self.width, 4096)?;
        check_range("direction_frequencies", 0..=20, self.direction_frequencies)
    }

    /// Builds an MLP whose initial weights are drawn by the seed of `setup`.
    pub(crate) fn build(self, init: Init, setup: &FieldSetup<'_>) -> Result<Mlp, Fault> {
        check_precision(self.precision, setup.device)?;
        Ok(Mlp::new(self, init, &mut ChaCha8Rng::seed_from_u64(setup.seed), setup.device))
    }
}

/// Encoded position → trunk of ReLU layers with one skip → density; trunk features and encoded direction → colour.
#[derive(Module, Debug)]
pub(crate) struct Mlp {
    trunk: Vec<Linear>,
    sigma: Linear,
    feature: Linear,
    view: Linear,
    rgb: Linear,
    #[module(skip)]
    size: MlpSize,
}

impl Mlp {
    pub(crate) fn new(size: MlpSize, init: Init, rng: &mut impl Rng, device: &Device) -> Self {
        let MlpSize { inputs, layers, width, skip, direction_frequencies, .. } = size;
        let fan_in = |layer: usize| match layer {
            0 => inputs,
            layer if layer == skip => width + inputs,
            _ => width,
        };
        Self {
            trunk: (0..layers).map(|layer| init.linear(rng, fan_in(layer), width, device)).collect(),
            sigma: init.linear(rng, width, 1, device),
            feature: init.linear(rng, width, width, device),
            view: init.linear(rng, width + encoded_width(3, direction_frequencies), width / 2, device),
            rgb: init.linear(rng, width / 2, 3, device),
            size,
        }
    }

    /// Maps encoded positions `[M, inputs]` to density `[M]`, by its `activation`, and, if `color`, colour `[M, 3]`, by a sigmoid.
    pub(crate) fn forward(
        &self,
        encoded: Tensor<2>,
        points: &Points,
        color: bool,
        activation: Activation,
    ) -> FieldOutput {
        let network = RadianceMlp {
            trunk: self.trunk.iter().map(dense).collect(),
            skip: self.size.skip,
            sigma: dense(&self.sigma),
            color: color.then(|| ColorBranch {
                feature: dense(&self.feature),
                view: dense(&self.view),
                rgb: dense(&self.rgb),
                directions: points.directions.clone(),
                frequencies: self.size.direction_frequencies,
                segments: points.segments.clone(),
            }),
            precision: self.size.precision,
        };
        let (sigma, color) = radiance_mlp(encoded, &network, [activation, Activation::Sigmoid]);
        FieldOutput { sigma, color }
    }
}

fn dense(layer: &Linear) -> Dense {
    Dense { weight: layer.weight.val(), bias: layer.bias.as_ref().expect("each layer has one").val() }
}
