//! The training images, and the pixels of them that a step learns from.

use infonerf_loss::is_foreground;
use infonerf_render::{Noise, RandomStream};
use infonerf_scene::{Camera, Image, PixelAt, Scene};
use infonerf_schedule::Moment;

use crate::config::{Batch, TrainConfig};
use crate::error_sampling::PixelErrors;
use crate::pixels::{Pixels, crop, generator};

/// Pixels of training images, with what they show.
#[derive(Clone, Debug)]
pub struct SeenPixels {
    /// The pixels.
    pub pixels: Pixels,
    /// Colour and alpha of each.
    pub rgba: Vec<[f32; 4]>,
    /// Share of the 3 × 3 pixels about each that do not show the background.
    pub coverage: Vec<f32>,
    /// Index of each among all pixels of the training images, for error-driven sampling.
    pub indices: Vec<usize>,
    /// Draws that were passed over because the pixel is well fitted.
    pub rejected: u64,
}

/// The training images of a scene at every size that a run uses.
#[derive(Clone, Debug)]
pub(crate) struct TrainingImages {
    cameras: Vec<Camera>,
    /// Full size first.
    sizes: Vec<Images>,
}

/// Training images at one size.
#[derive(Clone, Debug)]
pub(crate) struct Images {
    /// How much smaller than at full size.
    factor: u32,
    width: u32,
    height: u32,
    /// Colour and alpha of each pixel of each view; alpha is 1 where the view has none.
    rgba: Vec<Vec<[f32; 4]>>,
    /// Share of the 3 × 3 pixels about each that do not show the background, of each view.
    coverage: Vec<Vec<f32>>,
}

impl TrainConfig {
    /// By which factor images are smaller at a moment of the run.
    pub(crate) fn downscale_at(&self, at: Moment) -> u32 {
        self.downscale.at(at).round().max(1.0) as u32
    }
}

impl TrainingImages {
    /// Images of `scene` at full size, and box-filtered by each factor that `config` asks for.
    pub(crate) fn new(scene: &Scene, config: &TrainConfig) -> Self {
        let (width, height) = (scene.train[0].image.width, scene.train[0].image.height);
        // Every whole factor between the extremes: all of them together are smaller than the images themselves.
        let (least, largest) = (config.downscale.least().round() as u32, config.downscale.largest().round() as u32);
        let factors = (least.max(2)..=largest).filter(|&factor| factor <= width.min(height));
        let sizes = std::iter::once(1)
            .chain(factors)
            .map(|factor| {
                let (width, height) = (width / factor, height / factor);
                let rgba: Vec<_> = scene.train.iter().map(|view| downscaled(&view.image, factor)).collect();
                let coverage = rgba.iter().map(|pixels| coverage(pixels, width, scene.background)).collect();
                Images { factor, width, height, rgba, coverage }
            })
            .collect();
        Self { cameras: scene.train.iter().map(|view| view.camera.clone()).collect(), sizes }
    }

    /// The images that a run learns from at a moment; at full size where none is so small.
    pub(crate) fn at(&self, config: &TrainConfig, at: Moment) -> &Images {
        let factor = config.downscale_at(at);
        self.sizes.iter().find(|images| images.factor == factor).unwrap_or(&self.sizes[0])
    }

    /// `rays` pixels for the step at `at`; of well-fitted ones fewer, if `config` says so.
    pub(crate) fn draw(
        &self,
        config: &TrainConfig,
        rays: usize,
        at: Moment,
        noise: Noise,
        errors: &PixelErrors,
    ) -> SeenPixels {
        let images = self.at(config, at);
        let (indices, rejected) = images.indices(config, rays, at.step, noise, errors);
        let (stride, area) = (images.width as usize, images.area());
        let scale = images.pixel_width();
        let position = |&index: &usize| {
            let (x, y) = ((index % area) % stride, (index % area) / stride);
            PixelAt { view: index / area, x: (x as f32 + 0.5) * scale, y: (y as f32 + 0.5) * scale }
        };
        let pixels = Pixels { cameras: self.cameras.clone(), at: indices.iter().map(position).collect(), width: scale };
        let rgba = indices.iter().map(|index| images.rgba[index / area][index % area]).collect();
        let coverage = indices.iter().map(|index| images.coverage[index / area][index % area]).collect();
        SeenPixels { pixels, rgba, coverage, indices, rejected }
    }
}

impl Images {
    /// How wide their pixels are, in pixels of the full size.
    pub(crate) fn pixel_width(&self) -> f32 {
        self.factor as f32
    }

    /// Whether they have the full size.
    pub(crate) fn is_full_size(&self) -> bool {
        self.factor == 1
    }

    /// How much smaller they are, and how many pixels all views have.
    pub(crate) fn size(&self) -> (u32, usize) {
        (self.factor, self.area() * self.rgba.len())
    }

