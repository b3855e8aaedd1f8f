//! LPIPS, version 0.1 (Zhang, Isola, Efros, Shechtman, Wang 2018): how different two pictures look.

mod config;
mod difference;

pub use config::LpipsConfig;

use std::path::Path;

use burn::tensor::Device;
use infonerf_metrics::protocol::LpipsInput;
use infonerf_metrics::{Picture, PictureDistance, Protocol};

use crate::file::Named;
use crate::maps::{Convolution, Maps, Window, max_pool};
use config::Placed;
use difference::difference;

/// Mean and standard deviation of each channel, for pictures in [−1, 1].
const SHIFT: [f32; 3] = [-0.030, -0.088, -0.188];
const SCALE: [f32; 3] = [0.458, 0.448, 0.450];
/// Pixels that a device other than the host works on at a time, of renders and truths each.
const BATCH_PIXELS: usize = 640_000;

/// The learned perceptual distance
///
/// `d(x, y) = Σ_l mean_hw Σ_c w_lc (x̂_lhwc − ŷ_lhwc)²`
///
/// with the features of layer l of a backbone, each pixel's of unit length, `x̂ = x / (‖x‖ + 1e-10)`, and a learned weight
/// `w` per channel. Weights are fixed, and there is no gradient.
pub struct Lpips {
    config: LpipsConfig,
    layers: Vec<Stage>,
    device: Device,
}

enum Stage {
    /// A convolution, and the weights `w` if pictures are compared behind it.
    Convolution(Convolution, Option<Vec<f32>>),
    Pool(Window),
}

impl Lpips {
    /// Reads the backbone (torchvision's `features`) and the heads (of the `lpips` package) from a weight file each.
    ///
    /// # Errors
    /// One line that names the file, and the tensor which is missing or has another shape.
    pub fn read(backbone: &Path, heads: &Path, config: LpipsConfig, device: &Device) -> Result<Self, String> {
        let device = device.clone().inner();
        let backbone = Named::open(backbone)?;
        let heads = Named::open(heads)?;
        let stage = |layer: Placed| match layer {
            Placed::Pool(window) => Ok(Stage::Pool(window)),
            Placed::Convolution(convolution) => {
                let [weight, bias] = convolution.tensors().map(|tensor| backbone.floats(&tensor));
                let numbers = (weight?, bias?);
                let head = convolution.head_tensor().map(|tensor| heads.floats(&tensor)).transpose()?;
                Ok(Stage::Convolution(
                    Convolution::new(convolution.window, convolution.channels, numbers, &device),
                    head,
                ))
            }
        };
        let layers = config.placed().map(stage).collect::<Result<_, String>>()?;
        Ok(Self { config, layers, device })
    }

    /// The distance of each pair of pictures. The host works on one pair at a time, other devices on as many of the same
    /// size as fit in a batch; it takes about 1 KiB of memory per pixel with VGG-16.
    ///
    /// # Errors
    /// One line if the pictures of a pair differ in size, or are too small for the backbone.
    pub fn distances(&self, pairs: &[(&Picture, &Picture)], input: LpipsInput) -> Result<Vec<f64>, String> {
        for (render, truth) in pairs {
            let [width, height] = truth.size();
            if render.size() != truth.size() {
                return Err(format!(
                    "pictures of {:?} and {:?} pixels cannot be compared",
                    render.size(),
                    truth.size()
                ));
            }
            if !self.config.fits([height, width]) {
                return Err(format!("{width}×{height} pixels are too few for its convolutions"));
            }
        }
        let same_size = pairs.chunk_by(|(one, _), (other, _)| one.size() == other.size());
        let batches = same_size.flat_map(|pairs| pairs.chunks(self.batch(pairs[0].0)));
        Ok(batches.flat_map(|batch| self.of_batch(batch, input)).collect())
    }

    fn batch(&self, picture: &Picture) -> usize {
        let on_host = infonerf_ops::has_host_kernels(&self.device);
        if on_host { 1 } else { (BATCH_PIXELS / picture.pixels().len()).max(1) }
    }

    /// The same of pictures of one size, in one pass.
    fn of_batch(&self, pairs: &[(&Picture, &Picture)], input: LpipsInput) -> Vec<f64> {
        let renders = pairs.iter().map(|(render, _)| *render);
        let truths = pairs.iter().map(|(_, truth)| *truth);
        let mut maps = self.input(renders.chain(truths), input);
        let mut distances = vec![0.0; pairs.len()];
        for layer in &self.layers {
            match layer {
                Stage::Pool(window) => maps = max_pool(&maps, *window),
                Stage::Convolution(convolution, weights) => {
                    maps = convolution.forward(&maps);
                    if let Some(weights) = weights {
                        let differences = difference(&maps, weights);
                        distances.iter_mut().zip(differences).for_each(|(sum, difference)| *sum += difference);
                    }
                }
            }
        }
        distances
    }

    /// Pictures with each channel shifted and scaled to what the backbone was trained on.
    fn input<'a>(&self, pictures: impl Iterator<Item = &'a Picture>, input: LpipsInput) -> Maps {
        let (mut values, mut count, mut size) = (Vec::new(), 0, [0; 2]);
        for picture in pictures {
            for pixel in picture.pixels() {
                let value = |channel: usize| {
                    let value = if input == LpipsInput::Signed { 2.0 * pixel[channel] - 1.0 } else { pixel[channel] };
                    (value - SHIFT[channel]) / SCALE[channel]
                };
                values.extend([value(0), value(1), value(2)]);
            }
            (count, size) = (count + 1, picture.size());
        }
        Maps::new(values, [count, size[1], size[0], 3], &self.device)
    }
}

impl PictureDistance for Lpips {
    fn distance(&self, render: &Picture, truth: &Picture, protocol: &Protocol) -> Result<f64, String> {
        Ok(self.distances(&[(render, truth)], protocol.lpips_input)?[0])
    }
}
