//! Training pixels that a GPU draws: the same ones as the host draws, so that a step moves neither rays nor colours there.

use burn::tensor::Device;
use glam::{DMat4, Vec4};
use infonerf_ops::drawing::{DrawnViews, PixelDraw, PixelTables};
use infonerf_ops::from_host;
use infonerf_render::{Noise, OccupancyGrid, RandomStream, Renderer};
use infonerf_scene::{Camera, Ray, Scene};
use infonerf_schedule::Moment;

use crate::config::{Batch, TrainConfig, Unseen};
use crate::pixels::{Pixels, crop};
use crate::training_images::Images;

/// Most bytes of a table: what every GPU can read as one array (WebGPU's guaranteed binding size).
const LARGEST: usize = 128 << 20;

/// The pixels of a scene's training images at one size, on a device.
#[derive(Debug)]
pub(crate) struct DevicePixels {
    pub(crate) tables: PixelTables,
    /// How much smaller the images are than at full size.
    factor: u32,
    /// Width and height of the images.
    size: [usize; 2],
    /// The same at full size, of which unseen pixels are.
    full_size: [usize; 2],
    views: usize,
}

/// The number of samples along a ray that a GPU marches along, which does not tell: by the host's count of a step's rays, which
/// holds until the grid changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ExpectedSamples {
    pub(crate) per_ray: f64,
    /// Length of a step then.
    step_length: f32,
}

impl ExpectedSamples {
    /// Of `rays` in the step at `at`.
    pub(crate) fn count(renderer: &Renderer, rays: &[Ray], occupancy: Option<&OccupancyGrid>, at: Moment) -> Self {
        let per_ray = renderer.count_samples(rays, occupancy, at) as f64 / rays.len().max(1) as f64;
        Self { per_ray, step_length: renderer.step_length(at) }
    }

    /// The same for steps of another length.
    pub(crate) fn with_steps_of(self, step_length: f32) -> Self {
        Self { per_ray: self.per_ray * f64::from(self.step_length / step_length), step_length }
    }

    /// Room for the samples of `rays` others: a quarter more than expected, and some. Rays are drawn at random, so that their
    /// sum is that much more than its mean in one of far more steps than a run has.
    pub(crate) fn capacity(self, rays: usize) -> usize {
        const LEAST: usize = 1024;
        (1.25 * self.per_ray * rays as f64) as usize + LEAST
    }
}

/// A bundle of pixels, and by which noise they and the samples along their rays are drawn.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Drawn<'a> {
    pub(crate) pixels: &'a Pixels,
    pub(crate) noise: Noise,
    pub(crate) samples: Noise,
    /// What moves the cameras: the identity, unless the rays are neighbours.
    pub(crate) motion: DMat4,
}

impl DevicePixels {
    /// Those of `images`; none where only the host can draw: if cameras differ in more than their poses, if some pixels are
    /// invalid or drawn by their error, or if a table would be too large.
    pub(crate) fn new(scene: &Scene, images: &Images, config: &TrainConfig, device: &Device) -> Option<Self> {
        let cameras: Vec<&Camera> = scene.train.iter().map(|view| &view.camera).collect();
        let unseen = scene.all_train_cameras.iter().filter(|_| config.unseen == Unseen::Dataset);
        let local = cameras[0].with_pose(DMat4::IDENTITY);
        let are_alike = cameras.iter().copied().chain(unseen).all(|camera| camera.with_pose(DMat4::IDENTITY) == local);
        let draws_any = images.are_all_valid() && !config.error_sampling.is_on() && config.batch != Batch::HeldOut;
        let (size, full_size) = (images.size_in_pixels(), [local.width as usize, local.height as usize]);
        let [area, full_area] = [size, full_size].map(|[width, height]| width * height);
        let numbers = 4 * (area * cameras.len()).max(full_area + area);
        if !are_alike || !draws_any || numbers * size_of::<f32>() > LARGEST {
            return None;
        }
        let mut rays = local_rays(&local, full_size, 1.0);
        if images.pixel_width() > 1.0 {
            rays.extend(local_rays(&local, size, images.pixel_width()));
        }
        let poses: Vec<f32> = cameras.iter().flat_map(|camera| upper_rows(&camera.to_world)).collect();
        let device = device.clone().inner();
        let tables = PixelTables {
            rays: from_host(&rays, 4, &device),
            poses: from_host(&poses, 12, &device),
            shown: from_host(&images.shown(scene.background), 4, &device),
        };
        Some(Self { tables, factor: images.factor(), size, full_size, views: cameras.len() })
    }

