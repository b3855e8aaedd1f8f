//! What a step renders: the rays of training images, and the union of what the terms of the objective need.

use std::borrow::Cow;

use burn::tensor::{Device, Tensor};
use glam::DMat4;
use infonerf_field::Field;
use infonerf_loss::{Bundle, Need, NeighbourBundles, Picture, Renders, Target};
use infonerf_ops::drawing::{DrawnRays, PixelDraw, draw_rays};
use infonerf_ops::{is_gpu, upload};
use infonerf_render::{
    Counts, Draw, Model, Noise, OccupancyGrid, Passes, RandomStream, RayBundle, RenderOutput, RenderRequest,
    TrackedRays,
};
use infonerf_scene::Ray;
use infonerf_schedule::Moment;

use crate::config::NeighbourSampling;
use crate::device_pixels::{DevicePixels, Drawn};
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
    /// Where a GPU draws the step's pixels itself: what from.
    pub(crate) device_pixels: Option<&'a DevicePixels>,
    /// Most samples that such a GPU places where it marches.
    pub(crate) capacity: usize,
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
    /// By which samples along the rays are jittered.
    samples: Noise,
}

/// What a GPU drew for a step.
struct DrawnOnDevice {
    /// The rays of all bundles to render.
    rendered: DrawnRays,
    /// The neighbours of seen and of unseen rays that are paired with them.
    paired: [Option<DrawnRays>; 2],
    /// What the seen pixels show.
    colors: Tensor<2>,
    /// The classes of these.
    classes: Tensor<1>,
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

        let on_device =
            self.draw_on_device(pixels, unseen, [&own, &paired].map(|near| near.each_ref().map(Option::is_some)));
        let color = needs.contains(&Need::SeenColor);
        let of =
            |phase, rays, stream| Asked { phase, rays, tracked: None, color: false, samples: self.samples(stream) };
        let of_seen = of(Phase::Seen, seen_pixels.rays(), RandomStream::SeenRays);
        let [own_seen, own_unseen] = own.map(|rays| Some(of(Phase::Neighbours, rays?, RandomStream::Neighbours)));
        let of_unseen = unseen.map(|unseen| of(Phase::Unseen, unseen.rays(), RandomStream::UnseenRays));
        let asked = [Some(Asked { tracked, color, ..of_seen }), of_unseen, own_seen, own_unseen];
        let [passes, unseen, own_seen, own_unseen] = self.all(asked, on_device.as_ref().map(|drawn| &drawn.rendered));

        let passes = passes.expect("seen rays are asked for");
        let passes = match &self.model.exposure {
            Some(exposure) => passes.exposed(exposure, &seen.pixels.views()),
            None => passes,
        };
        let [along_seen, along_unseen] = paired;
        let [drawn_seen, drawn_unseen] = match &on_device {
            Some(drawn) => drawn.paired.each_ref().map(Option::as_ref),
            None => [None, None],
        };
        let along_seen = along_seen.map(|rays| self.along(&passes.fine, &rays, drawn_seen));
        let along_unseen =
            unseen.as_ref().zip(along_unseen).map(|(unseen, rays)| self.along(&unseen.fine, &rays, drawn_unseen));
        let seen_bundle =
            Bundle { passes, target: Some(self.target(seen, on_device.map(|drawn| (drawn.colors, drawn.classes)))) };
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

    /// Draws the pixels of a step on the GPU too, if it can: the photographs', those of an `unseen` pose, and the `neighbours` of
    /// either, whose samples are their own or those of their partners.
    fn draw_on_device(
        &self,
        pixels: &StepPixels,
        unseen: Option<&Pixels>,
        [own, paired]: [[bool; 2]; 2],
    ) -> Option<DrawnOnDevice> {
        let images = self.device_pixels?;
        let (train, step) = (&self.config.train, self.at.step);
        let motion = train.neighbours.motion(pixels.rotation, &self.scene.region);
        let seen = |samples, motion| {
            let noise = self.noise(RandomStream::SeenRays);
            let drawn = Drawn { pixels: &pixels.seen.pixels, noise, samples: self.samples(samples), motion };
            images.seen(drawn, train, step)
        };
        let of_unseen = |samples, motion| {
            let noise = self.noise(RandomStream::UnseenRays);
            Some(images.unseen(Drawn { pixels: unseen?, noise, samples: self.samples(samples), motion }, train, step))
        };
        let near = |[is_seen, is_unseen]: [bool; 2]| {
            let seen = is_seen.then(|| seen(RandomStream::Neighbours, motion));
            [seen, of_unseen(RandomStream::Neighbours, motion).filter(|_| is_unseen)]
        };
        let own_pose = DMat4::IDENTITY;
        let of_seen = seen(RandomStream::SeenRays, own_pose);
        let [own, paired] = [own, paired].map(near);
        let rendered = [Some(of_seen), of_unseen(RandomStream::UnseenRays, own_pose), own[0], own[1]];
        let bundles: Vec<PixelDraw> = rendered.iter().chain(&paired).flatten().copied().collect();
        let drawn = draw_rays(&images.tables, &bundles);
        let of = |bundles: &[Option<PixelDraw>]| bundles.iter().flatten().map(|draw| draw.rays).sum::<usize>();
        let counts = [of(&rendered), of(&paired[..1]), of(&paired[1..])];
        let (colors, classes) = (drawn.colors.clone(), drawn.classes.clone());
        let mut parts =
            drawn.split(&counts.into_iter().filter(|count| *count > 0).collect::<Vec<_>>()).into_iter().peekable();
        let [rendered, seen, unseen] = counts.map(|count| parts.next_if(|_| count > 0));
        Some(DrawnOnDevice {
            rendered: rendered.expect("there are seen rays"),
            paired: [seen, unseen],
            colors,
            classes,
        })
    }

