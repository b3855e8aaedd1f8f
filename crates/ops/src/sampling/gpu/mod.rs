//! Distances of samples, drawn on the device: one thread per sample, or per ray for a cumulative distribution.

mod kernels;
mod march;

use burn::tensor::{DType, Shape, Tensor};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

pub(super) use self::march::march;
use super::{LastInterval, Placement, Streams};
use crate::cube::buffers::Outputs;
use crate::cube::{Operation, apply, empty, launch};

pub(super) fn stratified(ends: Tensor<2>, shape: [usize; 2], rule: Placement, jitter: Option<&Streams>) -> Tensor<2> {
    let streams = streams_or(jitter, &ends);
    apply(
        Sampling::Stratified { shape, rule, jitter: jitter.is_some() },
        [ends.into_dispatch(), streams.into_dispatch()],
    )
}

pub(super) fn importance(t: Tensor<2>, tau: Tensor<1>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
    let streams = streams_or(jitter, &t);
    let inputs = [t.into_dispatch(), tau.detach().into_dispatch(), streams.into_dispatch()];
    apply(Sampling::Importance { count, jitter: jitter.is_some() }, inputs)
}

pub(super) fn resample(edges: Tensor<2>, tau: Tensor<1>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
    let streams = streams_or(jitter, &edges);
    let inputs = [edges.into_dispatch(), tau.detach().into_dispatch(), streams.into_dispatch()];
    apply(Sampling::Resample { count, jitter: jitter.is_some() }, inputs)
}

pub(super) fn intervals(t: Tensor<2>, ends: Tensor<2>, rule: Placement, last: LastInterval) -> [Tensor<1>; 2] {
    let [rays, columns] = t.dims();
    let samples = rays * if rule == Placement::Interval { columns - 1 } else { columns };
    let outputs = Outputs::new([0, 1].map(|_| Shape::new([samples])));
    let inputs = [t, ends].map(Tensor::into_dispatch);
    let buffer = apply(Sampling::Intervals { outputs: outputs.clone(), rule, last }, inputs);
    [0, 1].map(|index| outputs.output(&buffer, index))
}

/// Returns the random numbers, or `other` in their place if there are none.
fn streams_or(jitter: Option<&Streams>, other: &Tensor<2>) -> Tensor<1> {
    jitter.map_or_else(|| other.clone().flatten(0, 1), |streams| streams.0.clone())
}

/// Returns the tensor with its bits read as integers.
fn integers(tensor: &CubeTensor) -> CubeTensor {
    CubeTensor { dtype: DType::U32, ..tensor.clone() }
}

/// Operations that place samples; none has a gradient.
#[derive(Debug)]
enum Sampling {
    Stratified { shape: [usize; 2], rule: Placement, jitter: bool },
    Importance { count: usize, jitter: bool },
    Resample { count: usize, jitter: bool },
    Intervals { outputs: Outputs<2>, rule: Placement, last: LastInterval },
}

impl Operation<CubeBackend> for Sampling {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let first = &inputs[0];
        let rays = first.meta.shape()[0];
        let streams = || integers(inputs.last().expect("streams are last"));
        match self {
            Self::Stratified { shape, rule, jitter } => {
                let (out, in_middle) = (empty(first, *shape), *rule == Placement::Mid);
                launch!(kernels::stratified::launch, shape[0] * shape[1]; first, &streams(), &out; in_middle, *jitter);
                out
            }
            Self::Importance { count, jitter } => {
                let samples = first.meta.shape()[1];
                let cdf = empty(first, [rays, samples - 1]);
                launch!(kernels::importance_cdf::launch, rays; &inputs[1], &cdf;);
                let drawn = empty(first, [rays, *count]);
                launch!(kernels::importance_draw::launch, rays * count; first, &cdf, &streams(), &drawn; *jitter);
                let out = empty(first, [rays, samples + count]);
                launch!(kernels::merge::launch, out.meta.num_elements(); first, &drawn, &out;);
                out
            }
            Self::Resample { count, jitter } => {
                let cdf = empty(first, first.meta.shape().clone());
                launch!(kernels::blurred_cdf::launch, rays; &inputs[1], &cdf;);
                let out = empty(first, [rays, count + 1]);
                launch!(kernels::resample_draw::launch, rays * (count + 1); first, &cdf, &streams(), &out; *jitter);
                out
            }
            Self::Intervals { outputs, rule, last } => {
                let buffer = outputs.buffer(first);
                let [distance, length] = outputs.parts(&buffer);
                let (samples, last) = (length.meta.num_elements(), last.length().unwrap_or(0.0));
                launch!(kernels::intervals::launch, samples; first, &inputs[1], &distance, &length; last, *rule);
                buffer
            }
        }
    }
}
