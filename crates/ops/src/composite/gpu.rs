//! Kernels of compositing: one thread per ray, which walks along its samples.
//!
//! The formulas are those of the host body, in `f32`. Series replace differences that would cancel, and sums have terms
//! of one sign where possible.

use burn::cubecl::{self, prelude::*};
use burn::tensor;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

use crate::cube::rays::{alpha_of, first_sample};
use crate::cube::{Operation, Pass, apply, arg, empty, empty_like, launch};
use crate::segments::Segments;

/// Computes values, depth and Σw of [`composite`](super::composite()) or, with three values, `distances` and a `background`,
/// of [`composite_over`](super::composite_over()).
pub(super) fn composite(
    tau: tensor::Tensor<1>,
    values: Option<tensor::Tensor<2>>,
    distances: Option<tensor::Tensor<1>>,
    background: Option<[f32; 3]>,
    segments: &Segments,
) -> (Option<tensor::Tensor<2>>, tensor::Tensor<1>, tensor::Tensor<1>) {
    let channels = values.as_ref().map_or(0, |values| values.dims()[1]);
    let is_colored = values.is_some();
    let segments = segments.clone();
    let kernel = GpuComposite { segments, channels, has_distances: distances.is_some(), background };
    // A missing input is replaced by another tensor, which the kernels do not read.
    let distances = distances.unwrap_or_else(|| tau.clone()).detach();
    let values = values.unwrap_or_else(|| tau.clone().detach().unsqueeze_dim(1));
    let inputs = [tau.into_dispatch(), values.into_dispatch(), distances.into_dispatch()];
    let packed: tensor::Tensor<2> = apply(kernel, inputs);
    let column = |index: usize| packed.clone().narrow(1, index, 1).squeeze_dim(1);
    let values = is_colored.then(|| packed.clone().narrow(1, 0, channels));
    (values, column(channels), column(channels + 1))
}

/// Operation whose output is a row of values, depth and Σw per ray, `[R, C + 2]`.
#[derive(Debug)]
struct GpuComposite {
    segments: Segments,
    /// Columns of the values; 0 for none.
    channels: usize,
    has_distances: bool,
    background: Option<[f32; 3]>,
}

impl GpuComposite {
    fn inputs(&self, inputs: &[CubeTensor]) -> CompositeSamplesLaunch {
        let [tau, values, distances] = inputs else { unreachable!("composite has three inputs") };
        let [red, green, blue] = self.background.unwrap_or_default();
        CompositeSamplesLaunch::new(
            arg(tau),
            arg(values),
            arg(distances),
            arg(&self.segments.offsets_on_device_of(tau)),
            red,
            green,
            blue,
            self.channels,
            self.background.is_some(),
            self.has_distances,
        )
    }
}

impl Operation<CubeBackend> for GpuComposite {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let out = empty(&inputs[0], [self.segments.rays(), self.channels + 2]);
        launch!(composite_forward::launch, self.segments.rays(); &out; self.inputs(inputs));
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (dtau, dvalues) = (empty_like(&pass.inputs[0]), empty_like(&pass.inputs[1]));
        launch!(composite_backward::launch, self.segments.rays(); pass.grad, &dtau, &dvalues; self.inputs(pass.inputs));
        vec![Some(dtau), Some(dvalues).filter(|_| self.channels > 0)]
    }
}

#[derive(CubeType, CubeLaunch)]
struct CompositeSamples {
    tau: OwnedTensor<f32>,
    values: OwnedTensor<f32>,
    distances: OwnedTensor<f32>,
    offsets: OwnedTensor<i32>,
    red: f32,
    green: f32,
    blue: f32,
    #[cube(comptime)]
    channels: usize,
    #[cube(comptime)]
    on_background: bool,
    #[cube(comptime)]
    has_distances: bool,
}

/// Writes a ray's row: integrated values, plus (1 − Σw) · background if there is one, depth Σ w t, and Σw.
#[cube(launch)]
fn composite_forward(out: &mut Tensor<f32>, samples: &CompositeSamples) {
    let ray = ABSOLUTE_POS;
    if ray >= out.shape(0) {
        terminate!();
    }
    let channels = comptime!(samples.channels);
    let (start, end) = (first_sample(&samples.offsets, ray), first_sample(&samples.offsets, ray + 1));
    let row = ray * (channels + 2);
    for c in 0..channels {
        out[row + c] = 0.0f32;
    }
    let mut trans = 1.0f32;
    let mut sum = 0.0f32;
    let mut distance = 0.0f32;
    for i in start..end {
        let w = trans * alpha_of(samples.tau[i]);
        trans *= f32::exp(-samples.tau[i]);
        sum += w;
        for c in 0..channels {
            out[row + c] += w * samples.values[i * channels + c];
        }
        if comptime!(samples.has_distances) {
            distance += w * samples.distances[i];
        }
    }
    if comptime!(samples.on_background) {
        out[row] += (1.0f32 - sum) * samples.red;
        out[row + 1] += (1.0f32 - sum) * samples.green;
        out[row + 2] += (1.0f32 - sum) * samples.blue;
    }
    out[row + channels] = distance;
    out[row + channels + 1] = sum;
}

#[cube(launch)]
fn composite_backward(
    grad: &Tensor<f32>,
    dtau: &mut Tensor<f32>,
    dvalues: &mut Tensor<f32>,
    samples: &CompositeSamples,
) {
    let ray = ABSOLUTE_POS;
    if ray >= grad.shape(0) {
        terminate!();
    }
    let channels = comptime!(samples.channels);
    let (start, end) = (first_sample(&samples.offsets, ray), first_sample(&samples.offsets, ray + 1));
    let row = ray * (channels + 2);
    // T_{i+1} is kept in dtau until the second pass replaces it.
    let mut trans = 1.0f32;
    for i in start..end {
        let w = trans * alpha_of(samples.tau[i]);
        for c in 0..channels {
            dvalues[i * channels + c] = w * grad[row + c];
        }
        trans *= f32::exp(-samples.tau[i]);
        dtau[i] = trans;
    }
    // The part of ∂L/∂w that all samples of the ray share.
    let mut common = grad[row + channels + 1];
    if comptime!(samples.on_background) {
        common -= grad[row] * samples.red + grad[row + 1] * samples.green + grad[row + 2] * samples.blue;
    }
    // Excess eᵢ = uᵢ − Σ_{j>i} uⱼ wⱼ/Tᵢ₊₁ of uᵢ = ∂L/∂wᵢ, by the recurrence of the host kernel.
    let mut behind = 0.0f32;
    let mut excess = 0.0f32;
    for step in 0..end - start {
        let i = end - 1 - step;
        let mut dw = common;
        for c in 0..channels {
            dw += grad[row + c] * samples.values[i * channels + c];
        }
        if comptime!(samples.has_distances) {
            dw += grad[row + channels] * samples.distances[i];
        }
        excess += dw - behind;
        behind = dw;
        dtau[i] *= excess;
        excess *= f32::exp(-samples.tau[i]);
    }
}
