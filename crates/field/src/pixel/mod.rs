//! PixelNeRF (Yu et al. 2021): a field that is conditioned on photographs.

mod encoder;
mod mlp;
mod project;
mod resnet34;

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData, activation::sigmoid};
use infonerf_ops::bilinear::{Taps, bilinear};
use infonerf_ops::frequency::{encoded_width, frequency_encode};
use rand::Rng;

use crate::{ConfigError, PixelNerfConfig, Points, Sampled, SourceView, Sources};
use encoder::Encoder;
use mlp::ResnetMlp;
use project::{ViewPoints, view_points};

/// Pixel-aligned features of each source view → ResNet MLP, views averaged on the way → density and colour.
///
/// A point is projected into every source view, and asked of the MLP in that view's own axes together with the features
/// at its pixel. Weights are shared by all views and all scenes: what is learned on some scenes serves another.
#[derive(Module, Debug)]
pub struct PixelNerf {
    encoder: Encoder,
    mlp: ResnetMlp,
    /// What the source views show; none before the field is [conditioned](crate::RadianceField::conditioned).
    seen: Option<Seen>,
    #[module(skip)]
    config: PixelNerfConfig,
}

/// Source views with what the MLP reads of them.
#[derive(Module, Debug)]
struct Seen {
    /// Layers that read features, applied to each texel of each view: `[V·h·w, pool_after·width]`.
    injected: Tensor<2>,
    #[module(skip)]
    sources: Sources,
}

impl PixelNerf {
    /// # Errors
    /// If a file of weights is asked for and cannot be used.
    pub(crate) fn new(config: &PixelNerfConfig, rng: &mut impl Rng, device: &Device) -> Result<Self, ConfigError> {
        let mut encoder = Encoder::new(&config.encoder, rng, device);
        if !config.encoder.weights.as_os_str().is_empty() {
            encoder = resnet34::load(encoder, &config.encoder.weights)?;
        }
        let inputs = encoded_width(3, config.octaves) + 3;
        let mlp = ResnetMlp::new(config, inputs, encoder.channels(), rng, device);
        Ok(Self { encoder, mlp, seen: None, config: config.clone() })
    }

    pub(crate) fn conditioned(&self, sources: &Sources) -> Self {
        // A linear layer and bilinear reading commute: weighting texels, of which there are fewer than samples, is cheaper.
        let injected = self.mlp.inject(self.encoder.features(&sources.views, &self.device()));
        Self { seen: Some(Seen { injected, sources: sources.clone() }), ..self.clone() }
    }

    /// The encoder's features where each of `views` sees each of `positions` (`[M, 3]` row-major): `[V·M, C]`, view by
    /// view. Points outside an image read its border.
    pub fn pixel_aligned(&self, views: &[SourceView], positions: &[f32]) -> Tensor<2> {
        let device = self.device();
        bilinear(self.encoder.features(views, &device), &taps(&project::pixels(views, positions), views))
    }

    pub(crate) fn evaluate(&self, points: Points<'_>, color: bool) -> Sampled {
        let device = self.device();
        let seen = self.seen.as_ref().expect("a PixelNeRF is conditioned on photographs before it is asked");
        let (views, samples) = (&seen.sources.views[..], points.positions.len() / 3);
        let middle = seen.sources.middle;
        let ViewPoints { positions, directions } = view_points(views, points, middle, self.config.frequency);
        let directions = Tensor::from_data(TensorData::new(directions, [views.len() * samples, 3]), &device);
        let encoded = frequency_encode(&positions, 3, self.config.octaves, &[], &device);
        let injected = bilinear(seen.injected.clone(), &taps(&project::pixels(views, points.positions), views));
        let out = self.mlp.forward(Tensor::cat(vec![encoded, directions], 1), injected, views.len());
        let raw = out.clone().narrow(1, 3, 1).reshape([samples]);
        Sampled { sigma: self.config.density.apply(raw), color: color.then(|| sigmoid(out.narrow(1, 0, 3))) }
    }

    pub(crate) fn device(&self) -> Device {
        self.mlp.device()
    }
}

/// Where the feature maps of `views` are read for pixel positions `(view, x, y)`.
fn taps(pixels: &[(usize, f32, f32)], views: &[SourceView]) -> Taps {
    let (height, width) = Encoder::map_size(&views[0]);
    // Output j of the stem is centred on input pixel 2j, and pixel i has its centre at i + 0.5.
    let texel = |at: f32| (at - 0.5) / encoder::STEM_STRIDE as f32;
    Taps::new(pixels.iter().map(|&(view, x, y)| (view, texel(x), texel(y))), height, width)
}
