//! Pictures of a single pass, composited front to back.
//!
//! Rays advance a few samples at a time, and stop once their transmittance T is at most e =
//! `render.early_stop_transmittance`: the weights of skipped samples sum to at most e. Steps are longer in thin fog and
//! behind much of it. Where the finer grid of pictures bounds the optical depth of a step by 100 e/T, two steps share one
//! sample in their middle; below 10 e/T, four steps do. Such a sample has a weight of at most 200 e, and differs from the
//! samples that it replaces by a fraction of that. With e = 0 pictures are exact.
//!
//! Members of an ensemble see nearly the same surfaces. So with e > 0 only the first one searches all rays for them. Where its
//! rays are opaque and their distances smooth, the fields of the others are evaluated at its visible samples alone; a
//! ray that these samples do not explain is marched as a whole.

use std::iter::repeat_n;

use glam::Vec3;
use infonerf_field::{Extent, Field, Points};
use infonerf_ops::{HostField, Segments, numeric, to_host, upload};
use infonerf_scene::Ray;
use infonerf_schedule::Moment;
use rayon::prelude::*;

use crate::config::Compositing;
use crate::model::TrainedModel;
use crate::occupancy::OccupancyGrid;
use crate::output::Counts;
use crate::renderer::Renderer;
use crate::steps::UniformSteps;

/// Accumulated colour, distance and transmittance of a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MarchedRay {
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
/// Weight above which the other members share a sample of the first one's ray, and the last sample in front of these.
const SHARED: f32 = 1e-3;
/// Maximal weight of a ray's first shared sample: with more, matter may lie in front of it.
const IN_FRONT: f32 = 0.1;
/// Maximal transmittance behind a ray's shared samples: with more, matter may lie behind them.
const BEHIND: f32 = 0.02;
/// Maximal relative difference between the distance of a pixel and those of its neighbours where members share samples.
/// Members differ most in where a surface ends.
const EDGE: f32 = 0.01;
/// Maximal number of rays of a [`MarchingRays`].
const PART: usize = 1 << 10;

/// Marches along the rays of the members of an ensemble.
pub(crate) struct Marching<'a, F: Field> {
    renderer: &'a Renderer,
    members: &'a [TrainedModel<F>],
    /// Each member's field on the host, if it can be evaluated there.
    hosts: Vec<Option<HostField>>,
}

impl<'a, F: Field> Marching<'a, F> {
    pub(crate) fn new(renderer: &'a Renderer, members: &'a [TrainedModel<F>]) -> Self {
        let hosts = members.iter().map(|member| member.model.fine.on_host(member.at)).collect();
        Self { renderer, members, hosts }
    }

    /// Marches along each member's `rays` of the same pixels, which fill rows of `width`, and returns each ray's colour on the
    /// background, distance and transmittance, and the numbers of samples.
    pub(crate) fn march(&self, rays: Vec<Vec<Ray>>, width: usize) -> Vec<(Vec<MarchedRay>, Counts)> {
        let shares = self.members.len() > 1 && self.renderer.config.early_stop_transmittance > 0.0;
        let mut shared: Vec<Vec<SharedSample>> = Vec::new();
        let mut marched = Vec::with_capacity(rays.len());
        for ((trained, host), rays) in self.members.iter().zip(&self.hosts).zip(&rays) {
            let begin = |(part, rays)| {
                let shared = (!shared.is_empty()).then(|| &shared[part * PART..]);
                MarchingRays::new(self.renderer, trained, rays, shared)
            };
            let mut parts: Vec<MarchingRays<'_>> = rays.par_chunks(PART).enumerate().map(begin).collect();
            let is_first = shares && shared.is_empty();
            if is_first {
                parts.iter_mut().for_each(|part| part.visible = vec![Vec::new(); part.rays.len()]);
            }
            march_parts(&mut parts, trained, host.as_ref());
            marched.push(self.marched(trained, &parts));
            if is_first {
                shared = self.shared_samples(parts, width);
            }
        }
        marched
    }

