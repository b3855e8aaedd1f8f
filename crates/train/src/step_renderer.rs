//! What a step renders: the rays of training images, and the union of what the terms of the objective need.

use std::borrow::Cow;

use burn::tensor::Device;
use glam::DMat4;
use infonerf_field::Field;
use infonerf_loss::{Bundle, Need, NeighbourBundles, Picture, Renders, Target};
use infonerf_ops::upload;
use infonerf_render::{
    Counts, Model, Noise, OccupancyGrid, Passes, RandomStream, RayBundle, RenderOutput, RenderRequest,
};
use infonerf_schedule::Moment;

use crate::config::NeighbourSampling;
use crate::pixels::Pixels;
use crate::step_pixels::StepPixels;
use crate::training_images::SeenPixels;
use crate::training_scene::TrainingScene;
use crate::{Config, Phase, Profile};

/// Renders for one step, and counts what that took.
pub(crate) struct StepRenderer<'a, F: Field> {
    pub(crate) config: &'a Config,
    pub(crate) scene: &'a TrainingScene,
    /// Conditioned on the photographs of the step.
    pub(crate) model: &'a Model<F>,
    pub(crate) occupancy: Option<&'a OccupancyGrid>,
    pub(crate) at: Moment,
    pub(crate) seed: u64,
    pub(crate) profile: &'a mut Profile,
    /// Samples so far.
    pub(crate) counts: Counts,
    /// Rays so far.
    pub(crate) rays: usize,
}

impl<F: Field> StepRenderer<'_, F> {
    /// Renders `pixels`, and what else is needed.
    pub(crate) fn render(&mut self, pixels: &StepPixels, needs: &[Need]) -> Renders {
        let seen = &pixels.seen;
        let color = needs.contains(&Need::SeenColor);
        let samples = self.noise(RandomStream::SeenRays).child(RandomStream::Samples);
        let (mut seen_pixels, mut tracked) = (Cow::Borrowed(&seen.pixels), None);
        if let Some(refinement) = &self.model.cameras {
            tracked = Some(refinement.rays(&seen.pixels.cameras, &seen.pixels.at));
            seen_pixels.to_mut().cameras = refinement.apply(&seen.pixels.cameras);
        }
        let bundle = RayBundle { rays: &seen_pixels.rays(), tracked: tracked.as_ref() };
        let passes = self.passes(Phase::Seen, bundle, color, samples);
        let passes = match &self.model.exposure {
            Some(exposure) => passes.exposed(exposure, &seen.pixels.views()),
            None => passes,
        };
        let target = self.target(seen);
        let seen_bundle = Bundle { passes, target: Some(target) };
        let unseen = pixels.unseen.as_ref().filter(|_| needs.contains(&Need::Unseen));
        let unseen = unseen.map(|unseen| (unseen, self.unseen(unseen)));
        let near = |needed: Need, of: &Pixels, bundle: &Bundle, renderer: &mut Self| {
            needs.contains(&needed).then(|| renderer.neighbours(of, pixels.rotation, bundle.output()))
        };
        let neighbours = NeighbourBundles {
            seen: near(Need::SeenNeighbours, &seen_pixels, &seen_bundle, self),
            unseen: unseen.as_ref().and_then(|(unseen, bundle)| near(Need::UnseenNeighbours, unseen, bundle, self)),
        };
        let model = self.model;
        let penalty = |need: &Need| {
            let Need::Penalty(name) = *need else { return None };
            Some((name, model.fine.penalty(name)?))
        };
        let size = needs.iter().find_map(|need| if let Need::Picture { size } = need { Some(*size) } else { None });
        Renders {
            squared_error: seen_bundle.squared_error(),
            seen: seen_bundle,
            unseen: unseen.map(|(_, bundle)| bundle),
            neighbours,
            picture: size.map(|size| self.picture(size)),
            penalties: needs.iter().filter_map(penalty).collect(),
        }
    }

    fn target(&self, seen: &SeenPixels) -> Target {
        let channels: Vec<f32> = seen.rgba.iter().flat_map(|&[red, green, blue, _]| [red, green, blue]).collect();
        Target {
            rgb: upload(channels, [seen.rgba.len(), 3], &self.device()),
            rgba: seen.rgba.clone(),
            coverage: seen.coverage.clone(),
            pixels: seen.pixels.at.clone(),
            background: self.scene.scene.background,
        }
    }

    fn unseen(&mut self, pixels: &Pixels) -> Bundle {
        let samples = self.noise(RandomStream::UnseenRays).child(RandomStream::Samples);
        Bundle { passes: self.passes(Phase::Unseen, (&pixels.rays()).into(), false, samples), target: None }
    }

    /// Density along the neighbours of the rays of `output`.
    fn neighbours(&mut self, pixels: &Pixels, rotation: DMat4, output: &RenderOutput) -> RenderOutput {
        let config = &self.config.train.neighbours;
        let rays = pixels.neighbours(rotation, config, &self.scene.region);
        if config.sampling == NeighbourSampling::Own {
            let samples = self.noise(RandomStream::Neighbours).child(RandomStream::Samples);
            return self.passes(Phase::Neighbours, (&rays).into(), false, samples).fine;
        }
        let renderer = &self.scene.renderer;
        let near = self.profile.time(Phase::Neighbours, || renderer.along(&self.model.fine, output, &rays, self.at));
        self.counts += Counts::from(&near.samples);
        self.rays += rays.len();
        near
    }

    fn picture(&mut self, size: u32) -> Picture {
        let noise = self.noise(RandomStream::Picture);
        let (rays, size) = self.scene.unseen(self.config).picture(size, noise);
        let passes = self.passes(Phase::Unseen, (&rays).into(), true, noise.child(RandomStream::Samples));
        Picture {
            rgb: passes.fine.color.expect("colour was asked for"),
            size,
            view: noise.child(RandomStream::View).below(0, 0, self.scene.scene.train.len()),
        }
    }

    fn passes(&mut self, phase: Phase, bundle: RayBundle<'_>, color: bool, noise: Noise) -> Passes {
        let (renderer, model, at) = (&self.scene.renderer, self.model, self.at);
        let request = RenderRequest { color, hidden: false };
        let occupancy = self.occupancy;
        let passes = self.profile.time(phase, || renderer.render(model, bundle, request, Some(noise), occupancy, at));
        self.counts += passes.counts();
        self.rays += bundle.rays.len();
        passes
    }

    fn noise(&self, stream: RandomStream) -> Noise {
        Noise::new(self.seed, self.at.step as u64, stream)
    }

    fn device(&self) -> Device {
        self.model.fine.device()
    }
}
