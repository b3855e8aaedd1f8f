use burn::tensor::Tensor;
use infonerf_field::Field;
use infonerf_loss::{LossValues, Need, Renders, needs};
use infonerf_ops::to_host;
use infonerf_render::{Counts, Noise, RandomStream};
use infonerf_scene::ViewRegion;
use infonerf_schedule::Moment;

use super::Trainer;
use super::numbers::Numbers;
use crate::Phase;
use crate::config::Batch;
use crate::device_pixels::{DevicePixels, ExpectedSamples};
use crate::pixels::{UnseenViews, rotation};
use crate::step_pixels::StepPixels;
use crate::step_renderer::StepRenderer;
use crate::training_images::SeenPixels;

/// What a step's forward pass gives.
pub(super) struct Forward {
    /// The objective, to be differentiated.
    pub(super) total: Tensor<1>,
    pub(super) numbers: Numbers,
    /// Samples before and after skipping.
    pub(super) counts: Counts,
    /// Rays of all kinds.
    pub(super) rays: usize,
    /// Evaluated samples per seen ray.
    pub(super) samples_per_ray: f64,
}

impl<F: Field> Trainer<F> {
    /// Draws what the step at `at` looks at.
    pub(super) fn draw(&mut self, at: Moment) -> StepPixels {
        let noise = |stream| Noise::new(self.seed, at.step as u64, stream);
        let train = &self.config.train;
        let index = noise(RandomStream::TrainingScene).below(0, 0, self.scenes.len());
        let scene = &self.scenes[index];
        let images = scene.images.at(train, at);
        let (rays, unseen_rays) = self.ray_counts();
        let unseen_is_needed = needs(&scene.objective.due(at)).contains(&Need::Unseen);
        let refinement = self.model.cameras.as_ref().filter(|_| unseen_is_needed);
        let learnt = refinement.map(|cameras| ViewRegion::new(&cameras.apply(&self.given_cameras())));
        let unseen = || {
            let views = UnseenViews { region: learnt.as_ref().unwrap_or(&scene.region), ..scene.unseen(&self.config) };
            views.pixels(unseen_rays, images.pixel_width(), at.step, noise(RandomStream::UnseenRays))
        };

        self.pixel_errors.resize(images.size());
        let pixels = self.profile.time(Phase::Rays, || StepPixels {
            scene: index,
            seen: scene.images.draw(train, rays, at, noise(RandomStream::SeenRays), &self.pixel_errors),
            unseen: unseen_is_needed.then(unseen),
            rotation: rotation(&train.neighbours, noise(RandomStream::Neighbours)),
        });
        self.plan_device_drawing(&pixels, at);
        pixels
    }

    /// Decides whether a GPU draws these pixels too, and places the samples along their rays; if it can, nothing is moved there.
    fn plan_device_drawing(&mut self, pixels: &StepPixels, at: Moment) {
        let scene = &self.scenes[pixels.scene];
        let (renderer, images) = (&scene.renderer, scene.images.at(&self.config.train, at));
        let occupancy = self.occupancy.as_ref().filter(|grid| grid.is_used_in(at.step));
        let is_apart = |need: &Need| need.is_unseen() || need.is_of_neighbours();
        let bundles = 1 + needs(&scene.objective.due(at)).iter().filter(|need| is_apart(need)).count();
        let serves = self.scenes.len() == 1
            && self.model.cameras.is_none()
            && renderer.places_on(&self.device, occupancy, bundles);
        // They stay for later steps where one is left to the host.
        if serves && !self.device_pixels.as_ref().is_some_and(|pixels| pixels.are_of(images)) {
            self.device_pixels = DevicePixels::new(&scene.scene, images, &self.config.train, &self.device);
        }
        self.draws_on_device = serves && self.device_pixels.is_some();
        // Without a grid the count is exact, and as quick as that of rays. One image may show much more than another.
        let holds = occupancy.is_some() && self.config.train.batch == Batch::Pixels;
        let known = self.marched.take().filter(|_| holds);
        if self.draws_on_device && renderer.marches() {
            self.marched = Some(match known {
                Some(known) => known.with_steps_of(renderer.step_length(at)),
                None => ExpectedSamples::count(renderer, &pixels.seen.pixels.rays(), occupancy, at),
            });
        }
    }

    /// Renders the rays of `pixels` and evaluates the objective.
    pub(super) fn forward(&mut self, at: Moment, pixels: &StepPixels) -> Forward {
        let noise = Noise::new(self.seed, at.step as u64, RandomStream::Sources);
        let scene = &self.scenes[pixels.scene];
        let terms = scene.objective.due(at);
        let sources = scene.photographs.draw(&self.config.train, pixels.seen.pixels.view(), noise);
        let latent = Noise::new(self.seed, at.step as u64, RandomStream::Latent).bits();
        let model = self.profile.time(Phase::Seen, || self.model.conditioned(&sources, Some(latent)));

        let mut renderer = StepRenderer {
            config: &self.config,
            scene,
            model: &model,
            occupancy: self.occupancy.as_ref().filter(|grid| grid.is_used_in(at.step)),
            device_pixels: self.device_pixels.as_ref().filter(|_| self.draws_on_device),
            capacity: self.marched.map_or(0, |marched| marched.capacity(pixels.seen.pixels.at.len())),
            at,
            seed: self.seed,
            profile: &mut self.profile,
            counts: Counts::default(),
            rays: 0,
        };
        let renders = renderer.render(pixels, &needs(&terms));
        let (counts, rays) = (renderer.counts, renderer.rays);
        let mut losses = LossValues::of(&terms, &renders);
        if let Some(cameras) = &model.cameras {
            let prior = cameras.prior();
            losses.total = losses.total + prior.clone() * self.config.train.cameras.prior;
            losses.values.push(("cameras", prior));
        }
        let numbers = Numbers::of(&losses, &renders);
        self.remember(&pixels.seen, &renders);
        Forward {
            total: losses.total,
            numbers,
            counts,
            rays,
            samples_per_ray: match self.marched {
                Some(marched) => marched.per_ray,
                None => renders.seen.output().segments().samples() as f64 / renders.seen.rays() as f64,
            },
        }
    }

    /// Keeps the errors of the pixels of a step, if later ones are to draw by them.
    fn remember(&mut self, seen: &SeenPixels, renders: &Renders) {
        self.progress.pixels_skipped += seen.rejected;
        let Some(color) = renders.seen.output().color.clone().filter(|_| self.config.train.error_sampling.is_on())
        else {
            return;
        };
        let color = to_host(color.detach());
        let errors = color.chunks_exact(3).zip(&seen.rgba).map(|(color, target)| {
            color.iter().zip(target).map(|(color, target)| (color - target).abs()).fold(0.0, f32::max)
        });
        self.pixel_errors.remember(&seen.indices, errors);
    }

    /// Rays of training images and of unseen poses for this step.
    fn ray_counts(&self) -> (usize, usize) {
        let train = &self.config.train;
        if train.target_samples == 0 || self.progress.samples_per_ray <= 0.0 {
            return (train.rays, train.unseen_rays);
        }
        let rays = (train.target_samples as f64 / self.progress.samples_per_ray)
            .clamp(train.rays as f64 / 4.0, train.rays as f64 * 16.0);
        (rays as usize, (rays * train.unseen_rays as f64 / train.rays as f64) as usize)
    }
}
