//! Which rays a step looks at. Every choice is a pure function of (seed, step), so that a resumed run sees the same rays.

use infonerf_render::Noise;
use infonerf_scene::{Camera, Image, Ray, Scene, ViewRegion, near_pose};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::config::{Batch, TrainConfig, Unseen};

/// Pixels with the cameras that see them.
#[derive(Clone, Debug)]
pub(crate) struct Pixels {
    cameras: Vec<Camera>,
    /// Camera, and where in its image, in pixels.
    at: Vec<(usize, f32, f32)>,
}

impl Pixels {
    pub(crate) fn rays(&self) -> Vec<Ray> {
        self.at.iter().map(|&(camera, x, y)| self.cameras[camera].ray(x, y)).collect()
    }

    /// The same pixels of cameras rotated about the world origin by up to `max_angle_deg`: one draw for all.
    pub(crate) fn near(&self, noise: Noise, max_angle_deg: f64) -> Vec<Ray> {
        // The same generator for each camera: one rotation a step.
        let turned =
            |camera: &Camera| camera.with_pose(near_pose(&camera.to_world, &mut generator(noise), max_angle_deg));
        Self { cameras: self.cameras.iter().map(turned).collect(), at: self.at.clone() }.rays()
    }
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

    /// `rays` pixels of training images with their colours and alphas.
    pub(crate) fn seen(
        &self,
        config: &TrainConfig,
        rays: usize,
        step: usize,
        progress: f64,
        noise: Noise,
    ) -> (Pixels, Vec<[f32; 4]>) {
        let [view, column, row] = [noise, noise.next(), noise.next().next()];
        let factor = config.factor_at(progress);
        let images = self.levels.iter().find(|images| images.factor == factor).unwrap_or(&self.levels[0]);
        let window = |size: u32| if step < config.center_steps { (size / 4, (size / 2).max(1)) } else { (0, size) };
        let ((left, columns), (top, rows)) = (window(images.width), window(images.height));
        let at: Vec<(usize, u32, u32)> = match config.batch {
            Batch::Pixels => (0..rays)
                .map(|i| {
                    let x = left + column.below(i, 0, columns as usize) as u32;
                    let y = top + row.below(i, 0, rows as usize) as u32;
                    (view.below(i, 0, images.rgba.len()), x, y)
                })
                .collect(),
            Batch::Image => {
                let image = view.below(0, 0, images.rgba.len());
                let pixels = columns as usize * rows as usize;
                rand::seq::index::sample(&mut generator(column), pixels, rays.min(pixels))
                    .into_iter()
                    .map(|pixel| (image, left + pixel as u32 % columns, top + pixel as u32 / columns))
                    .collect()
            }
        };
        let colors = at.iter().map(|&(view, x, y)| images.rgba[view][(y * images.width + x) as usize]).collect();
        let scale = images.factor as f32;
        let at = at.iter().map(|&(view, x, y)| (view, (x as f32 + 0.5) * scale, (y as f32 + 0.5) * scale)).collect();
        (Pixels { cameras: self.cameras.clone(), at }, colors)
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

/// `rays` pixels of one unseen pose.
pub(crate) fn unseen(scene: &Scene, region: &ViewRegion, config: &TrainConfig, rays: usize, noise: Noise) -> Pixels {
    let [pose, column, row] = [noise, noise.next(), noise.next().next()];
    let camera = match config.unseen {
        Unseen::Sphere => scene.train[0].camera.with_pose(region.sample(&mut generator(pose))),
        Unseen::Dataset => scene.all_train_cameras[pose.below(0, 0, scene.all_train_cameras.len())].clone(),
    };
    let (width, height) = (camera.width as usize, camera.height as usize);
    let at =
        (0..rays).map(|i| (0, column.below(i, 0, width) as f32 + 0.5, row.below(i, 0, height) as f32 + 0.5)).collect();
    Pixels { cameras: vec![camera], at }
}

pub(crate) fn generator(noise: Noise) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(noise.bits())
}
