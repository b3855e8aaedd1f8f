//! Errors of the divergence of neighbouring rays in both directions, with both gradients.

use burn::tensor::Device;
use fastrand::Rng;
use infonerf_ops::{Segments, ray_divergence, to_host};
use rayon::prelude::*;

use super::errors::Errors;
use super::rays::DrawPair;
use crate::values::{gradient_of, leaf, wide};

pub(super) const QUANTITIES: [&str; 3] = ["divergence", "divergence, reversed", "divergence, eps 1e-12"];
/// The released code's ε.
const EPSILON: f32 = 1e-10;
/// Minimum ε that a config allows.
const MIN_EPSILON: f32 = 1e-12;
const BATCH: usize = 10_000;

/// Measures the errors of each of [`QUANTITIES`] over `count` pairs of rays.
pub(super) fn measure(draw: DrawPair, count: usize, device: &Device, rng: &mut Rng) -> Vec<Errors> {
    let mut errors = vec![Errors::default(); QUANTITIES.len()];
    for batch in (0..count).step_by(BATCH).map(|done| BATCH.min(count - done)) {
        let (rays, near): (Vec<_>, Vec<_>) = (0..batch).map(|_| draw(rng)).unzip();
        for (errors, (p, q, epsilon)) in
            errors.iter_mut().zip([(&rays, &near, EPSILON), (&near, &rays, EPSILON), (&rays, &near, MIN_EPSILON)])
        {
            *errors = errors.merged(compare(p, q, epsilon, device));
        }
    }
    errors
}

fn compare(rays: &[Vec<f32>], near: &[Vec<f32>], epsilon: f32, device: &Device) -> Errors {
    let segments = Segments::from_counts(rays.iter().map(Vec::len));
    let [p, q] = [rays, near].map(|rows| leaf(&rows.concat(), device));
    let divergence = ray_divergence(p.clone(), q.clone(), &segments, epsilon);
    let values = to_host(divergence.clone().detach());
    let grads = divergence.sum().backward();
    let [dp, dq] = [&p, &q].map(|tensor| gradient_of(tensor, &grads));
    let one = |mut errors: Errors, ray: usize| {
        let (p, q, range) = (wide(&rays[ray]), wide(&near[ray]), segments.range(ray));
        errors.value(values[ray], infonerf_oracle::divergence(&p, &q, f64::from(epsilon)));
        let (want_p, want_q) = infonerf_oracle::divergence_gradient(&p, &q, f64::from(epsilon));
        errors.gradient(&dp[range.clone()], &want_p, |_| false);
        errors.gradient(&dq[range], &want_q, |_| false);
        errors
    };
    (0..rays.len()).into_par_iter().fold(Errors::default, one).reduce(Errors::default, Errors::merged)
}
