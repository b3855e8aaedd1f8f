//! Which rays a step looks at. Every choice is a pure function of (seed, step), so that a resumed run sees the same rays.

use infonerf_render::Noise;
use infonerf_scene::{Camera, Image, Ray, Scene, ViewRegion, near_pose, resized_dimensions};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::config::{Batch, TrainConfig, Unseen};
use crate::explained::{DRAWS, Explained};

/// Pixels with the cameras that see them.
#[derive(Clone, Debug)]
pub(crate) struct Pixels {
    cameras: Vec<Camera>,
    /// Camera, and where in its image, in pixels.
    at: Vec<(usize, f32, f32)>,
    /// How wide a pixel is, in pixels of the cameras: more than 1 for images that are smaller.
    width: f32,
}

impl Pixels {
    /// The view that the first pixel is of; that of all where a batch is of one image.
    pub(crate) fn view(&self) -> usize {
        self.at[0].0
    }

    pub(crate) fn rays(&self) -> Vec<Ray> {
        self.at.iter().map(|&(camera, x, y)| self.cameras[camera].ray(x, y).widened(self.width)).collect()
    }

    /// The same pixels of cameras rotated about the world origin by up to `max_angle_deg`: one draw for all.
    pub(crate) fn near(&self, noise: Noise, max_angle_deg: f64) -> Vec<Ray> {
        // The same generator for each camera: one rotation a step.
        let turned =
            |camera: &Camera| camera.with_pose(near_pose(&camera.to_world, &mut generator(noise), max_angle_deg));
        Self { cameras: self.cameras.iter().map(turned).collect(), ..self.clone() }.rays()
    }
}

/// Pixels of training images, with what they show.
#[derive(Clone, Debug)]
pub(crate) struct Seen {
    pub(crate) pixels: Pixels,
    /// Colour and alpha.
    pub(crate) colors: Vec<[f32; 4]>,
    /// Where [`Explained`] has each.
    pub(crate) places: Vec<usize>,
    /// Draws that were passed over because the pixel is explained.
    pub(crate) passed: u64,
}

/// Training images at one size.
#[derive(Clone, Debug)]
struct Images {
    factor: u32,
    width: u32,
    height: u32,
    /// Colour and alpha of each pixel of each view; alpha is 1 where the view has none.
    rgba: Vec<Vec<[f32; 4]>>,
}

/// Training images at every size that a run uses.
#[derive(Clone, Debug)]
pub(crate) struct Pyramid {
    cameras: Vec<Camera>,
    levels: Vec<Images>,
}

impl Pyramid {
    /// Images of `scene` at full size, and smaller by each factor of `config` (box-filtered, edges cut).
    pub(crate) fn new(scene: &Scene, config: &TrainConfig) -> Self {
        let (width, height) = (scene.train[0].image.width, scene.train[0].image.height);
        let factors = config.pyramid.iter().map(|(_, factor)| *factor).filter(|f| *f <= width.min(height));
        let levels = std::iter::once(1)
            .chain(factors)
            .map(|factor| Images {
                factor,
                width: width / factor,
                height: height / factor,
                rgba: scene.train.iter().map(|view| shrink(&view.image, factor)).collect(),
            })
            .collect();
        Self { cameras: scene.train.iter().map(|view| view.camera.clone()).collect(), levels }
    }

    /// The images of a run that is `progress` of the way.
    fn at(&self, config: &TrainConfig, progress: f64) -> &Images {
        let factor = config.factor_at(progress);
        self.levels.iter().find(|images| images.factor == factor).unwrap_or(&self.levels[0])
    }

    /// How wide their pixels are, in pixels of the full size.
    pub(crate) fn pixel_width(&self, config: &TrainConfig, progress: f64) -> f32 {
        self.at(config, progress).factor as f32
    }

    /// How much smaller the images of a step are, and how many pixels they have in all.
    pub(crate) fn size(&self, config: &TrainConfig, progress: f64) -> (u32, usize) {
        let images = self.at(config, progress);
        (images.factor, images.rgba.iter().map(Vec::len).sum())
    }

