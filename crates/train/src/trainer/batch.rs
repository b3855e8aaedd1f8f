//! Batches of steps: pixels, the rays through them, and the colours that they show.

use glam::DMat4;
use infonerf_field::Field;
use infonerf_loss::{Need, Target};
use infonerf_ops::upload;
use infonerf_render::{Model, Noise, RandomStream, RayBatch};
use infonerf_scene::{Ray, ViewRegion};
use infonerf_schedule::Moment;

use super::Trainer;
use crate::config::NeighbourConfig;
use crate::pixels::{Pixels, rotation, unseen_camera};
use crate::training_scene::TrainingScene;

/// Pixels and poses of a step. The trainer draws them, or is given them by [`Trainer::step_on`](crate::Trainer::step_on).
#[derive(Clone, Debug)]
pub struct StepBatch {
    /// Index of the scene.
    pub scene: usize,
    /// Pixels of training images.
    pub seen: Pixels,
    /// RGB of each of these pixels, in [0, 1].
    pub colors: Vec<[f32; 3]>,
    /// Pixels of an unseen pose, if a term needs them.
    pub unseen: Option<Pixels>,
    /// The rotation that takes cameras to those of neighbouring rays.
    pub rotation: DMat4,
}

impl<F: Field> Trainer<F> {
    /// Draws the batch of the step at `at`. Unseen poses are near the training cameras, as corrected so far.
    pub(super) fn draw(&self, at: Moment) -> StepBatch {
        let noise = |stream| Noise::new(self.seed, at.step as u64, stream);
        let train = &self.config.train;
        let index = noise(RandomStream::TrainingScene).below(0, 0, self.scenes.len());
        let scene = &self.scenes[index];
        let [seen, unseen] = self.ray_counts();
        let draw_unseen = || {
            let cameras = self.model.cameras.as_ref();
            let learned = cameras.map(|cameras| ViewRegion::new(&cameras.apply(&scene.images.cameras)));
            let (region, noise) = (learned.as_ref().unwrap_or(&scene.region), noise(RandomStream::UnseenRays));
            let camera = unseen_camera(&scene.scene, region, train, noise);
            Pixels::draw(camera, unseen, scene.images.at(train, at).factor as f32, train, at.step, noise)
        };
        let (seen, colors) = scene.images.draw(train, seen, at, noise(RandomStream::SeenRays));
        StepBatch {
            scene: index,
            seen,
            colors,
            unseen: scene.objective.needs(at).contains(&Need::Unseen).then(draw_unseen),
            rotation: rotation(&train.neighbours, noise(RandomStream::Neighbours)),
        }
    }

    /// Returns the numbers of rays of training images and of unseen poses of a step.
    fn ray_counts(&self) -> [usize; 2] {
        let train = &self.config.train;
        let (seen, unseen) = (train.rays as f64, train.unseen_rays as f64);
        if train.target_samples == 0 || self.progress.samples_per_ray <= 0.0 {
            return [train.rays, train.unseen_rays];
        }
        let rays =
            (train.target_samples as f64 / self.progress.samples_per_ray).clamp(seen / 4.0, seen * 16.0).max(1.0);
        let unseen_rays = (rays * unseen / seen) as usize;
        [rays as usize, if train.unseen_rays == 0 { 0 } else { unseen_rays.max(1) }]
    }
}

/// Rays of a step: those of training images, and the others that the objective needs.
pub(super) struct StepRays {
    pub(super) seen: RayBatch,
    pub(super) unseen: Option<RayBatch>,
    pub(super) seen_neighbours: Option<RayBatch>,
    pub(super) unseen_neighbours: Option<RayBatch>,
}

impl StepBatch {
    /// Returns the rays of the batch that `needs` ask for. Rays of cameras that `model` corrects are in its autodiff graph.
    pub(super) fn rays<F: Field>(
        &self,
        neighbours: &NeighbourConfig,
        scene: &TrainingScene,
        model: &Model<F>,
        needs: &[Need],
        noise: impl Fn(RandomStream) -> Noise,
    ) -> StepRays {
        let device = model.fine.device();
        let jittered = |rays: Vec<Ray>, stream| {
            scene.renderer.rays(rays, &device).jittered(noise(stream).child(RandomStream::Samples))
        };
        let given = &self.seen;
        let corrected = model.cameras.as_ref().map(|cameras| given.seen_by(cameras.apply(&given.cameras).into()));
        let pixels = corrected.as_ref().unwrap_or(given);
        let mut seen = jittered(pixels.rays(), RandomStream::SeenRays);
        if let Some(cameras) = &model.cameras {
            seen = seen.tracked(cameras.rays(&given.cameras, &given.at));
        }
        let unseen = self.unseen.as_ref().filter(|_| needs.contains(&Need::Unseen));
        let near = |pixels: &Pixels| {
            jittered(pixels.neighbours(self.rotation, neighbours, &scene.region), RandomStream::Neighbours)
        };
        StepRays {
            seen,
            unseen: unseen.map(|pixels| jittered(pixels.rays(), RandomStream::UnseenRays)),
            seen_neighbours: needs.contains(&Need::SeenNeighbours).then(|| near(pixels)),
            unseen_neighbours: unseen.filter(|_| needs.contains(&Need::UnseenNeighbours)).map(near),
        }
    }

    /// Returns the colours of the seen pixels, on the device of `model`.
    pub(super) fn target<F: Field>(&self, scene: &TrainingScene, model: &Model<F>) -> Target {
        Target {
            rgb: upload(self.colors.as_flattened().to_vec(), [self.colors.len(), 3], &model.fine.device()),
            on_host: self.colors.clone(),
            pixels: self.seen.at.clone(),
            background: scene.scene.background,
        }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::config::{Config, Preset};
    use crate::testing::knot;

    #[test]
    fn numbers_of_rays_follow_the_samples_along_each() {
        let counts = |more: &[&str], samples_per_ray: f64| {
            let sizes =
                ["field.resolutions=[4]", "train.rays=100", "train.unseen_rays=50", "train.target_samples=5000"];
            let config = Config::of(Preset::Fast, sizes.iter().chain(more)).unwrap();
            let mut trainer = Trainer::new(&config, knot(1, 4), 0, None, &Device::flex()).unwrap();
            trainer.progress.samples_per_ray = samples_per_ray;
            trainer.ray_counts()
        };
        assert_eq!(counts(&["train.target_samples=0"], 25.0), [100, 50]);
        // Without a step before, with 5000 samples, and from a quarter of `train.rays` to sixteen times as many.
        let found = [0.0, 25.0, 1000.0, 1.0].map(|samples| counts(&[], samples));
        assert_eq!(found, [[100, 50], [200, 100], [25, 12], [1600, 800]]);
        assert_eq!(counts(&["train.unseen_rays=0"], 25.0), [200, 0]);
        assert_eq!(counts(&["train.rays=1", "train.unseen_rays=1"], 1e6), [1, 1]);
    }
}
