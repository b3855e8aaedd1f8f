//! The MLP of NeRF (Mildenhall et al. 2020, Fig. 7).

use std::fmt;

use burn::module::Module;
use burn::tensor::Tensor;
use infonerf_ops::frequency::{encoded_width, frequency_encode};
use infonerf_ops::mlp::{Activation, Precision};
use infonerf_ops::{to_host, upload};
use infonerf_schedule::{Fault, Moment, Schedule, is_default};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::check::{check_detail, check_range};
use crate::detail::frequency_window;
use crate::field::{Field, FieldSetup, FieldSpec, Footprint, Sources};
use crate::init::{Init, normal};
use crate::mlp::{Mlp, MlpSize};
use crate::points::{FieldOutput, Points};

/// Sizes of [`NerfMlp`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NerfConfig {
    /// Hidden layers of the trunk (paper: 8).
    pub layers: usize,
    /// Hidden layers of the coarse pass's trunk, if other than `layers` (released InfoNeRF code on DTU: 4).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub coarse_layers: Option<usize>,
    /// Width of the trunk (paper: 256); the view branch has half of it.
    pub width: usize,
    /// Index of the trunk layer that the encoded position is concatenated to (paper: 5); none if not below `layers`.
    pub skip: usize,
    /// Frequencies of the position's encoding (paper: 10).
    pub position_frequencies: usize,
    /// Frequencies of the direction's encoding (paper: 4).
    pub direction_frequencies: usize,
    /// Activation from raw density to σ.
    pub density: DensityActivation,
    /// Standard deviation of noise on raw density in training steps (released InfoNeRF code: 1 on DTU, 0 on Blender).
    #[serde(default, skip_serializing_if = "is_default")]
    pub density_noise: f32,
    /// Share of the position's frequencies in use, lowest first (FreeNeRF anneals it from 0 to 1); 1 for all.
    pub detail: Schedule,
    /// Precision of the factors of the network's matrix products: "f32", or "bf16" (8 significant bits; not on `ndarray`).
    #[serde(default)]
    pub precision: Precision,
}

/// Activation from raw network output to density σ ≥ 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum DensityActivation {
    /// max(x, 0), as in NeRF. If raw output is negative everywhere, there is no gradient and the field stays empty.
    Relu,
    /// ln(1 + eˣ⁻¹), as in mip-NeRF: positive everywhere, so that an empty field can recover.
    Softplus,
}

impl From<DensityActivation> for Activation {
    fn from(density: DensityActivation) -> Self {
        match density {
            DensityActivation::Relu => Self::Relu,
            DensityActivation::Softplus => Self::ShiftedSoftplus,
        }
    }
}

impl fmt::Display for NerfConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "MLP of {} layers of {}", self.layers, self.width)?;
        self.coarse_layers.map_or(Ok(()), |layers| write!(f, ", coarse {layers} layers"))
    }
}

impl NerfConfig {
    fn size(&self) -> MlpSize {
        let &Self { layers, width, skip, direction_frequencies, precision, .. } = self;
        let inputs = encoded_width(3, self.position_frequencies);
        MlpSize { inputs, layers, width, skip, direction_frequencies, precision }
    }
}

impl FieldSpec for NerfConfig {
    type Field = NerfMlp;

    fn validate(&self) -> Result<(), Fault> {
        self.size().validate()?;
        check_range("coarse_layers", 1..=64, self.coarse_layers.unwrap_or(self.layers))?;
        check_range("position_frequencies", 0..=20, self.position_frequencies)?;
        check_range("density_noise", 0.0..=1000.0, self.density_noise)?;
        check_detail(&self.detail)
    }

    fn build(&self, setup: &FieldSetup<'_>) -> Result<NerfMlp, Fault> {
        let mlp = self.size().build(Init::FanIn, setup)?;
        Ok(NerfMlp { mlp, config: self.clone(), seed: setup.seed, step_seed: None })
    }

    fn footprint(&self) -> Footprint {
        Footprint::dense(self.layers, self.width)
    }

    fn coarse(&self) -> Option<Self> {
        Some(Self { layers: self.coarse_layers.unwrap_or(self.layers), ..self.clone() })
    }
}

/// Positional encoding → MLP → density and colour.
#[derive(Module, Debug)]
pub struct NerfMlp {
    mlp: Mlp,
    #[module(skip)]
    config: NerfConfig,
    /// Seed of the initial weights, by which networks of a model differ.
    #[module(skip)]
    seed: u64,
    /// Seed of the training step that the field is [conditioned](Field::conditioned) for; `None` in renders.
    #[module(skip)]
    step_seed: Option<u64>,
}

