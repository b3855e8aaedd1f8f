//! Pictures of a single pass, front to back.
//!
//! Rays advance a few samples at a time, and stop once their transmittance is at most
//! `render.early_stop_transmittance`: the weights of skipped samples sum to no more than that.

use infonerf_field::{Extent, Field, Points};
use infonerf_ops::{Segments, numeric, to_host, upload};
use infonerf_scene::Ray;
use rayon::prelude::*;

use crate::sampler::Skip;
use crate::{Compositing, Counts, Renderer, TrainedModel};

/// A ray with what it has accumulated so far.
#[derive(Clone, Debug, Default)]
pub(crate) struct Marched {
    pub(crate) rgb: [f32; 3],
    /// Σ w t.
    pub(crate) depth: f32,
    /// Transmittance so far.
    pub(crate) trans: f32,
    steps: Vec<(f32, f32)>,
    next: usize,
}

/// Samples per ray and round: few, as rays stop soon after a surface.
const ROUND: usize = 4;

/// Colour on the background, distance and transmittance of each of `rays`, and the numbers of samples.
pub(crate) fn march<F: Field>(renderer: &Renderer, trained: &TrainedModel<F>, rays: &[Ray]) -> (Vec<Marched>, Counts) {
    let sampler = renderer.sampler();
    let field = &trained.model.fine;
    let (longest, step) = (sampler.longest(), sampler.step_length(trained.at));
    let (least, compositing) = (sampler.config().early_stop_transmittance, sampler.config().compositing);
    let skip = Skip { grid: trained.occupancy.as_ref(), hidden_depth: f32::INFINITY };
    let mut counts = Counts { total: (rays.len() as f32 * longest / step) as u64, evaluated: 0 };
    let mut marched: Vec<Marched> = rays
        .par_iter()
        .map(|ray| Marched { trans: 1.0, steps: sampler.steps(ray, step, 0.5, skip), ..Marched::default() })
        .collect();
    let mut active: Vec<usize> = (0..rays.len()).filter(|&ray| !marched[ray].steps.is_empty()).collect();
    while !active.is_empty() {
        let lengths = active.iter().map(|&ray| ROUND.min(marched[ray].steps.len() - marched[ray].next));
        let segments = Segments::from_counts(lengths);
        counts.evaluated += segments.samples() as u64;
        let steps_of = |(index, &ray): (usize, &usize)| {
            let (from, count) = (marched[ray].next, segments.range(index).len());
            marched[ray].steps[from..from + count].iter()
        };
        let position =
            |(index, ray)| steps_of((index, ray)).flat_map(|(t, _)| sampler.warp().point(rays[*ray].at(*t)).to_array());
        let positions: Vec<f32> = active.par_iter().enumerate().flat_map_iter(position).collect();
        let (t, delta): (Vec<f32>, Vec<f32>) = active.iter().enumerate().flat_map(steps_of).copied().unzip();
        let directions: Vec<f32> = active.iter().flat_map(|&ray| rays[ray].direction.to_array()).collect();
        let radii: Vec<f32> = active.iter().map(|&ray| rays[ray].radius).collect();
        let (samples, device) = (segments.samples(), field.device());
        let points = Points {
            positions: upload(positions, [samples, 3], &device),
            directions: upload(directions, [active.len(), 3], &device),
            segments: segments.clone(),
            extent: Extent::Cones {
                t: upload(t, [samples], &device),
                delta: upload(delta, [samples], &device),
                radii: upload(radii, [active.len()], &device),
            },
        };
        let sampled = field.evaluate(&points, true, trained.at);
        let sigma = to_host(sampled.sigma);
        let color = to_host(sampled.color.expect("colour was asked for"));
        let mut advancing = active.iter().copied().enumerate().peekable();
        let in_turn: Vec<(usize, &mut Marched)> = marched
            .iter_mut()
            .enumerate()
            .filter_map(|(ray, marched)| {
                let (index, _) = advancing.next_if(|(_, active)| *active == ray)?;
                Some((index, marched))
            })
            .collect();
        in_turn.into_par_iter().for_each(|(index, ray)| {
            let range = segments.range(index);
            ray.advance(compositing, &sigma[range.clone()], &color[3 * range.start..3 * range.end]);
        });
        active.retain(|&ray| {
            let ray = &marched[ray];
            ray.next < ray.steps.len() && ray.trans > least
        });
    }
    let background = renderer.background();
    for ray in &mut marched {
        for (value, behind) in ray.rgb.iter_mut().zip(background) {
            *value += ray.trans * behind;
        }
    }
    (marched, counts)
}

impl Marched {
    fn advance(&mut self, compositing: Compositing, sigma: &[f32], color: &[f32]) {
        let steps = &self.steps[self.next..self.next + sigma.len()];
        for ((&(t, delta), sigma), color) in steps.iter().zip(sigma).zip(color.chunks_exact(3)) {
            let tau = sigma * delta;
            let (w, trans) = match compositing {
                Compositing::Exponential => (self.trans * numeric::alpha(tau), self.trans * (-tau).exp()),
                Compositing::Additive => (tau.min(self.trans), (self.trans - tau).max(0.0)),
            };
            for (sum, c) in self.rgb.iter_mut().zip(color) {
                *sum += w * c;
            }
            self.depth += w * t;
            self.trans = trans;
        }
        self.next += sigma.len();
    }
}