    /// Whether they are those of `images`.
    pub(crate) fn are_of(&self, images: &Images) -> bool {
        self.factor == images.factor()
    }

    /// How pixels of photographs are drawn in step `step`, or the neighbours of their rays.
    pub(crate) fn seen(&self, drawn: Drawn<'_>, config: &TrainConfig, step: usize) -> PixelDraw {
        let view = drawn.noise.child(RandomStream::View);
        let views = match config.batch {
            Batch::Pixels => DrawnViews::All { count: self.views, key: view.bits() },
            Batch::Image | Batch::HeldOut => DrawnViews::One(view.below(0, 0, self.views)),
        };
        let first = if self.factor > 1 { self.full_size[0] * self.full_size[1] } else { 0 };
        let draw = of_size(self.size, drawn, config, step);
        PixelDraw { views, first, motion: upper_rows(&drawn.motion), has_poses: true, ..draw }
    }

    /// How pixels of an unseen pose are drawn, or the neighbours of their rays.
    pub(crate) fn unseen(&self, drawn: Drawn<'_>, config: &TrainConfig, step: usize) -> PixelDraw {
        of_size(self.full_size, drawn, config, step)
    }
}

/// A draw of the first camera's pixels, the images being of `size`.
fn of_size(size: [usize; 2], drawn: Drawn<'_>, config: &TrainConfig, step: usize) -> PixelDraw {
    let Drawn { pixels, noise, samples, motion } = drawn;
    let [columns, rows] = size.map(|size| crop(config, step, size as u32).into());
    PixelDraw {
        rays: pixels.at.len(),
        views: DrawnViews::All { count: 1, key: 0 },
        keys: [RandomStream::Column, RandomStream::Row].map(|stream| noise.child(stream).bits()),
        columns,
        rows,
        first: 0,
        size,
        widening: pixels.width,
        motion: upper_rows(&(motion * pixels.cameras[0].to_world)),
        has_poses: false,
        streams: [samples.bits(), samples.child(RandomStream::FineSamples).bits()],
    }
}

/// Direction and radius of each pixel's ray in the frame of a camera, at the identity, for images whose pixels are `scale` of
/// its own wide.
fn local_rays(camera: &Camera, [width, height]: [usize; 2], scale: f32) -> Vec<f32> {
    let ray = |at: usize| {
        let [x, y] = [at % width, at / width].map(|place| (place as f32 + 0.5) * scale);
        let ray = camera.ray(x, y);
        Vec4::from((ray.direction, ray.radius)).to_array()
    };
    (0..width * height).flat_map(ray).collect()
}

/// The upper three rows of a matrix.
fn upper_rows(matrix: &DMat4) -> [f32; 12] {
    let rows = matrix.transpose().to_cols_array();
    std::array::from_fn(|i| rows[i] as f32)
}

#[cfg(test)]
mod tests {
    use infonerf_loss::pixel_class;
    use infonerf_ops::drawing::{DrawnRays, draw_rays};
    use infonerf_ops::to_host;
    use infonerf_scene::ViewRegion;

    use super::*;
    use crate::error_sampling::PixelErrors;
    use crate::pixels::tests::two_views;
    use crate::pixels::{UnseenViews, rotation};
    use crate::training_images::TrainingImages;
    use crate::{Config, Preset};

