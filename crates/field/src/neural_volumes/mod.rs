//! Neural Volumes (Lombardi et al. 2019): voxels that a network decodes from a latent code, and a warp of them.

mod code;
mod encoder;
mod template;
mod warp;

pub use encoder::CodeEncoderConfig;

use std::fmt;

use burn::module::Module;
use burn::tensor::Tensor;
use burn::tensor::activation::softplus;
use infonerf_ops::trilinear::{PaddingMode, Voxels, trilinear};
use infonerf_ops::upload;
use infonerf_schedule::{Fault, Moment};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::check::{check, check_range};
use crate::field::{Field, FieldSetup, FieldSpec, FieldTraits, Footprint, Penalty, SourceImages, Sources};
use crate::points::{FieldOutput, Points};
use code::{Code, Latent};
use encoder::CodeEncoder;
use template::Template;
use warp::VolumeWarp;

const LEAKY_SLOPE: f64 = 0.2;
/// Gain √(2/(1 + 0.2²)), which keeps the variance through a leaky ReLU.
const LEAKY_GAIN: f32 = 1.386_750_5;
/// Mean, deviation and white level of colours, which are softplus(100 + 25x)/255: mid-grey before training.
const COLOR: (f32, f32, f32) = (100.0, 25.0, 255.0);

/// Sizes of [`NeuralVolumes`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NeuralVolumesConfig {
    /// Elements of the latent code (released code: 256).
    pub latent: usize,
    /// Voxels of the template along each axis, a power of two (paper: 128).
    pub resolution: usize,
    /// Channels of the first transposed convolution, halved with every second further one (released code: 512).
    pub width: usize,
    /// Affine maps that the warp mixes (paper: 16).
    pub maps: usize,
    /// Voxels of the warp along each axis (paper: 32).
    pub warp_resolution: usize,
    /// Encoder of images into the code. Without it the code is a parameter, which is equivalent for a scene of one frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub encoder: Option<CodeEncoderConfig>,
}

impl fmt::Display for NeuralVolumesConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { latent, resolution, width, maps, .. } = self;
        write!(f, "{resolution}³ voxels, decoded from {latent} numbers at width {width}, ")?;
        write!(f, "warped by {maps} affine maps")?;
        self.encoder.as_ref().map_or(Ok(()), |encoder| write!(f, ", encoded from {} images", encoder.images))
    }
}

impl FieldSpec for NeuralVolumesConfig {
    type Field = NeuralVolumes;

    fn validate(&self) -> Result<(), Fault> {
        check_range("latent", 1..=4096, self.latent)?;
        let good = (4..=256).contains(&self.resolution) && self.resolution.is_power_of_two();
        check("resolution", "a power of two from 4 to 256", self.resolution, good)?;
        let good = (8..=2048).contains(&self.width) && self.width.is_multiple_of(8);
        check("width", "a multiple of 8 from 8 to 2048", self.width, good)?;
        check_range("maps", 1..=64, self.maps)?;
        check_range("warp_resolution", 2..=64, self.warp_resolution)?;
        self.encoder.as_ref().map_or(Ok(()), CodeEncoderConfig::validate)
    }

    fn build(&self, setup: &FieldSetup<'_>) -> Result<NeuralVolumes, Fault> {
        let &FieldSetup { bounds: [low, high], seed, device, .. } = setup;
        let rng = &mut ChaCha8Rng::seed_from_u64(seed);
        let &Self { latent, resolution, width, maps, warp_resolution, .. } = self;
        let codes = match &self.encoder {
            Some(encoder) => Codes::Encoded(CodeEncoder::new(encoder, latent, rng, device)),
            None => Codes::Learned(Latent::new(latent, rng, device)),
        };
        let template = Template::new(latent, resolution, width, rng, device);
        let warp = VolumeWarp::new(latent, maps, warp_resolution, rng, device);
        let middle = [0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis]));
        let half_side = 0.5 * setup.longest_side();
        Ok(NeuralVolumes { codes, template, warp, decoded: None, resolution, middle, half_side })
    }

    fn footprint(&self) -> Footprint {
        let channels = template::channels(self.resolution, self.width);
        let convolutions: usize = channels.windows(2).map(|pair| 64 * pair[0] * pair[1]).sum();
        let weights = 64 * self.maps * self.warp_resolution.pow(3);
        let encoder = self.encoder.as_ref().map_or(0, |encoder| encoder.parameters(self.latent));
        let parameters = (encoder + self.latent * channels[0] + convolutions + weights) as u64;
        // Places at which warp and template are read, the values there, and the gradients of each.
        Footprint { parameters, per_sample: 20 }
    }

    fn traits(&self) -> FieldTraits {
        let first = |encoder: &CodeEncoderConfig| SourceImages::First { key: "encoder.images", count: encoder.images };
        FieldTraits { sources: self.encoder.as_ref().map_or(SourceImages::None, first), ..FieldTraits::default() }
    }
}

