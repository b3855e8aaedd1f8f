//! What a step renders: the rays of training images, and the union of what the terms of the objective need.

use std::borrow::Cow;

use burn::tensor::Device;
use infonerf_field::Field;
use infonerf_loss::{Bundle, Need, NeighbourBundles, Picture, Renders, Target};
use infonerf_ops::{is_gpu, upload};
use infonerf_render::{
    Counts, Draw, Model, Noise, OccupancyGrid, Passes, RandomStream, RayBundle, RenderOutput, RenderRequest,
    TrackedRays,
};
use infonerf_scene::Ray;
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

/// A bundle of rays to render.
struct Asked {
    phase: Phase,
    rays: Vec<Ray>,
    tracked: Option<TrackedRays>,
    color: bool,
    noise: Noise,
}

impl<F: Field> StepRenderer<'_, F> {
    /// Renders `pixels`, and what else is needed.
    pub(crate) fn render(&mut self, pixels: &StepPixels, needs: &[Need]) -> Renders {
        let seen = &pixels.seen;
        let (mut seen_pixels, mut tracked) = (Cow::Borrowed(&seen.pixels), None);
        if let Some(refinement) = &self.model.cameras {
            tracked = Some(refinement.rays(&seen.pixels.cameras, &seen.pixels.at));
            seen_pixels.to_mut().cameras = refinement.apply(&seen.pixels.cameras);
        }
        let unseen = pixels.unseen.as_ref().filter(|_| needs.contains(&Need::Unseen));
        let config = &self.config.train.neighbours;
        let near = |need: Need, of: &Pixels| {
            needs.contains(&need).then(|| of.neighbours(pixels.rotation, config, &self.scene.region))
        };
        let near_unseen = unseen.and_then(|unseen| near(Need::UnseenNeighbours, unseen));
        let near = [near(Need::SeenNeighbours, &seen_pixels), near_unseen];
        let (own, paired) = match config.sampling {
            NeighbourSampling::Own => (near, [None, None]),
            NeighbourSampling::Partner => ([None, None], near),
        };

        let color = needs.contains(&Need::SeenColor);
        let of = |phase, rays, stream| Asked { phase, rays, tracked: None, color: false, noise: self.noise(stream) };
        let of_seen = of(Phase::Seen, seen_pixels.rays(), RandomStream::SeenRays);
        let [own_seen, own_unseen] = own.map(|rays| Some(of(Phase::Neighbours, rays?, RandomStream::Neighbours)));
        let of_unseen = unseen.map(|unseen| of(Phase::Unseen, unseen.rays(), RandomStream::UnseenRays));
        let asked = [Some(Asked { tracked, color, ..of_seen }), of_unseen, own_seen, own_unseen];
        let [passes, unseen, own_seen, own_unseen] = self.all(asked);

        let passes = passes.expect("seen rays are asked for");
        let passes = match &self.model.exposure {
            Some(exposure) => passes.exposed(exposure, &seen.pixels.views()),
            None => passes,
        };
        let [along_seen, along_unseen] = paired;
        let along_seen = along_seen.map(|rays| self.along(&passes.fine, &rays));
        let along_unseen = unseen.as_ref().zip(along_unseen).map(|(unseen, rays)| self.along(&unseen.fine, &rays));
        let seen_bundle = Bundle { passes, target: Some(self.target(seen)) };
        let neighbours = NeighbourBundles {
            seen: own_seen.map(|own| own.fine).or(along_seen),
            unseen: own_unseen.map(|own| own.fine).or(along_unseen),
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
            unseen: unseen.map(|passes| Bundle { passes, target: None }),
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

    /// Density along `rays`, the neighbours of those of `output`, at their distances.
    fn along(&mut self, output: &RenderOutput, rays: &[Ray]) -> RenderOutput {
        let renderer = &self.scene.renderer;
        let near = self.profile.time(Phase::Neighbours, || renderer.along(&self.model.fine, output, rays, self.at));
        self.counts += Counts::from(&near.samples);
        self.rays += rays.len();
        near
    }

    fn picture(&mut self, size: u32) -> Picture {
        let noise = self.noise(RandomStream::Picture);
        let (rays, size) = self.scene.unseen(self.config).picture(size, noise);
        let asked = Asked { phase: Phase::Unseen, rays, tracked: None, color: true, noise };
        let [passes] = self.all([Some(asked)]);
        Picture {
            rgb: passes.expect("a picture is asked for").fine.color.expect("colour was asked for"),
            size,
            view: noise.child(RandomStream::View).below(0, 0, self.scene.scene.train.len()),
        }
    }

    /// The passes over each bundle of rays that is asked for. A GPU is given all of them at once, and so a fraction of the
    /// launches; but a bundle on its own where its rays are in the graph.
    fn all<const N: usize>(&mut self, asked: [Option<Asked>; N]) -> [Option<Passes>; N] {
        let all: Vec<&Asked> = asked.iter().flatten().collect();
        let together = is_gpu(&self.device()) && self.model.cameras.is_none();
        let groups = all.chunks(if together { N } else { 1 });
        let mut passes = groups.flat_map(|group| self.passes(group)).collect::<Vec<_>>().into_iter();
        asked.each_ref().map(|asked| asked.as_ref().and_then(|_| passes.next()))
    }

    /// The passes over each bundle of a group, rendered as one.
    fn passes(&mut self, group: &[&Asked]) -> Vec<Passes> {
        let rays: Vec<Ray> = group.iter().flat_map(|asked| asked.rays.iter().copied()).collect();
        let draws = |asked: &&Asked| {
            let noise = asked.noise.child(RandomStream::Samples);
            (0..asked.rays.len()).map(move |ray| (noise, ray))
        };
        let draws: Vec<Draw> = group.iter().flat_map(draws).collect();
        let bundle = RayBundle { rays: &rays, tracked: group[0].tracked.as_ref(), draws: &draws };
        let request = RenderRequest { color: group.iter().any(|asked| asked.color), hidden: false };
        let (renderer, model, occupancy, at) = (&self.scene.renderer, self.model, self.occupancy, self.at);
        let render = || renderer.render(model, bundle, request, occupancy, at);
        let passes = self.profile.time(group[0].phase, render);
        self.counts += passes.counts();
        self.rays += rays.len();
        passes.split(&group.iter().map(|asked| asked.rays.len()).collect::<Vec<_>>())
    }

    fn noise(&self, stream: RandomStream) -> Noise {
        Noise::new(self.seed, self.at.step as u64, stream)
    }

    fn device(&self) -> Device {
        self.model.fine.device()
    }
}
