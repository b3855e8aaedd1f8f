//! Pixels of a step: of training images and of unseen poses.

use std::sync::Arc;

use glam::{DMat4, DVec3};
use infonerf_render::{Noise, RandomStream};
use infonerf_scene::{Camera, PixelAt, Ray, Scene, ViewRegion, near_pose, resized_dimensions};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::config::{NeighbourConfig, TrainConfig, Unseen};

/// Pixels with the cameras that see them.
#[derive(Clone, Debug)]
pub struct Pixels {
    /// Cameras that see the pixels.
    pub cameras: Arc<[Camera]>,
    /// Index of each pixel's camera, and the position of the pixel's centre in its image, pixels of the full size.
    pub at: Vec<PixelAt>,
    /// Width of a pixel, in pixels of the cameras; above 1 for downscaled images.
    pub width: f32,
}

impl Pixels {
    /// Draws `rays` pixels of `camera` in step `step`, each `width` pixels of the full size wide.
    pub(crate) fn draw(
        camera: Camera,
        rays: usize,
        width: f32,
        config: &TrainConfig,
        step: usize,
        noise: Noise,
    ) -> Self {
        let [column, row] = [RandomStream::Column, RandomStream::Row].map(|stream| noise.child(stream));
        let [(left, columns), (top, rows)] = [camera.width, camera.height].map(|size| crop(config, step, size));
        let at = |i| {
            let (x, y) = (left + column.below(i, 0, columns), top + row.below(i, 0, rows));
            PixelAt { view: 0, x: x as f32 + 0.5, y: y as f32 + 0.5 }
        };
        Self { at: (0..rays).map(at).collect(), cameras: [camera].into(), width }
    }

    pub(crate) fn rays(&self) -> Vec<Ray> {
        let ray = |&PixelAt { view, x, y }: &PixelAt| self.cameras[view].ray(x, y).widened(self.width);
        self.at.iter().map(ray).collect()
    }

    /// Returns the rays of the same pixels after the cameras are rotated by `rotation`.
    pub(crate) fn neighbours(&self, rotation: DMat4, config: &NeighbourConfig, region: &ViewRegion) -> Vec<Ray> {
        let centre = config.about.of(region);
        let turned = |camera: &Camera| {
            let there = DMat4::from_translation(-centre) * camera.to_world;
            camera.with_pose(DMat4::from_translation(centre) * (rotation * there))
        };
        self.seen_by(self.cameras.iter().map(turned).collect()).rays()
    }

    pub(crate) fn seen_by(&self, cameras: Arc<[Camera]>) -> Self {
        Self { cameras, ..self.clone() }
    }
}

/// Returns the first and the number of columns (or rows) that are drawn from: the central half until `train.precrop_steps`.
pub(crate) fn crop(config: &TrainConfig, step: usize, size: u32) -> (usize, usize) {
    let (first, count) = if step < config.precrop_steps { central_half(size) } else { (0, size) };
    (first as usize, count as usize)
}

/// Returns the first of the central half of `size` columns or rows, and their number.
pub(crate) fn central_half(size: u32) -> (u32, u32) {
    (size / 4, (size / 2).max(1))
}

/// Returns the rotation from a step's cameras to those of neighbouring rays, the same for all rays.
pub(crate) fn rotation(config: &NeighbourConfig, noise: Noise) -> DMat4 {
    near_pose(&DMat4::IDENTITY, DVec3::ZERO, &mut generator(noise), config.max_angle_deg)
}

/// Draws an unseen pose, and returns its camera.
pub(crate) fn unseen_camera(scene: &Scene, region: &ViewRegion, config: &TrainConfig, noise: Noise) -> Camera {
    let noise = noise.child(RandomStream::Pose);
    match config.unseen {
        Unseen::Sphere => scene.train[0].camera.with_pose(region.sample(&mut generator(noise))),
        Unseen::Dataset => scene.all_train_cameras[noise.below(0, 0, scene.all_train_cameras.len())].clone(),
    }
}

/// Returns every ray of a small image from `camera`, with its height and width: the longer side has `size` pixels.
pub(crate) fn image_rays(camera: &Camera, size: u32) -> (Vec<Ray>, (usize, usize)) {
    let (width, height) = resized_dimensions(camera.width, camera.height, size);
    let camera = camera.resized(width, height);
    let row = |y: u32| (0..width).map(move |x| (x as f32 + 0.5, y as f32 + 0.5));
    let rays = (0..height).flat_map(row).map(|(x, y)| camera.ray(x, y)).collect();
    (rays, (height as usize, width as usize))
}

pub(crate) fn generator(noise: Noise) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(noise.bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Config, Preset, RotationCentre};
    use crate::testing::knot;

    /// Checks that neighbouring rays of a capture far from the origin start near the capture.
    #[test]
    fn neighbours_turn_about_the_scene() {
        let mut scene = knot(2, 16);
        let distance = infonerf_render::Pivot::of(&scene).scale;
        assert!((distance - 4.031).abs() < 1e-3, "{distance}");
        let shift = DVec3::new(1000.0, 0.0, 0.0);
        for view in &mut scene.train {
            view.camera.to_world = DMat4::from_translation(shift) * view.camera.to_world;
        }
        let cameras = scene.training_cameras();
        let region = ViewRegion::new(&cameras);
        let pixels = Pixels { at: vec![PixelAt { view: 0, x: 8.0, y: 8.0 }], width: 1.0, cameras: cameras.into() };
        let mut config = Config::from_table(Preset::Paper.table()).unwrap().train.neighbours;
        let noise = Noise::new(0, 0, RandomStream::Neighbours);
        let distances = [RotationCentre::Centre, RotationCentre::Origin].map(|about| {
            config.about = about;
            let near = pixels.neighbours(rotation(&config, noise), &config, &region);
            near[0].origin.distance(pixels.rays()[0].origin)
        });
        // The cameras are 4 units from the scene's centre, and 15° move one by at most about 1.
        assert!(distances[0] < 1.1 && distances[0] > 0.0, "{distances:?}");
        assert!(distances[1] > 10.0, "{distances:?}");
    }

    #[test]
    fn unseen_rays_are_cropped_like_seen_ones() {
        let scene = knot(2, 16);
        let config = Config::of(Preset::Paper, ["train.precrop_steps=10"]).unwrap().train;
        let camera = &scene.train[0].camera;
        let within = |step: usize| {
            let noise = Noise::new(0, step as u64, RandomStream::UnseenRays);
            let pixels = Pixels::draw(camera.clone(), 200, 1.0, &config, step, noise);
            pixels.at.iter().all(|at| (4.0..12.0).contains(&at.x) && (4.0..12.0).contains(&at.y))
        };
        assert!(within(9) && !within(10));
    }

    #[test]
    fn unseen_poses_of_a_data_set_are_those_of_its_training_images() {
        let scene = knot(2, 16);
        let config = Config::of(Preset::Paper, ["train.unseen=dataset"]).unwrap().train;
        let region = ViewRegion::new(&scene.training_cameras());
        for step in 0..5 {
            let noise = Noise::new(0, step, RandomStream::UnseenRays);
            assert!(scene.all_train_cameras.contains(&unseen_camera(&scene, &region, &config, noise)));
        }
    }

    #[test]
    fn small_images_have_a_ray_per_pixel() {
        let wide = knot(1, 16).train[0].camera.resized(16, 8);
        let (rays, size) = image_rays(&wide, 8);
        assert_eq!((rays.len(), size), (32, (4, 8)));
        assert_eq!(rays[9], wide.resized(8, 4).ray(1.5, 1.5), "the second ray of the second row");
    }
}