impl NerfMlp {
    /// Draws a training step's noise on raw density, `[M]`, by its seed and the first position; `None` without noise.
    fn density_noise(&self, points: &Points) -> Option<Tensor<1>> {
        let deviation = self.config.density_noise;
        let step = self.step_seed.filter(|_| deviation > 0.0 && !points.is_empty())?;
        let first = to_host(points.positions.clone().detach().narrow(0, 0, 1));
        let seed = first.iter().fold(step ^ self.seed.rotate_left(32), |seed, x| {
            (seed ^ u64::from(x.to_bits())).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29)
        });
        let noise = normal(&mut ChaCha8Rng::seed_from_u64(seed), points.len());
        Some(upload(noise, [points.len()], &points.positions.device()) * deviation)
    }
}

impl Field for NerfMlp {
    fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
        let c = &self.config;
        let window = frequency_window(c.position_frequencies, c.detail.at(at));
        let encoded = frequency_encode(points.positions.clone(), c.position_frequencies, &window);
        let Some(noise) = self.density_noise(points) else {
            return self.mlp.forward(encoded, points, color, c.density.into());
        };
        let raw = self.mlp.forward(encoded, points, color, Activation::None);
        FieldOutput { sigma: Activation::from(c.density).apply(raw.sigma + noise), ..raw }
    }

    fn conditioned(&self, _sources: &Sources, seed: Option<u64>) -> Self {
        Self { step_seed: seed, ..self.clone() }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::points::Extent;

    fn config() -> NerfConfig {
        NerfConfig {
            layers: 2,
            coarse_layers: None,
            width: 16,
            skip: 1,
            position_frequencies: 3,
            direction_frequencies: 1,
            density: DensityActivation::Relu,
            density_noise: 0.0,
            detail: 1.0.into(),
            precision: Precision::F32,
        }
    }

    /// Checks the settings of the released InfoNeRF code on DTU: a coarse network of 4 layers, and noise of deviation 1.
    #[test]
    fn the_coarse_network_has_its_own_depth() {
        let config = NerfConfig { layers: 8, coarse_layers: Some(4), density_noise: 1.0, ..config() };
        assert_eq!(config.validate(), Ok(()));
        assert_eq!(config.coarse().unwrap().layers, 4);
        assert_eq!(config.to_string(), "MLP of 8 layers of 16, coarse 4 layers");
        assert_eq!(self::config().coarse(), Some(self::config()));
        for (config, key) in [
            (NerfConfig { coarse_layers: Some(0), ..config.clone() }, "field.coarse_layers"),
            (NerfConfig { density_noise: -1.0, ..config }, "field.density_noise"),
        ] {
            assert_eq!(config.validate().unwrap_err().key, key);
        }
        let written = toml::to_string(&self::config()).unwrap();
        assert!(!written.contains("coarse_layers") && !written.contains("noise"), "{written}");
    }

    #[test]
    fn noise_is_on_raw_density_in_training_steps_alone() {
        let device = Device::flex();
        let setup = FieldSetup { bounds: [[-1.0; 3], [1.0; 3]], seed: 3, device: &device, body: None };
        let noisy = NerfConfig { density_noise: 2.0, density: DensityActivation::Softplus, ..config() };
        let field = |config: &NerfConfig, step| {
            config.build(&setup).unwrap().conditioned(&Sources { views: [].into(), middle: [0.0; 3] }, step)
        };
        let count = 4000;
        let at = |x: f32| {
            let rows: Vec<f32> = (0..count).flat_map(|i| [x, i as f32 / count as f32, 0.1]).collect();
            Points::scattered(upload(rows, [count, 3], &device), Extent::Ball { variance: 0.0 })
        };
        let densities = |field: &NerfMlp, x: f32| to_host(field.evaluate(&at(x), true, Moment::START).sigma);
        let calm = NerfConfig { density_noise: 0.0, ..noisy.clone() };
        assert_eq!(densities(&field(&noisy, None), 0.2), densities(&field(&calm, Some(7)), 0.2));
        assert_eq!(densities(&field(&config(), None), 0.2), densities(&field(&config(), Some(7)), 0.2));
        // Inverse of ln(1 + eˣ⁻¹), as the noise is on raw density.
        let raw = |sigma: &[f32]| sigma.iter().map(|s| f64::from(*s).exp_m1().ln() + 1.0).collect::<Vec<f64>>();
        let noise = |step, x| -> Vec<f64> {
            let clean = raw(&densities(&field(&calm, None), x));
            raw(&densities(&field(&noisy, Some(step)), x)).iter().zip(clean).map(|(a, b)| a - b).collect()
        };
        let drawn = noise(7, 0.2);
        let mean = drawn.iter().sum::<f64>() / count as f64;
        let deviation = (drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / count as f64).sqrt();
        assert!(mean.abs() < 0.1 && (deviation - 2.0).abs() < 0.1, "{mean} ± {deviation}");
        assert_eq!(drawn, noise(7, 0.2));
        for other in [noise(8, 0.2), noise(7, 0.3)] {
            let correlation = drawn.iter().zip(&other).map(|(a, b)| a * b).sum::<f64>() / count as f64 / 4.0;
            assert!(correlation.abs() < 0.1, "{correlation}");
        }
    }
}