    /// Returns the samples to be shared of each opaque ray whose neighbours are as far away.
    fn shared_samples(&self, parts: Vec<MarchingRays<'_>>, width: usize) -> Vec<Vec<SharedSample>> {
        let stop = self.renderer.config.early_stop_transmittance;
        let distance = |ray: &MarchedRay| if ray.trans > stop { f32::INFINITY } else { ray.depth / (1.0 - ray.trans) };
        let distances: Vec<f32> = parts.iter().flat_map(|part| &part.marched).map(distance).collect();
        let is_smooth = |index: usize| {
            let own = distances[index];
            let is_near = |place: usize| distances.get(place).is_none_or(|next| (next - own).abs() <= EDGE * own);
            let both_sides = |away| is_near(index + away) && index.checked_sub(away).is_none_or(is_near);
            own.is_finite() && [1, 2, width, 2 * width].into_iter().all(both_sides)
        };
        let visible = parts.into_iter().flat_map(|part| part.visible).enumerate();
        visible.map(|(index, samples)| if is_smooth(index) { samples } else { Vec::new() }).collect()
    }

    fn marched(&self, trained: &TrainedModel<F>, parts: &[MarchingRays<'_>]) -> (Vec<MarchedRay>, Counts) {
        let background = Vec3::from(self.renderer.background);
        let behind = |ray: &MarchedRay| MarchedRay { rgb: ray.rgb + ray.trans * background, ..*ray };
        let marched: Vec<MarchedRay> = parts.iter().flat_map(|part| &part.marched).map(behind).collect();
        let total = (marched.len() as f32 * self.renderer.longest / self.renderer.step_length(trained.at)) as u64;
        (marched, Counts { total, evaluated: parts.iter().map(|part| part.evaluated).sum() })
    }
}

/// Marches until all rays of `parts` have stopped.
///
/// In each round the field is evaluated once for all parts of the rays. If `host` is given, it is the field on the host,
/// and each part marches by itself.
fn march_parts<F: Field>(parts: &mut [MarchingRays<'_>], trained: &TrainedModel<F>, host: Option<&HostField>) {
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

/// Sample of the first member's ray that the other members' rays through the same pixel share.
#[derive(Clone, Copy, Debug)]
struct SharedSample {
    /// Distance from the camera, in the scene's units.
    t: f32,
    /// Length of the sample's interval, in the scene's units.
    length: f32,
}

struct MarchingRays<'a> {
    renderer: &'a Renderer,
    grid: Option<&'a OccupancyGrid>,
    step_length: f32,
    /// Length of the scene's unit in the frame of the rays.
    scale: f32,
    rays: &'a [Ray],
    /// Steps of the rays that march by themselves.
    steps: Vec<Option<UniformSteps<'a>>>,
    marched: Vec<MarchedRay>,
    /// Indices of the rays that have not stopped.
    active: Vec<usize>,
    /// Samples of each ray to be composited first; none for a ray that marches by itself.
    shared: Option<&'a [Vec<SharedSample>]>,
    /// Visible samples of each ray and the last one in front of them; empty if no other member shares them.
    visible: Vec<Vec<SharedSample>>,
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
    /// Whether the samples are those of the first member.
    is_shared: bool,
}

impl<'a> MarchingRays<'a> {
    fn new<F: Field>(
        renderer: &'a Renderer,
        trained: &'a TrainedModel<F>,
        rays: &'a [Ray],
        shared: Option<&'a [Vec<SharedSample>]>,
    ) -> Self {
        let mut new = Self {
            renderer,
            grid: trained.occupancy.as_ref(),
            step_length: renderer.step_length(trained.at),
            scale: trained.scale(),
            rays,
            steps: vec![None; rays.len()],
            marched: vec![MarchedRay::START; rays.len()],
            active: (0..rays.len()).collect(),
            shared,
            visible: Vec::new(),
            evaluated: 0,
        };
        if shared.is_none() {
            new.start();
        }
        new
    }

    /// Lets the active rays march by themselves from their beginning.
    fn start(&mut self) {
        for &index in &self.active {
            let ray = &self.rays[index];
            let steps = |ends| UniformSteps::new(self.renderer, ray, ends, (self.step_length, 0.5), self.grid);
            self.steps[index] = self.renderer.interval(ray).map(steps);
            self.marched[index] = MarchedRay::START;
        }
    }

    /// Returns the next `samples` samples of each ray that has not stopped, or first all shared ones; `None` if all rays
    /// have stopped.
    fn next_round(&mut self, samples: usize) -> Option<MarchRound> {
        if let Some(shared) = self.shared.take() {
            let round = self.shared_round(shared);
            if !round.t.is_empty() {
                return Some(round);
            }
            self.start();
        }
        let mut round = MarchRound::default();
        let stop = self.renderer.config.early_stop_transmittance;
        self.active.retain(|&index| {
            let (ray, before) = (&self.rays[index], round.t.len());
            let Some(steps) = &mut self.steps[index] else { return false };
            steps.join(JOINED.map(|depth| depth * stop / self.marched[index].trans));
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

    fn shared_round(&mut self, shared: &[Vec<SharedSample>]) -> MarchRound {
        let mut round = MarchRound { is_shared: true, ..MarchRound::default() };
        let warp = self.renderer.warp();
        for (ray, samples) in self.rays.iter().zip(shared) {
            round.counts.push(samples.len());
            round.rays.push(*ray);
            for sample in samples {
                let t = self.scale * sample.t;
                round.t.push(t);
                round.delta.push(self.scale * sample.length * warp.rate(t));
                round.positions.push(warp.point(ray.at(t)).to_array());
            }
        }
        self.evaluated += round.t.len() as u64;
        round
    }

    /// Composites the samples of a round; `values` are their σ, r, g, b. Rays that shared samples do not explain start.
    fn composite(&mut self, round: &MarchRound, values: &[[f32; 4]]) {
        let (config, warp) = (&self.renderer.config, self.renderer.warp());
        let mut samples = round.t.iter().zip(&round.delta).zip(values);
        let mut counts = round.counts.iter();
        self.active.retain(|&index| {
            let ray = &mut self.marched[index];
            let mut first = None;
            for ((&t, delta), &[sigma, ref color @ ..]) in samples.by_ref().take(*counts.next().expect("one per ray")) {
                let weight = ray.add(config.compositing, sigma * delta, t, *color);
                first.get_or_insert(weight);
                if let Some(visible) = self.visible.get_mut(index) {
                    let is_clear = ray.trans > 1.0 - SHARED;
                    if is_clear {
                        visible.clear();
                    }
                    if is_clear || weight > SHARED {
                        let length = delta / (warp.rate(t) * self.scale);
                        visible.push(SharedSample { t: t / self.scale, length });
                    }
                }
            }
            if !round.is_shared {
                return ray.trans > config.early_stop_transmittance;
            }
            let is_explained = ray.trans <= BEHIND && first.is_some_and(|weight| weight <= IN_FRONT);
            if is_explained {
                ray.make_opaque();
            }
            !is_explained
        });
        if round.is_shared {
            self.start();
        }
    }
}

impl MarchedRay {
    /// Ray that has met nothing.
    const START: Self = Self { rgb: Vec3::ZERO, depth: 0.0, trans: 1.0 };

    /// Lets the rest of the ray have the mean colour and distance of its samples.
    fn make_opaque(&mut self) {
        let share = 1.0 / (1.0 - self.trans);
        *self = Self { rgb: share * self.rgb, depth: share * self.depth, trans: 0.0 };
    }

    /// Composites a sample of optical depth `tau` at distance `t` behind what is there, and returns its weight.
    fn add(&mut self, compositing: Compositing, tau: f32, t: f32, color: [f32; 3]) -> f32 {
        let w = match compositing {
            Compositing::Exponential => self.trans * numeric::alpha(tau),
            Compositing::Additive => tau.min(self.trans),
        };
        self.rgb += w * Vec3::from(color);
        self.depth += w * t;
        self.trans -= w;
        w
    }
}