    fn area(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Indices of `rays` pixels, and how many draws were rejected.
    fn indices(
        &self,
        config: &TrainConfig,
        rays: usize,
        step: usize,
        noise: Noise,
        errors: &PixelErrors,
    ) -> (Vec<usize>, u64) {
        let ((left, columns), (top, rows)) = (crop(config, step, self.width), crop(config, step, self.height));
        let (stride, area) = (self.width as usize, self.area());
        let [view, column, row, acceptance] =
            [RandomStream::View, RandomStream::Column, RandomStream::Row, RandomStream::Acceptance]
                .map(|stream| noise.child(stream));
        let sampling = config.error_sampling.is_on().then_some(&config.error_sampling);
        match config.batch {
            Batch::Pixels => {
                let draw = |ray: usize, k: usize| {
                    let x = left as usize + column.below(ray, k, columns as usize);
                    let y = top as usize + row.below(ray, k, rows as usize);
                    view.below(ray, k, self.rgba.len()) * area + y * stride + x
                };
                let mut rejected = 0;
                let choose = |ray| match sampling {
                    None => draw(ray, 0),
                    Some(sampling) => {
                        let (index, passed) = errors.choose(sampling, ray, acceptance, |k| draw(ray, k));
                        rejected += passed as u64;
                        index
                    }
                };
                ((0..rays).map(choose).collect(), rejected)
            }
            Batch::Image | Batch::HeldOut => {
                let image = view.below(0, 0, self.rgba.len());
                let pixels = columns as usize * rows as usize;
                let candidates = if sampling.is_some() { PixelErrors::DRAWS * rays } else { rays };
                let drawn: Vec<usize> =
                    rand::seq::index::sample(&mut generator(column), pixels, candidates.min(pixels))
                        .into_iter()
                        .map(|pixel| (left + pixel as u32 % columns, top + pixel as u32 / columns))
                        .map(|(x, y)| image * area + y as usize * stride + x as usize)
                        .collect();
                match sampling {
                    None => (drawn, 0),
                    Some(sampling) => errors.among(sampling, acceptance, &drawn, rays.min(pixels)),
                }
            }
        }
    }
}

/// Means over squares of `factor` × `factor` pixels; what is left at the right and lower edges is cut off.
fn downscaled(image: &Image, factor: u32) -> Vec<[f32; 4]> {
    let share = 1.0 / (factor * factor) as f32;
    let square = |x: u32, y: u32| {
        let mut sum = [0.0; 4];
        for (dx, dy) in (0..factor).flat_map(|dy| (0..factor).map(move |dx| (dx, dy))) {
            let at = ((y * factor + dy) * image.width + x * factor + dx) as usize;
            let [red, green, blue] = image.rgb[at];
            let alpha = image.alpha.as_ref().map_or(1.0, |alpha| alpha[at]);
            for (sum, value) in sum.iter_mut().zip([red, green, blue, alpha]) {
                *sum += value * share;
            }
        }
        sum
    };
    let (width, height) = (image.width / factor, image.height / factor);
    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| square(x, y)).collect()
}

/// Share of the 3 × 3 pixels about each, less at the border of the image, that do not show `background`: 0 in the open, 1
/// within an object, between the two at its edge, whose pixels are mixtures.
fn coverage(rgba: &[[f32; 4]], width: u32, background: [f32; 3]) -> Vec<f32> {
    let (width, height) = (width as usize, rgba.len() / width as usize);
    let foreground: Vec<bool> = rgba.iter().map(|&pixel| is_foreground(pixel, background)).collect();
    let share = |x: usize, y: usize| {
        let columns = x.saturating_sub(1)..(x + 2).min(width);
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let area = (columns.len() * rows.len()) as f32;
        let shown = rows.flat_map(|y| columns.clone().map(move |x| (x, y))).filter(|(x, y)| foreground[y * width + x]);
        shown.count() as f32 / area
    };
    (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| share(x, y)).collect()
}

#[cfg(test)]
mod tests {
    use infonerf_scene::{SceneRequest, ViewRegion, ViewSelection};

    use super::*;
    use crate::pixels::{UnseenViews, turn};
    use crate::{Config, Preset};

    #[test]
    fn coverage_falls_at_the_edge_of_an_object() {
        let (white, red) = ([1.0; 4], [1.0, 0.0, 0.0, 1.0]);
        let columns = [white, red, red, red, white, white];
        let rgba: Vec<[f32; 4]> = (0..3).flat_map(|_| columns).collect();
        let found = coverage(&rgba, 6, [1.0; 3]);
        let want = [1.0 / 2.0, 2.0 / 3.0, 1.0, 2.0 / 3.0, 1.0 / 3.0, 0.0];
        assert_eq!(found, want.repeat(3));
    }

    /// Cones of all kinds of rays are as wide as the pixels of the images that a step learns from.
    #[test]
    fn smaller_images_have_wider_cones() {
        let request = SceneRequest {
            train: ViewSelection::Seed { seed: 0, count: 2 },
            image_size: Some(16),
            ..SceneRequest::default()
        };
        let scene = infonerf_procedural::load("knot", &request).unwrap();
        let mut table = Preset::Paper.table();
        crate::config::assign(&mut table, "train.downscale={steps=[[0.0,4],[0.25,2],[0.5,50],[0.75,1]]}").unwrap();
        let config = Config::from_table(table).unwrap().train;
        let images = TrainingImages::new(&scene, &config);
        let cameras: Vec<Camera> = scene.train.iter().map(|view| view.camera.clone()).collect();
        let region = ViewRegion::new(&cameras);
        let unseen = UnseenViews { scene: &scene, region: &region, config: &config };
        let noise = Noise::new(0, 0, RandomStream::SeenRays);
        let centre = cameras[0].ray(8.0, 8.0).radius;
        // No image is 50 times smaller: the full size is used.
        for (progress, width) in [(0.1, 4.0), (0.3, 2.0), (0.6, 1.0), (1.0, 1.0)] {
            let at = Moment { step: 0, progress };
            assert_eq!(images.at(&config, at).pixel_width(), width);
            let seen = images.draw(&config, 8, at, noise, &PixelErrors::default()).pixels;
            let near = seen.neighbours(turn(&config.neighbours, noise), &config.neighbours, &region);
            for ray in [seen.rays(), near, unseen.pixels(8, width, 0, noise).rays()].concat() {
                let ratio = ray.radius / centre;
                assert!(ratio > 0.8 * width && ratio <= 1.0001 * width, "{ratio} at {progress}");
            }
        }
    }
}