    /// Rays of photographs, of an unseen pose and of the neighbours of both, whatever the batch, size and crop.
    #[test]
    fn rays_are_those_that_the_host_draws() {
        let (scene, device) = (two_views(), Device::flex());
        let cameras: Vec<Camera> = scene.train.iter().map(|view| view.camera.clone()).collect();
        let region = ViewRegion::new(&cameras);
        for (step, (batch, downscale)) in
            [("pixels", 1), ("image", 1), ("pixels", 2), ("image", 2)].into_iter().enumerate()
        {
            let settings = [format!("train.batch={batch}"), format!("train.downscale={downscale}.0")];
            let config = TrainConfig { precrop_steps: 2, ..Config::of(Preset::Paper, &settings).unwrap().train };
            let images = TrainingImages::new(&scene, &config);
            let [noise, unseen_noise, samples] =
                [RandomStream::SeenRays, RandomStream::UnseenRays, RandomStream::Samples]
                    .map(|stream| Noise::new(7, step as u64, stream));
            let at = Moment { step, progress: 0.0 };
            let seen = images.draw(&config, 11, at, noise, &PixelErrors::default());
            let views = UnseenViews { scene: &scene, region: &region, config: &config };
            let unseen = views.pixels(9, seen.pixels.width, step, unseen_noise);
            let turn = rotation(&config.neighbours, samples);

            let there = DevicePixels::new(&scene, images.at(&config, at), &config, &device).unwrap();
            let motions = [DMat4::IDENTITY, config.neighbours.motion(turn, &region)];
            let of_seen =
                motions.map(|motion| there.seen(Drawn { pixels: &seen.pixels, noise, samples, motion }, &config, step));
            let of_unseen = motions.map(|motion| {
                there.unseen(Drawn { pixels: &unseen, noise: unseen_noise, samples, motion }, &config, step)
            });
            let bundles = [of_seen[0], of_unseen[0], of_seen[1], of_unseen[1]];
            let DrawnRays { origins, directions, radii, colors, classes, .. } = draw_rays(&there.tables, &bundles);
            let near = |pixels: &Pixels| pixels.neighbours(turn, &config.neighbours, &region);
            let rays = [seen.pixels.rays(), unseen.rays(), near(&seen.pixels), near(&unseen)].concat();
            let [origins, directions] = [origins, directions].map(to_host);
            for (i, (ray, radius)) in rays.iter().zip(to_host(radii)).enumerate() {
                let vector = |numbers: &[f32]| glam::Vec3::from_slice(&numbers[3 * i..]);
                assert!(vector(&origins).distance(ray.origin) < 1e-5, "{batch} {downscale} {i}");
                assert!(vector(&directions).distance(ray.direction) < 1e-6, "{batch} {downscale} {i}");
                assert!((radius / ray.radius - 1.0).abs() < 1e-5, "{batch} {downscale} {i}");
            }
            let shown: Vec<f32> = seen.rgba.iter().flat_map(|&[red, green, blue, _]| [red, green, blue]).collect();
            assert_eq!(to_host(colors), shown);
            let pixels = seen.rgba.iter().zip(&seen.coverage);
            let class = |(pixel, coverage): (&[f32; 4], &f32)| pixel_class(*pixel, *coverage, scene.background);
            assert_eq!(to_host(classes), pixels.map(class).collect::<Vec<_>>());
        }
    }

    #[test]
    fn only_the_host_draws_what_a_table_cannot_say() {
        let mut scene = two_views();
        let with = |scene: &Scene, settings: &[&str]| {
            let config = Config::of(Preset::Paper, settings).unwrap().train;
            let images = TrainingImages::new(scene, &config);
            DevicePixels::new(scene, images.at(&config, Moment::START), &config, &Device::flex()).is_some()
        };
        assert!(with(&scene, &[]));
        assert!(!with(&scene, &["train.error_sampling={threshold=0.1,keep=0.5}"]));
        scene.train[1].valid = Some((0..256).map(|i| i != 3).collect());
        assert!(!with(&scene, &[]));
        scene.train[1].valid = None;
        scene.train[1].camera.fx *= 1.01;
        assert!(!with(&scene, &[]));
    }
}