/// Images, if there is an encoder → latent code → template of coloured voxels, and a warp field → density and colour.
///
/// The volume is the cube [−1, 1]³ of the longest side of the scene's box about its middle. The warp maps a point of
/// the cube to where the template is read; outside of the cube space is empty. Density is the template's opacity per unit of the
/// cube, in scene units; it is meant for `render.compositing = "additive"`.
#[derive(Module, Debug)]
pub struct NeuralVolumes {
    codes: Codes,
    template: Template,
    warp: VolumeWarp,
    /// The decoded code; `None` before the field is [conditioned](Field::conditioned).
    decoded: Option<Decoded>,
    #[module(skip)]
    resolution: usize,
    #[module(skip)]
    middle: [f32; 3],
    #[module(skip)]
    half_side: f32,
}

#[derive(Module, Debug)]
#[allow(clippy::large_enum_variant, reason = "a field holds one of them")]
enum Codes {
    /// Encoded from the first training views.
    Encoded(CodeEncoder),
    /// A parameter.
    Learned(Latent),
}

#[derive(Module, Debug)]
struct Decoded {
    /// Colour and opacity per unit of the cube of each voxel, `[resolution³, 4]`.
    voxels: Tensor<2>,
    /// Place in the cube where the template is read for each voxel of the warp's grid, `[warp_resolution³, 3]`.
    warp: Tensor<2>,
    /// The distribution that the code was drawn from.
    code: Code,
}

impl NeuralVolumes {
    fn decoded(&self) -> &Decoded {
        self.decoded.as_ref().expect("Neural Volumes are conditioned before they are evaluated")
    }

    /// Computes the mean over the template's voxels of √(1e-5 + |∇ ln(1e-5 + α)|²), where α is a voxel's opacity per unit of the cube,
    /// and ∇ takes differences to the next voxel along each axis.
    fn total_variation(&self) -> Tensor<1> {
        const EPSILON: f32 = 1e-5;
        let n = self.resolution;
        let logarithm = (self.decoded().voxels.clone().narrow(1, 3, 1) + EPSILON).log().reshape([n, n, n]);
        let here = logarithm.clone().slice([0..n - 1, 0..n - 1, 0..n - 1]);
        let towards = |axis: usize| {
            let from = |a: usize| usize::from(a == axis)..n - usize::from(a != axis);
            logarithm.clone().slice([from(0), from(1), from(2)]) - here.clone()
        };
        let squares = (0..3).map(|axis| towards(axis).square()).fold(here.zeros_like(), |sum, square| sum + square);
        (squares + EPSILON).sqrt().mean()
    }
}

impl Field for NeuralVolumes {
    fn evaluate(&self, points: &Points, color: bool, _at: Moment) -> FieldOutput {
        let samples = points.len();
        let Decoded { voxels, warp, .. } = self.decoded();
        // In the cube [−1, 1]³.
        let middle = upload(self.middle.to_vec(), [1, 3], &points.positions.device());
        let cube = (points.positions.clone() - middle) / self.half_side;
        // 1 in the open cube, else 0.
        let inside = cube.clone().abs().max_dim(1).lower_elem(1.0).float();
        let warped = trilinear(warp.clone(), in_voxels(cube, self.warp.grid()), self.warp.grid());
        let template = Voxels { grids: 1, size: [self.resolution; 3], padding: PaddingMode::Zero };
        let voxels = if color { voxels.clone() } else { voxels.clone().narrow(1, 3, 1) };
        let read = trilinear(voxels, in_voxels(warped, template), template) * inside;
        let opacity = read.clone().narrow(1, if color { 3 } else { 0 }, 1).reshape([samples]);
        FieldOutput { sigma: opacity / self.half_side, color: color.then(|| read.narrow(1, 0, 3)) }
    }

    fn conditioned(&self, sources: &Sources, seed: Option<u64>) -> Self {
        let code = match &self.codes {
            Codes::Encoded(encoder) => encoder.code(&sources.views),
            Codes::Learned(latent) => latent.code(),
        };
        let drawn = code.draw(seed);
        let raw = self.template.voxels(drawn.clone());
        let (bias, scale, white) = COLOR;
        let color = softplus(raw.clone().narrow(1, 0, 3) * scale + bias, 1.0) / white;
        let opacity = softplus(raw.narrow(1, 3, 1), 1.0);
        let decoded = Decoded { voxels: Tensor::cat(vec![color, opacity], 1), warp: self.warp.field(drawn), code };
        Self { decoded: Some(decoded), ..self.clone() }
    }

    fn penalty(&self, name: Penalty) -> Option<Tensor<1>> {
        match name {
            Penalty::TOTAL_VARIATION => Some(self.total_variation()),
            Penalty::LATENT_DIVERGENCE => Some(self.decoded().code.divergence()),
            _ => None,
        }
    }
}

/// Maps the cube [−1, 1]³ to the voxels of a grid whose outermost centres are on the cube's faces.
fn in_voxels(points: Tensor<2>, grid: Voxels) -> Tensor<2> {
    (points + 1.0) * (0.5 * (grid.size[0] - 1) as f32)
}
