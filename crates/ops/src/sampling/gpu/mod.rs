//! Distances of samples, drawn on the device: one thread per sample, or per ray for a cumulative distribution.

mod kernels;
mod march;

use burn::tensor::{DType, Shape, Tensor};
use burn_cubecl::tensor::CubeTensor;

pub(super) use self::march::march;
use super::{LastInterval, Placement, Streams};
use crate::cube::buffers::Outputs;
use crate::cube::{apply_without_gradient, empty, empty_like, launch};

pub(super) fn stratified(ends: Tensor<2>, shape: [usize; 2], rule: Placement, jitter: Option<&Streams>) -> Tensor<2> {
    let (streams, jittered, in_middle) = (streams_or(jitter, &ends), jitter.is_some(), rule == Placement::Mid);
    apply_without_gradient([ends.into_dispatch(), streams.into_dispatch()], move |[ends, streams]| {
        let out = empty(ends, shape);
        launch!(kernels::stratified::launch, shape[0] * shape[1]; ends, &integers(streams), &out; in_middle, jittered);
        out
    })
}

pub(super) fn importance(t: Tensor<2>, tau: Tensor<1>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
    let (streams, jittered) = (streams_or(jitter, &t), jitter.is_some());
    let inputs = [t.into_dispatch(), tau.detach().into_dispatch(), streams.into_dispatch()];
    apply_without_gradient(inputs, move |[t, tau, streams]| {
        let [rays, samples] = t.meta.shape().dims();
        let cdf = empty(t, [rays, samples - 1]);
        launch!(kernels::importance_cdf::launch, rays; tau, &cdf;);
        let drawn = empty(t, [rays, count]);
        launch!(kernels::importance_draw::launch, rays * count; t, &cdf, &integers(streams), &drawn; jittered);
        let out = empty(t, [rays, samples + count]);
        launch!(kernels::merge::launch, out.meta.num_elements(); t, &drawn, &out;);
        out
    })
}

pub(super) fn resample(edges: Tensor<2>, tau: Tensor<1>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
    let (streams, jittered) = (streams_or(jitter, &edges), jitter.is_some());
    let inputs = [edges.into_dispatch(), tau.detach().into_dispatch(), streams.into_dispatch()];
    apply_without_gradient(inputs, move |[edges, tau, streams]| {
        let rays = edges.meta.shape()[0];
        let cdf = empty_like(edges);
        launch!(kernels::blurred_cdf::launch, rays; tau, &cdf;);
        let out = empty(edges, [rays, count + 1]);
        launch!(kernels::resample_draw::launch, rays * (count + 1); edges, &cdf, &integers(streams), &out; jittered);
        out
    })
}

pub(super) fn intervals(t: Tensor<2>, ends: Tensor<2>, rule: Placement, last: LastInterval) -> [Tensor<1>; 2] {
    let [rays, columns] = t.dims();
    let samples = rays * if rule == Placement::Interval { columns - 1 } else { columns };
    let (shapes, last) = ([0, 1].map(|_| Shape::new([samples])), last.length().unwrap_or(0.0));
    let outputs = Outputs::new(shapes, [t, ends].map(Tensor::into_dispatch), move |[t, ends], [distance, length]| {
        launch!(kernels::intervals::launch, samples; t, ends, &distance, &length; last, rule);
    });
    [0, 1].map(|index| outputs.output(index))
}

/// Returns the random numbers, or `other` in their place if there are none.
fn streams_or(jitter: Option<&Streams>, other: &Tensor<2>) -> Tensor<1> {
    jitter.map_or_else(|| other.clone().flatten(0, 1), |streams| streams.0.clone())
}

/// Returns the tensor with its bits read as integers.
fn integers(tensor: &CubeTensor) -> CubeTensor {
    CubeTensor { dtype: DType::U32, ..tensor.clone() }
}
