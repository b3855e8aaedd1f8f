use burn::tensor::{FloatDType, Tensor};

use super::Intervals;
use crate::Segments;
use crate::composite::{Padding, exclusive_sum, plain_alpha, working_dtype};

/// Computes [`ray_distortion`](super::ray_distortion) from plain tensor operations, on any backend.
pub fn plain(tau: Tensor<1>, intervals: Intervals, segments: &Segments) -> Tensor<1> {
    let device = tau.device();
    if segments.longest() == 0 {
        return Tensor::zeros([segments.rays()], &device);
    }
    let dtype = working_dtype(&device);
    let padding = Padding::new(segments, &device);
    let [tau, middle, length] = [tau, intervals.middle, intervals.length].map(|input| padding.apply(input.cast(dtype)));
    let w = exclusive_sum(tau.clone()).neg().exp() * plain_alpha(tau);
    let (weight, moment) = (exclusive_sum(w.clone()), exclusive_sum(w.clone() * middle.clone()));
    let between = w.clone() * (middle * weight - moment);
    let within = w.clone() * w * length;
    (between * 2.0 + within / 3.0).sum_dim(1).squeeze_dim::<1>(1).cast(FloatDType::F32)
}
