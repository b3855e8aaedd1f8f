//! PixelNeRF (Yu et al. 2021): a field that is conditioned on source images.

mod encoder;
mod mlp;
mod project;

use std::fmt;
use std::path::PathBuf;

use burn::module::Module;
use burn::tensor::{Tensor, activation::sigmoid};
use infonerf_ops::bilinear::{Taps, bilinear};
use infonerf_ops::frequency::frequency_encode;
use infonerf_ops::mlp::Activation;
use infonerf_ops::to_host;
use infonerf_schedule::{Fault, Moment};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::check::{check, check_range};
use crate::field::{
    Field, FieldFile, FieldSetup, FieldSpec, FieldTraits, Footprint, SourceImages, SourceView, Sources,
};
use crate::nerf::DensityActivation;
use crate::points::{FieldOutput, Points};
use encoder::ImageEncoder;
use mlp::ResnetMlp;
use project::view_points;

/// Sizes of [`PixelNerf`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PixelNerfConfig {
    /// The image encoder.
    pub encoder: EncoderConfig,
    /// ResNet blocks of the MLP (paper: 5).
    pub blocks: usize,
    /// Blocks after which the views are averaged; features are added before each of them (paper: 3).
    pub pool_after: usize,
    /// Width of the MLP (paper: 512).
    pub width: usize,
    /// Frequencies of the position's encoding in view space (paper: 6).
    pub frequencies: usize,
    /// ω, the encoding's lowest frequency: sin(2ᵏ ω x), x in scene units (paper: 1.5).
    pub lowest_frequency: f32,
    /// Activation from raw density to σ.
    pub density: DensityActivation,
}

/// The image encoder of [`PixelNerf`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EncoderConfig {
    /// Channels of the stem and the first stage, twice as many in each further one (ResNet-34: 64).
    pub width: usize,
    /// Residual blocks of each stage that is read (paper: the first three of ResNet-34, 3, 4 and 6).
    pub blocks: Vec<usize>,
    /// File, safetensors or PyTorch's, with the weights of torchvision's `resnet34`; empty for random ones.
    pub weights: PathBuf,
}

impl fmt::Display for PixelNerfConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let stages = self.encoder.blocks.len();
        write!(f, "ResNet MLP of {} blocks of {} over features of {stages} stages", self.blocks, self.width)
    }
}

impl FieldSpec for PixelNerfConfig {
    type Field = PixelNerf;

    fn validate(&self) -> Result<(), Fault> {
        let encoder = &self.encoder;
        let good = (1..=4).contains(&encoder.blocks.len()) && encoder.blocks.iter().all(|n| (1..=64).contains(n));
        check("encoder.blocks", "1 to 4 numbers from 1 to 64", format!("{:?}", encoder.blocks), good)?;
        check_range("encoder.width", 1..=512, encoder.width)?;
        check_range("blocks", 1..=64, self.blocks)?;
        check("pool_after", "1 to field.blocks", self.pool_after, (1..=self.blocks).contains(&self.pool_after))?;
        check_range("width", 1..=4096, self.width)?;
        check_range("frequencies", 0..=20, self.frequencies)?;
        let lowest = self.lowest_frequency;
        check("lowest_frequency", "above 0, at most 1000", lowest, lowest > 0.0 && lowest <= 1e3)
    }

    fn build(&self, setup: &FieldSetup<'_>) -> Result<PixelNerf, Fault> {
        let mut rng = ChaCha8Rng::seed_from_u64(setup.seed);
        let mut encoder = ImageEncoder::new(&self.encoder, &mut rng, setup.device);
        if !self.encoder.weights.as_os_str().is_empty() {
            encoder = encoder::load_resnet34(encoder, &self.encoder.weights)?;
        }
        let mlp = ResnetMlp::new(self, encoder.channels(), &mut rng, setup.device);
        Ok(PixelNerf { encoder, mlp, encoded: None, config: self.clone() })
    }

