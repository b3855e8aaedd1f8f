//! Which rays a step looks at. Every choice is a pure function of (seed, step), so that a resumed run sees the same rays.

use infonerf_render::Noise;
use infonerf_scene::{Camera, Ray, Scene, ViewRegion, near_pose};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::config::{Batch, TrainConfig, Unseen};

/// Pixels with the cameras that see them.
#[derive(Clone, Debug)]
pub(crate) struct Pixels {
    cameras: Vec<Camera>,
    /// Camera, column and row of each pixel.
    at: Vec<(usize, u32, u32)>,
}

impl Pixels {
    pub(crate) fn rays(&self) -> Vec<Ray> {
        self.at.iter().map(|&(camera, x, y)| self.cameras[camera].ray(x as f32 + 0.5, y as f32 + 0.5)).collect()
    }

    /// The same pixels of cameras rotated about the world origin by up to `max_angle_deg`: one draw for all.
    pub(crate) fn near(&self, noise: Noise, max_angle_deg: f64) -> Vec<Ray> {
        let cameras = self
            .cameras
            .iter()
            .map(|camera| {
                // The same generator for each camera: one rotation a step.
                let mut rng = generator(noise);
                camera.with_pose(near_pose(&camera.to_world, &mut rng, max_angle_deg))
            })
            .collect();
        Self { cameras, at: self.at.clone() }.rays()
    }
}

/// Pixels of training images with their colours, `[R, 3]` row-major.
pub(crate) fn seen(scene: &Scene, config: &TrainConfig, step: usize, noise: Noise) -> (Pixels, Vec<f32>) {
    let [view, column, row] = [noise, noise.next(), noise.next().next()];
    let (width, height) = (scene.train[0].image.width, scene.train[0].image.height);
    let window = |size: u32| if step < config.center_steps { (size / 4, (size / 2).max(1)) } else { (0, size) };
    let ((left, columns), (top, rows)) = (window(width), window(height));
    let at: Vec<(usize, u32, u32)> = match config.batch {
        Batch::Pixels => (0..config.rays)
            .map(|i| {
                let x = left + column.below(i, 0, columns as usize) as u32;
                let y = top + row.below(i, 0, rows as usize) as u32;
                (view.below(i, 0, scene.train.len()), x, y)
            })
            .collect(),
        Batch::Image => {
            let image = view.below(0, 0, scene.train.len());
            let pixels = columns as usize * rows as usize;
            let count = config.rays.min(pixels);
            rand::seq::index::sample(&mut generator(column), pixels, count)
                .into_iter()
                .map(|pixel| (image, left + pixel as u32 % columns, top + pixel as u32 / columns))
                .collect()
        }
    };
    let colors = at
        .iter()
        .flat_map(|&(view, x, y)| scene.train[view].image.rgb[(y * width + x) as usize])
        .collect();
    (Pixels { cameras: scene.train.iter().map(|view| view.camera.clone()).collect(), at }, colors)
}

/// Pixels of one unseen pose.
pub(crate) fn unseen(scene: &Scene, region: &ViewRegion, config: &TrainConfig, noise: Noise) -> Pixels {
    let [pose, column, row] = [noise, noise.next(), noise.next().next()];
    let camera = match config.unseen {
        Unseen::Sphere => scene.train[0].camera.with_pose(region.sample(&mut generator(pose))),
        Unseen::Dataset => scene.all_train_cameras[pose.below(0, 0, scene.all_train_cameras.len())].clone(),
    };
    let at = (0..config.unseen_rays)
        .map(|i| {
            let x = column.below(i, 0, camera.width as usize) as u32;
            (0, x, row.below(i, 0, camera.height as usize) as u32)
        })
        .collect();
    Pixels { cameras: vec![camera], at }
}

pub(crate) fn generator(noise: Noise) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(noise.bits())
}
