//! Pictures of a single pass, composited front to back.
//!
//! Rays advance a few samples at a time, and stop once their transmittance T is at most e =
//! `render.early_stop_transmittance`: the weights of skipped samples sum to at most e. Steps are longer in thin fog and
//! behind much of it. Where the finer grid of pictures bounds the optical depth of a step by 100 e/T, two steps share one
//! sample in their middle; below 10 e/T, four steps do. Such a sample has a weight of at most 200 e, and differs from the
//! samples that it replaces by a fraction of that. With e = 0 pictures are exact.

use std::iter::repeat_n;

use glam::Vec3;
use infonerf_field::{Extent, Field, Points};
use infonerf_ops::composite::alpha;
use infonerf_ops::{HostField, Segments, to_host, upload};
use infonerf_scene::Ray;
use infonerf_schedule::Moment;
use rayon::prelude::*;

use crate::config::Compositing;
use crate::model::TrainedModel;
use crate::output::Counts;
use crate::renderer::Renderer;
use crate::steps::UniformSteps;

/// Accumulated colour, distance and transmittance of a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CompositedRay {
    pub(crate) rgb: Vec3,
    /// Σ w t.
    pub(crate) depth: f32,
    pub(crate) trans: f32,
}

/// Samples per ray and round on a device: few, as rays stop soon after a surface. On the host a round costs no launch, and has
/// one, so that no sample lies behind the end of a ray.
const ROUND: usize = 4;
/// Optical depths of a step, in units of e/T, below which two steps share one sample, and four steps.
const JOINED: [f32; 2] = [100.0, 10.0];
/// Maximal number of rays of a [`RayPart`].
const PART: usize = 1 << 10;

/// Marches along `rays`, and returns each ray's colour on the background, distance and transmittance, and the numbers
/// of samples.
///
/// In each round the field is evaluated once for all parts of the rays. If `host` is given, it is the field on the host,
/// and each part marches by itself.
pub(crate) fn march<F: Field>(
    renderer: &Renderer,
    trained: &TrainedModel<F>,
    host: Option<&HostField>,
    rays: &[Ray],
) -> (Vec<CompositedRay>, Counts) {
    let mut parts: Vec<RayPart<'_>> = rays.par_chunks(PART).map(|rays| RayPart::new(renderer, trained, rays)).collect();
    match host {
        Some(host) => parts.par_iter_mut().for_each(|part| {
            while let Some(round) = part.next_round(1) {
                let rays = round.rays.iter().zip(&round.counts);
                let directions = rays.flat_map(|(ray, &count)| repeat_n(ray.direction.to_array(), count));
                part.composite(&round, &host(&round.positions, &directions.collect::<Vec<_>>()));
            }
        }),
        None => loop {
            let next = parts.par_iter_mut().filter_map(|part| part.next_round(ROUND).map(|round| (part, round)));
            let rounds: Vec<_> = next.collect();
            if rounds.is_empty() {
                break;
            }
            let values = evaluate(&trained.model.fine, rounds.iter().map(|(_, round)| round), trained.at);
            let mut values = values.as_slice();
            let values: Vec<_> = rounds.iter().map(|(_, round)| values.split_off(..round.t.len())).collect();
            rounds.into_par_iter().zip(values).for_each(|((part, round), values)| {
                part.composite(&round, values.expect("a value of each sample"));
            });
        },
    }
    let total = rays.len() as u64 * renderer.max_samples(trained.at) as u64;
    let counts = Counts { total, evaluated: parts.iter().map(|part| part.evaluated).sum() };
    let background = Vec3::from(renderer.background);
    let behind = |ray: CompositedRay| CompositedRay { rgb: ray.rgb + ray.trans * background, ..ray };
    (parts.into_iter().flat_map(|part| part.composited).map(behind).collect(), counts)
}

