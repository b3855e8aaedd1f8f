//! Kernels of compositing: one thread per ray, which walks along its samples.
//!
//! The formulas are those of the host body, in `f32`: by series where differences would cancel, and with sums of values of
//! one sign where possible.

use std::sync::Arc;

use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, Shape};
use burn_cubecl::tensor::CubeTensor;

use crate::Segments;
use crate::cube::outputs::Outputs;
use crate::cube::rays::{RayOffsets, alpha_of, clear_tail, first_sample};
use crate::cube::{CubeKernel, Pass, apply, arg, empty_like, launch};

/// Computes values, depth and Σw of [`composite`](super::composite()) or, with three values, `distances` and a `background`,
/// of [`composite_over`](super::composite_over()).
pub(super) fn composite(
    tau: tensor::Tensor<1>,
    values: Option<tensor::Tensor<2>>,
    distances: Option<tensor::Tensor<1>>,
    background: Option<[f32; 3]>,
    segments: &Segments,
) -> (Option<tensor::Tensor<2>>, tensor::Tensor<1>, tensor::Tensor<1>) {
    let (rays, channels) = (segments.rays(), values.as_ref().map_or(0, |values| values.dims()[1]));
    // A buffer is never empty, even without values.
    let outputs = Outputs::new([Shape::new([rays, channels.max(1)]), Shape::new([rays]), Shape::new([rays])]);
    let has_distances = distances.is_some();
    let distances = distances.unwrap_or_else(|| tau.clone()).detach();
    let is_colored = values.is_some();
    let values = values.unwrap_or_else(|| tau.clone().detach().unsqueeze_dim(1));
    let offsets = RayOffsets::new(segments);
    let kernel = GpuComposite { offsets, outputs: outputs.clone(), channels, has_distances, background };
    let buffer = apply(kernel, (tau, values, distances));
    let values = is_colored.then(|| outputs.output(&buffer, 0));
    (values, outputs.output(&buffer, 1), outputs.output(&buffer, 2))
}

#[derive(Debug)]
struct GpuComposite {
    offsets: RayOffsets,
    outputs: Arc<Outputs<3>>,
    /// Columns of the values; 0 for none.
    channels: usize,
    has_distances: bool,
    background: Option<[f32; 3]>,
}

impl GpuComposite {
    fn inputs(&self, inputs: &[CubeTensor]) -> CompositeSamplesLaunch {
        let [tau, values, distances] = inputs else { unreachable!("composite has three inputs") };
        let [red, green, blue] = self.background.unwrap_or_default();
        let (offsets, on_background) = (self.offsets.on_device_of(tau), self.background.is_some());
        let has_distances = self.has_distances;
        let tensors = [tau, values, distances].map(arg);
        let [tau, values, distances] = tensors;
        CompositeSamplesLaunch::new(
            tau,
            values,
            distances,
            arg(&offsets),
            red,
            green,
            blue,
            self.channels,
            on_background,
            has_distances,
        )
    }
}

impl CubeKernel for GpuComposite {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let buffer = self.outputs.buffer(&inputs[0]);
        let [out, depth, acc] = self.outputs.parts(&buffer);
        launch!(composite_forward::launch, self.offsets.rays(); &out, &depth, &acc; self.inputs(inputs));
        buffer
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (dtau, dvalues) = (empty_like(&pass.inputs[0]), empty_like(&pass.inputs[1]));
        let gradients = self.outputs.gradients();
        let has = gradients.each_ref().map(Option::is_some);
        // Any tensor stands for a gradient that is missing, which is not read.
        let [values, depth, acc] = gradients.map(|grad| arg(&grad.unwrap_or_else(|| pass.inputs[0].clone())));
        let gradients = CompositeGradientsLaunch::new(values, depth, acc, has[0], has[1], has[2]);
        launch!(composite_backward::launch, self.offsets.rays(); &dtau, &dvalues; self.inputs(pass.inputs), gradients);
        vec![Some(dtau), Some(dvalues).filter(|_| self.channels > 0), None]
    }
}

/// Packed samples to composite.
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

/// Gradients with respect to the integrated values, depth and Σw.
#[derive(CubeType, CubeLaunch)]
struct CompositeGradients {
    values: OwnedTensor<f32>,
    depth: OwnedTensor<f32>,
    acc: OwnedTensor<f32>,
    #[cube(comptime)]
    has_values: bool,
    #[cube(comptime)]
    has_depth: bool,
    #[cube(comptime)]
    has_acc: bool,
}

/// Writes the integrated values of each ray, on the background as far as the ray is transparent, its depth and Σw.
#[cube(launch)]
fn composite_forward(
    out: &mut Tensor<f32>,
    depth: &mut Tensor<f32>,
    acc: &mut Tensor<f32>,
    samples: &CompositeSamples,
) {
    let place = ABSOLUTE_POS;
    if place >= acc.shape(0) {
        terminate!();
    }
    let channels = comptime!(samples.channels);
    let (start, end) = (first_sample(&samples.offsets, place), first_sample(&samples.offsets, place + 1));
    let row = place * channels;
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
    acc[place] = sum;
    depth[place] = distance;
}

/// Writes the gradients with respect to τ and the values.
#[cube(launch)]
fn composite_backward(
    dtau: &mut Tensor<f32>,
    dvalues: &mut Tensor<f32>,
    samples: &CompositeSamples,
    gradients: &CompositeGradients,
) {
    let place = ABSOLUTE_POS;
    if place >= samples.offsets.shape(0) - 1 {
        terminate!();
    }
    let channels = comptime!(samples.channels);
    let (start, end) = (first_sample(&samples.offsets, place), first_sample(&samples.offsets, place + 1));
    clear_tail(dtau, &samples.offsets, 1, place);
    if comptime!(channels > 0) {
        clear_tail(dvalues, &samples.offsets, channels, place);
    }
    let row = place * channels;
    // T_{i+1} is kept in dtau until the second pass replaces it.
    let mut trans = 1.0f32;
    for i in start..end {
        let w = trans * alpha_of(samples.tau[i]);
        for c in 0..channels {
            let mut dvalue = 0.0f32;
            if comptime!(gradients.has_values) {
                dvalue = w * gradients.values[row + c];
            }
            dvalues[i * channels + c] = dvalue;
        }
        trans *= f32::exp(-samples.tau[i]);
        dtau[i] = trans;
    }
    // The part of ∂L/∂w that all samples of the ray share.
    let mut common = 0.0f32;
    if comptime!(gradients.has_acc) {
        common += gradients.acc[place];
    }
    if comptime!(samples.on_background && gradients.has_values) {
        common -= gradients.values[row] * samples.red
            + gradients.values[row + 1] * samples.green
            + gradients.values[row + 2] * samples.blue;
    }
    // As on the host: the excess of ∂L/∂w over what lies behind the sample.
    let mut behind = 0.0f32;
    let mut excess = 0.0f32;
    for step in 0..end - start {
        let i = end - 1 - step;
        let mut dw = common;
        if comptime!(gradients.has_values) {
            for c in 0..channels {
                dw += gradients.values[row + c] * samples.values[i * channels + c];
            }
        }
        if comptime!(gradients.has_depth) {
            dw += gradients.depth[place] * samples.distances[i];
        }
        excess += dw - behind;
        behind = dw;
        dtau[i] *= excess;
        excess *= f32::exp(-samples.tau[i]);
    }
}
