//! Kernels of ray entropy: one thread per ray.

use burn::cubecl::{self, prelude::*};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

use super::MIN_ALPHA_SUM;
use crate::cube::rays::{RayMass, alpha_of, first_sample, ln_1p, mass_of};
use crate::cube::{Operation, Pass, empty, empty_like, launch};
use crate::segments::Segments;

/// Operation whose output is a row of bits and Σα per ray, `[R, 2]`.
#[derive(Debug)]
pub(super) struct GpuEntropy {
    pub(super) segments: Segments,
    pub(super) epsilon: f32,
}

impl Operation<CubeBackend> for GpuEntropy {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let (tau, rays) = (&inputs[0], self.segments.rays());
        let (offsets, out) = (self.segments.offsets_on_device_of(tau), empty(tau, [rays, 2]));
        launch!(entropy_forward::launch, rays; tau, &offsets, &out; self.epsilon, MIN_ALPHA_SUM);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (tau, rays) = (&pass.inputs[0], self.segments.rays());
        let (offsets, dtau) = (self.segments.offsets_on_device_of(tau), empty_like(tau));
        launch!(entropy_backward::launch, rays; tau, &offsets, pass.grad, &dtau; self.epsilon, MIN_ALPHA_SUM);
        vec![Some(dtau)]
    }
}

/// Computes ln(p + ε) of a sample. If ε is 0, α counts as at least the smallest normal `f32`.
#[cube]
fn ln_density(alpha: f32, sample: usize, masses: &RayMass, epsilon: f32) -> f32 {
    let mut ln = f32::ln(alpha / masses.sum + epsilon);
    if epsilon == 0.0f32 {
        ln = f32::ln(f32::max(alpha, 1.175_494_4e-38f32)) - f32::ln(masses.sum);
    }
    if sample == masses.top && 2.0f32 * masses.rest < masses.sum {
        ln = ln_1p(epsilon - masses.rest / masses.sum);
    }
    ln
}

/// Writes a ray's entropy in bits and Σα.
#[cube(launch)]
fn entropy_forward(tau: &Tensor<f32>, offsets: &Tensor<i32>, out: &mut Tensor<f32>, epsilon: f32, min_sum: f32) {
    let ray = ABSOLUTE_POS;
    if ray >= out.shape(0) {
        terminate!();
    }
    let (start, end) = (first_sample(offsets, ray), first_sample(offsets, ray + 1));
    let masses = mass_of(tau, start, end);
    let missed = masses.sum < min_sum;
    let mut entropy = 0.0f32;
    if !missed {
        for i in start..end {
            let alpha = alpha_of(tau[i]);
            entropy -= alpha / masses.sum * ln_density(alpha, i, &masses, epsilon) * std::f32::consts::LOG2_E;
        }
    }
    out[2 * ray] = entropy;
    out[2 * ray + 1] = masses.sum;
}

#[cube(launch)]
fn entropy_backward(
    tau: &Tensor<f32>,
    offsets: &Tensor<i32>,
    grad: &Tensor<f32>,
    dtau: &mut Tensor<f32>,
    epsilon: f32,
    min_sum: f32,
) {
    let ray = ABSOLUTE_POS;
    if ray >= grad.shape(0) {
        terminate!();
    }
    let (start, end) = (first_sample(offsets, ray), first_sample(offsets, ray + 1));
    let masses = mass_of(tau, start, end);
    for i in start..end {
        dtau[i] = grad[2 * ray + 1] * f32::exp(-tau[i]);
    }
    let missed = masses.sum < min_sum;
    if !missed {
        let scale = grad[2 * ray] * std::f32::consts::LOG2_E;
        let common = entropy_gradient(tau[masses.top], masses.top, &masses, epsilon);
        let mut mean = 0.0f32;
        for i in start..end {
            let dp = entropy_gradient(tau[i], i, &masses, epsilon);
            mean += alpha_of(tau[i]) / masses.sum * (dp - common);
        }
        for i in start..end {
            let dp = entropy_gradient(tau[i], i, &masses, epsilon) - common - mean;
            dtau[i] += scale * dp / masses.sum * f32::exp(-tau[i]);
        }
    }
}

/// Computes ∂H/∂p + 1 in nats. The constant cancels by normalisation.
#[cube]
fn entropy_gradient(tau: f32, sample: usize, masses: &RayMass, epsilon: f32) -> f32 {
    let alpha = alpha_of(tau);
    let mut dp = -ln_density(alpha, sample, masses, epsilon);
    if epsilon > 0.0f32 {
        dp += epsilon / (alpha / masses.sum + epsilon);
    }
    dp
}