/// Evaluates σ, r, g, b of each sample of `rounds`.
fn evaluate<'a, F: Field>(
    field: &F,
    rounds: impl Iterator<Item = &'a MarchRound> + Clone,
    at: Moment,
) -> Vec<[f32; 4]> {
    let device = field.device();
    let rays = rounds.clone().flat_map(|round| &round.rays);
    let join = |of: fn(&MarchRound) -> &[f32]| rounds.clone().map(of).collect::<Vec<_>>().concat();
    let segments = Segments::from_counts(rounds.clone().flat_map(|round| round.counts.iter().copied()));
    let (samples, count) = (segments.samples(), segments.rays());
    let positions = upload(join(|round| round.positions.as_flattened()), [samples, 3], &device);
    let directions = upload(rays.clone().flat_map(|ray| ray.direction.to_array()).collect(), [count, 3], &device);
    let t = upload(join(|round| &round.t), [samples], &device);
    let delta = upload(join(|round| &round.delta), [samples], &device);
    let radii = upload(rays.map(|ray| ray.radius).collect(), [count], &device);
    let points = Points { positions, directions, segments, extent: Extent::Cones { t, delta, radii } };
    let sampled = field.evaluate(&points, true, at);
    let color = to_host(sampled.color.expect("colour was asked for"));
    let values = to_host(sampled.sigma).into_iter().zip(color.as_chunks::<3>().0);
    values.map(|(sigma, &[r, g, b])| [sigma, r, g, b]).collect()
}

/// At most [`PART`] rays of a picture, with the steps and the composited samples of each.
struct RayPart<'a> {
    renderer: &'a Renderer,
    rays: &'a [Ray],
    steps: Vec<Option<UniformSteps<'a>>>,
    composited: Vec<CompositedRay>,
    /// Indices of the rays that have not stopped.
    active: Vec<usize>,
    evaluated: u64,
}

#[derive(Default)]
struct MarchRound {
    /// Samples of each ray that has not stopped.
    counts: Vec<usize>,
    /// The active rays, parallel to `counts`.
    rays: Vec<Ray>,
    /// Distance of each sample.
    t: Vec<f32>,
    delta: Vec<f32>,
    positions: Vec<[f32; 3]>,
}

impl<'a> RayPart<'a> {
    fn new<F: Field>(renderer: &'a Renderer, trained: &'a TrainedModel<F>, rays: &'a [Ray]) -> Self {
        let (step, grid) = (renderer.step_length(trained.at), trained.occupancy.as_ref());
        let steps =
            |ray: &Ray| renderer.interval(ray).map(|ends| UniformSteps::new(renderer, ray, ends, (step, 0.5), grid));
        let steps = rays.iter().map(steps).collect();
        let composited = vec![CompositedRay { rgb: Vec3::ZERO, depth: 0.0, trans: 1.0 }; rays.len()];
        Self { renderer, rays, steps, composited, active: (0..rays.len()).collect(), evaluated: 0 }
    }

    /// Returns the next `samples` samples of each ray that has not stopped; `None` if all have.
    fn next_round(&mut self, samples: usize) -> Option<MarchRound> {
        let mut round = MarchRound::default();
        let stop = self.renderer.config.early_stop_transmittance;
        self.active.retain(|&index| {
            let (ray, before) = (&self.rays[index], round.t.len());
            let Some(steps) = &mut self.steps[index] else { return false };
            steps.join(JOINED.map(|depth| depth * stop / self.composited[index].trans));
            for step in steps.take(samples) {
                round.t.push(step.t);
                round.delta.push(step.delta);
                round.positions.push(step.point.to_array());
            }
            let count = round.t.len() - before;
            if count > 0 {
                round.counts.push(count);
                round.rays.push(*ray);
            }
            count > 0
        });
        self.evaluated += round.t.len() as u64;
        (!self.active.is_empty()).then_some(round)
    }

    /// Composites the samples of a round; `values` are their σ, r, g, b.
    fn composite(&mut self, round: &MarchRound, values: &[[f32; 4]]) {
        let config = &self.renderer.config;
        let mut samples = round.t.iter().zip(&round.delta).zip(values);
        let mut counts = round.counts.iter();
        self.active.retain(|&index| {
            let ray = &mut self.composited[index];
            for ((&t, delta), &[sigma, ref color @ ..]) in samples.by_ref().take(*counts.next().expect("one per ray")) {
                ray.add(config.compositing, sigma * delta, t, *color);
            }
            ray.trans > config.early_stop_transmittance
        });
    }
}

impl CompositedRay {
    /// Composites a sample of optical depth `tau` at distance `t` behind what is there.
    fn add(&mut self, compositing: Compositing, tau: f32, t: f32, color: [f32; 3]) {
        let w = match compositing {
            Compositing::Exponential => self.trans * alpha(tau),
            Compositing::Additive => tau.min(self.trans),
        };
        self.rgb += w * Vec3::from(color);
        self.depth += w * t;
        self.trans -= w;
    }
}
