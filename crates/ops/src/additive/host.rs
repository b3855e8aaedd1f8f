use rayon::prelude::*;

use crate::host::{Kernel, Pass};
use crate::segments::Segments;

/// Input: τ. Output: τ′ of each sample, `[M]`.
#[derive(Debug)]
pub(super) struct AdditiveKernel {
    pub(super) segments: Segments,
}

impl AdditiveKernel {
    /// Calls `of(ray's tau, ray's part of out, ray's first sample)` for each ray.
    fn each_ray(&self, tau: &[f32], out: &mut [f32], of: impl Fn(&[f32], &mut [f32], usize) + Sync) {
        self.segments.groups().zip(self.segments.split_mut(out, 1)).for_each(|(group, out)| {
            let first = group.samples().start;
            let tau = &tau[group.samples()];
            for range in group.ranges() {
                of(&tau[range.clone()], &mut out[range.clone()], first + range.start);
            }
        });
    }
}

impl Kernel for AdditiveKernel {
    fn forward(&self, inputs: &[&[f32]]) -> Vec<f32> {
        let tau = inputs[0];
        let mut out = vec![0.0; tau.len()];
        self.each_ray(tau, &mut out, |tau, out, _| {
            let mut left = 1f64;
            for (tau, out) in tau.iter().zip(out) {
                let tau = f64::from(*tau);
                if tau >= left {
                    *out = f32::INFINITY;
                    break;
                }
                *out = -(-tau / left).ln_1p() as f32;
                left -= tau;
            }
        });
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<Vec<f32>>> {
        let tau = pass.inputs[0];
        let mut dtau = vec![0.0; tau.len()];
        self.each_ray(tau, &mut dtau, |tau, dtau, first| {
            // 1 − A behind each sample in front of the one that fills the ray.
            let left: Vec<f64> = tau
                .iter()
                .scan(1f64, |left, &tau| {
                    *left -= f64::from(tau);
                    Some(*left)
                })
                .take_while(|left| *left > 0.0)
                .collect();
            // With τ′ᵢ = ln(left before i) − ln(left behind i): dL/dτⱼ = Σ_{i≥j} (gᵢ − gᵢ₊₁)/left behind i.
            let (mut sum, mut behind) = (0f64, 0f64);
            for (i, left) in left.iter().enumerate().rev() {
                let grad = f64::from(pass.grad[first + i]);
                sum += (grad - behind) / left;
                behind = grad;
                dtau[i] = sum as f32;
            }
        });
        vec![Some(dtau)]
    }
}
