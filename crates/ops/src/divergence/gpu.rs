//! Kernels of the divergence of neighbouring rays: one thread per pair of rays.

use burn::cubecl::{self, prelude::*};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

use crate::cube::rays::{alpha_of, first_sample, ln_1p, mass_of};
use crate::cube::{Operation, Pass, arg, empty, empty_like, launch};
use crate::entropy::MIN_ALPHA_SUM;
use crate::segments::Segments;

#[derive(Debug)]
pub(super) struct GpuDivergence {
    pub(super) segments: Segments,
    pub(super) epsilon: f32,
}

impl GpuDivergence {
    fn pairs(&self, inputs: &[CubeTensor]) -> RayPairsLaunch {
        let [tau, near] = inputs else { unreachable!("a divergence has two inputs") };
        let offsets = self.segments.offsets_on_device_of(tau);
        RayPairsLaunch::new(arg(tau), arg(near), arg(&offsets), self.epsilon, MIN_ALPHA_SUM)
    }
}

impl Operation<CubeBackend> for GpuDivergence {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let out = empty(&inputs[0], [self.segments.rays()]);
        launch!(divergence_forward::launch, self.segments.rays(); &out; self.pairs(inputs));
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (dtau, dnear) = (empty_like(&pass.inputs[0]), empty_like(&pass.inputs[1]));
        launch!(divergence_backward::launch, self.segments.rays(); pass.grad, &dtau, &dnear; self.pairs(pass.inputs));
        vec![Some(dtau), Some(dnear)]
    }
}

/// Paired rays with the same number of samples.
#[derive(CubeType, CubeLaunch)]
struct RayPairs {
    tau: OwnedTensor<f32>,
    near: OwnedTensor<f32>,
    offsets: OwnedTensor<i32>,
    epsilon: f32,
    min_sum: f32,
}

/// Computes (1 + r) ln(1 + r) − r ≥ 0, of second order in r, given ln(1 + r).
#[cube]
fn bregman(r: f32, ln: f32) -> f32 {
    let mut excess = (1.0f32 + r) * ln - r;
    if f32::abs(r) < 0.1f32 {
        let tail = 1.0f32 / 20.0f32 - r * (1.0f32 / 30.0f32 - r * (1.0f32 / 42.0f32 - r / 56.0f32));
        excess = r * r * (1.0f32 / 2.0f32 - r * (1.0f32 / 6.0f32 - r * (1.0f32 / 12.0f32 - r * tail)));
    }
    excess
}

/// Computes ln((p + ε)/(q + ε)), given r = (p − q)/(q + ε).
#[cube]
fn ln_ratio(p: f32, q: f32, r: f32, epsilon: f32) -> f32 {
    let mut ln = ln_1p(r);
    if f32::abs(r) >= 0.5f32 {
        ln = f32::ln((p + epsilon) / (q + epsilon));
    }
    ln
}

/// Writes the KL divergence of each pair of rays, in nats.
#[cube(launch)]
fn divergence_forward(out: &mut Tensor<f32>, pairs: &RayPairs) {
    let ray = ABSOLUTE_POS;
    if ray >= out.shape(0) {
        terminate!();
    }
    let (start, end) = (first_sample(&pairs.offsets, ray), first_sample(&pairs.offsets, ray + 1));
    let (masses, other) = (mass_of(&pairs.tau, start, end), mass_of(&pairs.near, start, end));
    let epsilon = pairs.epsilon;
    let missed = masses.sum < pairs.min_sum || other.sum < pairs.min_sum;
    let mut divergence = 0.0f32;
    if !missed {
        for i in start..end {
            let (p, q) = (alpha_of(pairs.tau[i]) / masses.sum, alpha_of(pairs.near[i]) / other.sum);
            let r = (p - q) / (q + epsilon);
            let ln = ln_ratio(p, q, r, epsilon);
            divergence += (q + epsilon) * bregman(r, ln) - epsilon * ln;
        }
    }
    out[ray] = divergence;
}

#[cube(launch)]
fn divergence_backward(grad: &Tensor<f32>, dtau: &mut Tensor<f32>, dnear: &mut Tensor<f32>, pairs: &RayPairs) {
    let ray = ABSOLUTE_POS;
    if ray >= grad.shape(0) {
        terminate!();
    }
    let (start, end) = (first_sample(&pairs.offsets, ray), first_sample(&pairs.offsets, ray + 1));
    let (masses, other) = (mass_of(&pairs.tau, start, end), mass_of(&pairs.near, start, end));
    let epsilon = pairs.epsilon;
    let missed = masses.sum < pairs.min_sum || other.sum < pairs.min_sum;
    // ∂KL/∂p and ∂KL/∂q are kept in the results until their means are known.
    let mut mean_p = 0.0f32;
    let mut mean_q = 0.0f32;
    for i in start..end {
        let (p, q) = (alpha_of(pairs.tau[i]) / masses.sum, alpha_of(pairs.near[i]) / other.sum);
        let r = (p - q) / (q + epsilon);
        dtau[i] = 0.0f32;
        dnear[i] = 0.0f32;
        if !missed {
            dtau[i] = ln_ratio(p, q, r, epsilon) - epsilon / (p + epsilon);
            dnear[i] = epsilon / (q + epsilon) - r;
            mean_p += p * dtau[i];
            mean_q += q * dnear[i];
        }
    }
    if !missed {
        for i in start..end {
            dtau[i] = grad[ray] * (dtau[i] - mean_p) / masses.sum * f32::exp(-pairs.tau[i]);
            dnear[i] = grad[ray] * (dnear[i] - mean_q) / other.sum * f32::exp(-pairs.near[i]);
        }
    }
}