    fn footprint(&self) -> Footprint {
        let stages = self.encoder.blocks.iter().enumerate();
        let convolutions: u64 =
            stages.map(|(stage, &blocks)| 18 * blocks as u64 * ((self.encoder.width << stage) as u64).pow(2)).sum();
        // Each view has activations until views are averaged; at least one view is certain.
        let mlp = Footprint::dense(2 * self.blocks, self.width);
        Footprint { parameters: mlp.parameters + convolutions, ..mlp }
    }

    fn traits(&self) -> FieldTraits {
        FieldTraits { sources: SourceImages::Any, tracks_positions: false, ..FieldTraits::default() }
    }

    fn files(&mut self) -> Vec<FieldFile<'_>> {
        vec![FieldFile { key: "encoder.weights", path: &mut self.encoder.weights, holds_weights: true }]
    }
}

/// Pixel-aligned features of each source view → ResNet MLP, views averaged on the way → density and colour.
///
/// A point is projected into every source view, and its position in that view's axes and the features at its pixel are the
/// inputs of the MLP. Weights are shared by all views and scenes, so that training on some scenes generalises to others.
#[derive(Module, Debug)]
pub struct PixelNerf {
    encoder: ImageEncoder,
    mlp: ResnetMlp,
    /// Source views with their features; `None` before the field is [conditioned](Field::conditioned).
    encoded: Option<EncodedSources>,
    #[module(skip)]
    config: PixelNerfConfig,
}

#[derive(Module, Debug)]
struct EncodedSources {
    /// The MLP's layers that read features, applied to each texel of each view: `[V·h·w, pool_after·width]`.
    injected: Tensor<2>,
    #[module(skip)]
    sources: Sources,
}

impl Field for PixelNerf {
    fn evaluate(&self, points: &Points, color: bool, _at: Moment) -> FieldOutput {
        let encoded = self.encoded.as_ref().expect("a PixelNeRF is conditioned on images before it is evaluated");
        let EncodedSources { injected, sources } = encoded;
        let (views, samples) = (&sources.views[..], points.len());
        // Features are looked up on the host, which passes no gradient on to positions; the gradient through the encoding
        // alone would be incomplete.
        let points = &Points { positions: points.positions.clone().detach(), ..points.clone() };
        let (positions, directions) = view_points(sources, points, self.config.lowest_frequency);
        let encoded = frequency_encode(positions, self.config.frequencies, &[]);
        let pixels = project::pixels(views, &to_host(points.positions.clone()));
        let injected = bilinear(injected.clone(), &taps(&pixels, views));
        let out = self.mlp.forward(Tensor::cat(vec![encoded, directions], 1), injected, views.len());
        let sigma = Activation::from(self.config.density).apply(out.clone().narrow(1, 3, 1).reshape([samples]));
        FieldOutput { sigma, color: color.then(|| sigmoid(out.narrow(1, 0, 3))) }
    }

    fn conditioned(&self, sources: &Sources, _seed: Option<u64>) -> Self {
        // A linear layer commutes with bilinear reading, and is cheaper on texels, which are fewer than samples.
        let injected = self.mlp.features.forward(self.encoder.features(&sources.views, &self.device()));
        Self { encoded: Some(EncodedSources { injected, sources: sources.clone() }), ..self.clone() }
    }
}

/// Returns where the feature maps of `views` are read for pixel positions `(view, x, y)`.
fn taps(pixels: &[(usize, f32, f32)], views: &[SourceView]) -> Taps {
    let (height, width) = ImageEncoder::map_size(&views[0]);
    // Output j of the stem is centred on input pixel 2j, and pixel i has its centre at i + 0.5.
    let texel = |at: f32| (at - 0.5) / encoder::STEM_STRIDE as f32;
    Taps::new(pixels.iter().map(|&(view, x, y)| (view, texel(x), texel(y))), height, width)
}