    fn target(&self, seen: &SeenPixels, on_device: Option<(Tensor<2>, Tensor<1>)>) -> Target {
        let device = self.device();
        let (rgb, classes) = match on_device {
            Some((rgb, classes)) if device.is_autodiff() => (rgb.autodiff(), Some(classes.autodiff())),
            Some((rgb, classes)) => (rgb, Some(classes)),
            None => {
                let channels = seen.rgba.iter().flat_map(|&[red, green, blue, _]| [red, green, blue]).collect();
                (upload(channels, [seen.rgba.len(), 3], &device), None)
            }
        };
        Target {
            rgb,
            classes,
            rgba: seen.rgba.clone(),
            coverage: seen.coverage.clone(),
            pixels: seen.pixels.at.clone(),
            background: self.scene.scene.background,
        }
    }

    /// Density along `rays`, the neighbours of those of `output`, at their distances.
    fn along(&mut self, output: &RenderOutput, rays: &[Ray], drawn: Option<&DrawnRays>) -> RenderOutput {
        let (renderer, bundle) = (&self.scene.renderer, RayBundle { drawn, ..rays.into() });
        let near = self.profile.time(Phase::Neighbours, || renderer.along(&self.model.fine, output, bundle, self.at));
        self.counts += Counts::from(&near.samples);
        self.rays += rays.len();
        near
    }

    fn picture(&mut self, size: u32) -> Picture {
        let noise = self.noise(RandomStream::Picture);
        let (rays, size) = self.scene.unseen(self.config).picture(size, noise);
        let samples = noise.child(RandomStream::Samples);
        let asked = Asked { phase: Phase::Unseen, rays, tracked: None, color: true, samples };
        let [passes] = self.all([Some(asked)], None);
        Picture {
            rgb: passes.expect("a picture is asked for").fine.color.expect("colour was asked for"),
            size,
            view: noise.child(RandomStream::View).below(0, 0, self.scene.scene.train.len()),
        }
    }

    /// The passes over each bundle of rays that is asked for. A GPU is given all of them at once, and so a fraction of the
    /// launches; but a bundle on its own where its rays are in the graph. All of them may be `drawn` there.
    fn all<const N: usize>(&mut self, asked: [Option<Asked>; N], drawn: Option<&DrawnRays>) -> [Option<Passes>; N] {
        let all: Vec<&Asked> = asked.iter().flatten().collect();
        let together = is_gpu(&self.device()) && self.model.cameras.is_none();
        let groups = all.chunks(if together { N } else { 1 });
        let mut passes = groups.flat_map(|group| self.passes(group, drawn)).collect::<Vec<_>>().into_iter();
        asked.each_ref().map(|asked| asked.as_ref().and_then(|_| passes.next()))
    }

    /// The passes over each bundle of a group, rendered as one.
    fn passes(&mut self, group: &[&Asked], drawn: Option<&DrawnRays>) -> Vec<Passes> {
        let rays: Vec<Ray> = group.iter().flat_map(|asked| asked.rays.iter().copied()).collect();
        let draws = |asked: &&Asked| {
            let noise = asked.samples;
            (0..asked.rays.len()).map(move |ray| (noise, ray))
        };
        let draws: Vec<Draw> = group.iter().flat_map(draws).collect();
        let bundle = RayBundle {
            rays: &rays,
            tracked: group[0].tracked.as_ref(),
            drawn,
            capacity: self.capacity,
            draws: &draws,
        };
        let request = RenderRequest { color: group.iter().any(|asked| asked.color), hidden: false };
        let (renderer, model, occupancy, at) = (&self.scene.renderer, self.model, self.occupancy, self.at);
        let render = || renderer.render(model, bundle, request, occupancy, at);
        let passes = self.profile.time(group[0].phase, render);
        self.counts += passes.counts();
        self.rays += rays.len();
        passes.split(&group.iter().map(|asked| asked.rays.len()).collect::<Vec<_>>())
    }

    /// By which samples along the rays of `stream` are jittered.
    fn samples(&self, stream: RandomStream) -> Noise {
        self.noise(stream).child(RandomStream::Samples)
    }

    fn noise(&self, stream: RandomStream) -> Noise {
        Noise::new(self.seed, self.at.step as u64, stream)
    }

    fn device(&self) -> Device {
        self.model.fine.device()
    }
}