    /// `rays` pixels of training images, fewer of those that are `explained` if `config` says so.
    pub(crate) fn seen(
        &self,
        config: &TrainConfig,
        rays: usize,
        step: usize,
        progress: f64,
        noise: Noise,
        explained: &Explained,
    ) -> Seen {
        let [view, column, row] = [noise, noise.next(), noise.next().next()];
        let images = self.at(config, progress);
        let window = |size: u32| if step < config.center_steps { (size / 4, (size / 2).max(1)) } else { (0, size) };
        let ((left, columns), (top, rows)) = (window(images.width), window(images.height));
        let stride = images.width as usize;
        let area = stride * images.height as usize;
        let mut passed = 0;
        let places: Vec<usize> = match config.batch {
            Batch::Pixels => (0..rays)
                .map(|i| {
                    let draw = |k| {
                        let x = left as usize + column.below(i, k, columns as usize);
                        let y = top as usize + row.below(i, k, rows as usize);
                        view.below(i, k, images.rgba.len()) * area + y * stride + x
                    };
                    if !config.explained.is_on() {
                        return draw(0);
                    }
                    let (place, skipped) = explained.choose(&config.explained, i, row.next(), draw);
                    passed += skipped as u64;
                    place
                })
                .collect(),
            Batch::Image | Batch::HeldOut => {
                let image = view.below(0, 0, images.rgba.len());
                let pixels = columns as usize * rows as usize;
                let skips = config.explained.is_on();
                let candidates = if skips { DRAWS * rays } else { rays };
                let drawn: Vec<usize> =
                    rand::seq::index::sample(&mut generator(column), pixels, candidates.min(pixels))
                        .into_iter()
                        .map(|pixel| (left + pixel as u32 % columns, top + pixel as u32 / columns))
                        .map(|(x, y)| image * area + y as usize * stride + x as usize)
                        .collect();
                if skips {
                    let (places, skipped) = explained.among(&config.explained, row, &drawn, rays.min(pixels));
                    passed = skipped as u64;
                    places
                } else {
                    drawn
                }
            }
        };
        let colors = places.iter().map(|place| images.rgba[place / area][place % area]).collect();
        let scale = self.pixel_width(config, progress);
        let position = |&place: &usize| {
            let (x, y) = ((place % area) % stride, (place % area) / stride);
            (place / area, (x as f32 + 0.5) * scale, (y as f32 + 0.5) * scale)
        };
        let pixels = Pixels { cameras: self.cameras.clone(), at: places.iter().map(position).collect(), width: scale };
        Seen { pixels, colors, places, passed }
    }
}

/// Means over squares of `factor` × `factor` pixels.
fn shrink(image: &Image, factor: u32) -> Vec<[f32; 4]> {
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

/// `rays` pixels of one unseen pose, each `width` pixels of the full size wide.
pub(crate) fn unseen(
    scene: &Scene,
    region: &ViewRegion,
    config: &TrainConfig,
    rays: usize,
    width: f32,
    noise: Noise,
) -> Pixels {
    let [pose, column, row] = [noise, noise.next(), noise.next().next()];
    let camera = unseen_camera(scene, region, config, pose);
    let (columns, rows) = (camera.width as usize, camera.height as usize);
    let at =
        (0..rays).map(|i| (0, column.below(i, 0, columns) as f32 + 0.5, row.below(i, 0, rows) as f32 + 0.5)).collect();
    Pixels { cameras: vec![camera], at, width }
}

/// Every pixel of a small picture from an unseen pose, with its height and width: the longer side has `size` pixels.
pub(crate) fn unseen_picture(
    scene: &Scene,
    region: &ViewRegion,
    config: &TrainConfig,
    size: u32,
    noise: Noise,
) -> (Vec<Ray>, (usize, usize)) {
    let camera = unseen_camera(scene, region, config, noise);
    let (width, height) = resized_dimensions(camera.width, camera.height, size);
    let camera = camera.resized(width, height);
    let row = |y: u32| (0..width).map(move |x| (x as f32 + 0.5, y as f32 + 0.5));
    let rays = (0..height).flat_map(row).map(|(x, y)| camera.ray(x, y)).collect();
    (rays, (height as usize, width as usize))
}

fn unseen_camera(scene: &Scene, region: &ViewRegion, config: &TrainConfig, noise: Noise) -> Camera {
    match config.unseen {
        Unseen::Sphere => scene.train[0].camera.with_pose(region.sample(&mut generator(noise))),
        Unseen::Dataset => scene.all_train_cameras[noise.below(0, 0, scene.all_train_cameras.len())].clone(),
    }
}

pub(crate) fn generator(noise: Noise) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(noise.bits())
}

#[cfg(test)]
mod tests {
    use infonerf_scene::{SceneRequest, SceneSource, ViewSelection};

    use super::*;
    use crate::{Config, Preset};

    /// Cones of all kinds of rays are as wide as the pixels of the images that a step learns from.
    #[test]
    fn smaller_images_have_wider_cones() {
        let request = SceneRequest {
            train: ViewSelection::Seed { seed: 0, count: 2 },
            image_size: Some(16),
            ..SceneRequest::default()
        };
        let scene = infonerf_scene::load(&SceneSource::Procedural("knot".into()), &request).unwrap();
        let mut config = Config::from_table(Preset::Paper.table()).unwrap().train;
        config.pyramid = vec![(0.25, 4), (0.5, 2), (0.75, 100)];
        let pyramid = Pyramid::new(&scene, &config);
        let cameras: Vec<Camera> = scene.train.iter().map(|view| view.camera.clone()).collect();
        let (region, noise) = (ViewRegion::new(&cameras), Noise::new(0, 0, 0));
        let centre = cameras[0].ray(8.0, 8.0).radius;
        // No image is 100 times smaller: the full size is used.
        for (progress, width) in [(0.1, 4.0), (0.3, 2.0), (0.6, 1.0), (1.0, 1.0)] {
            assert_eq!(pyramid.pixel_width(&config, progress), width);
            let seen = pyramid.seen(&config, 8, 0, progress, noise, &Explained::default()).pixels;
            let unseen = unseen(&scene, &region, &config, 8, width, noise);
            for ray in [seen.rays(), seen.near(noise, 5.0), unseen.rays()].concat() {
                let ratio = ray.radius / centre;
                assert!(ratio > 0.8 * width && ratio <= 1.0001 * width, "{ratio} at {progress}");
            }
        }
    }
}
