//! Samples along rays: stratified distances, distances drawn from the weights of a coarse pass, marches, and packing.
//!
//! Each of `H` ≥ 1 rays has an interval `[near, far]` and as many samples as the others. [`distances`] holds the functions of one
//! ray on the host, which serve devices other than GPUs.

pub mod distances;
#[cfg(feature = "cube")]
mod gpu;
pub mod march;
mod pack;

use burn::tensor::{Device, Tensor};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use self::pack::{PackedSamples, RaySamples, pack};
use crate::composite::weights;
use crate::dispatch::dispatch;
use crate::random::Stream;
use crate::segments::Segments;
use crate::traffic::{to_host, upload, upload_together};

/// Position of a sample within its interval.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Placement {
    /// At the near end, as in NeRF: stratified distances, and interval i reaches from sample i to sample i + 1.
    Left,
    /// In the middle. A single pass has steps of one length for all rays.
    Mid,
    /// Over the whole interval (mip-NeRF): `samples + 1` edges bound `samples` intervals, and the fine pass has `fine_samples`
    /// intervals of its own, drawn from blurred weights and not merged with the coarse ones.
    Interval,
}

impl Placement {
    /// Every placement.
    pub const ALL: [Self; 3] = [Self::Left, Self::Mid, Self::Interval];

    /// Returns the number of values that place `samples` samples of a ray: `samples` distances, or `samples + 1` edges.
    pub fn columns(self, samples: usize) -> usize {
        samples + usize::from(self == Self::Interval)
    }
}

/// Length of the last interval of a ray under [`Placement::Left`]; under others it ends where the ray does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LastInterval {
    /// Length of the interval before it.
    Finite,
    /// 1e10, as in the released code: any density there gives α ≈ 1.
    Infinite,
}

impl LastInterval {
    /// Returns the length, unless it depends on the other intervals.
    pub fn length(self) -> Option<f32> {
        (self == Self::Infinite).then_some(1e10)
    }
}

/// Random numbers of rays, on their device: the low and high half of each stream's key, and its item, which is below 2³², as
/// the bits of integers, `[3 H]`.
#[derive(Clone, Debug)]
pub struct Streams(Tensor<1>);

impl Streams {
    /// Uploads the stream of each ray.
    pub fn new(streams: impl IntoIterator<Item = Stream>, device: &Device) -> Self {
        let of = |Stream { key, item }: Stream| [key as u32, (key >> 32) as u32, item as u32].map(f32::from_bits);
        let bits: Vec<f32> = streams.into_iter().flat_map(of).collect();
        let count = bits.len();
        Self(upload(bits, [count], device))
    }

    fn on_host(&self) -> Vec<Stream> {
        let of = |bits: &[f32; 3]| {
            let [low, high, item] = bits.map(f32::to_bits);
            Stream { key: u64::from(high) << 32 | u64::from(low), item: item as usize }
        };
        to_host(self.0.clone()).as_chunks().0.iter().map(of).collect()
    }
}

/// Places `count` samples in [near, far] of each of `rays` rays, by the rule of [`distances::stratified`]: `[H, N]`, N being
/// [`Placement::columns`].
///
/// - `ends`: near and far, `[H, 2]`, or `[1, 2]` if all rays have the same. Distances have their unit.
/// - `jitter`: random numbers; without them samples are evenly spaced.
pub fn stratified(ends: Tensor<2>, [rays, count]: [usize; 2], rule: Placement, jitter: Option<&Streams>) -> Tensor<2> {
    dispatch! {
        &ends.device();
        cube => gpu::stratified(ends, [rays, rule.columns(count)], rule, jitter),
        plain => {
            let device = ends.device();
            let ends = to_host(ends);
            rows(rays, &device, jitter, |ray, stream| {
                let [near, far] = [0, 1].map(|end| ends[(2 * ray + end) % ends.len()]);
                distances::stratified(near, far, count, rule, stream)
            })
        },
    }
}

/// Draws `count` distances of each ray from the weights of the samples at `t`, `[H, N]`, whose optical depths are `tau`,
/// `[H N]`, and merges them with `t`, by [`distances::importance`]: `[H, N + count]`, sorted, without a gradient.
///
/// A GPU sums the weights of a ray in `f32`, the host in `f64`.
pub fn importance(t: Tensor<2>, tau: Tensor<1>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
    dispatch! {
        &t.device();
        cube => gpu::importance(t, tau, count, jitter),
        plain => drawn_on_host(t, tau, jitter, |t, weights, stream| distances::importance(t, weights, count, stream)),
    }
}

/// Draws the edges of `count` intervals of each ray from the blurred weights of the intervals between `edges`, `[H, N + 1]`,
/// whose optical depths are `tau`, `[H N]`, by [`distances::resample`]: `[H, count + 1]`, sorted, without a gradient.
pub fn resample(edges: Tensor<2>, tau: Tensor<1>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
    dispatch! {
        &edges.device();
        cube => gpu::resample(edges, tau, count, jitter),
        plain => drawn_on_host(edges, tau, jitter, |edges, weights, stream| {
            distances::resample(edges, &distances::blurred(weights), count, stream)
        }),
    }
}

fn drawn_on_host(
    t: Tensor<2>,
    tau: Tensor<1>,
    jitter: Option<&Streams>,
    draw: impl Fn(&[f32], &[f32], Option<Stream>) -> Vec<f32> + Sync,
) -> Tensor<2> {
    let ([rays, columns], device) = (t.dims(), t.device());
    let samples = tau.dims()[0] / rays;
    let weights = weights(&to_host(tau), &Segments::uniform(rays, samples));
    let t = to_host(t);
    rows(rays, &device, jitter, |ray, stream| {
        draw(&t[ray * columns..][..columns], &weights[ray * samples..][..samples], stream)
    })
}

/// Returns the distance of each sample that `t`, `[H, N]`, places, and the length of its interval, by
/// [`distances::intervals`]: `[M]` each. The `ends` are those given to [`stratified`].
pub fn intervals(t: Tensor<2>, ends: Tensor<2>, rule: Placement, last: LastInterval) -> [Tensor<1>; 2] {
    dispatch! {
        &t.device();
        cube => gpu::intervals(t, ends, rule, last),
        plain => {
            let ([_, columns], device) = (t.dims(), t.device());
            let (t, ends) = (to_host(t), to_host(ends));
            let of = |(t, ends): (&[f32], &[f32])| distances::intervals(t, ends[0], ends[1], rule, last);
            let (distance, length) = t.chunks(columns).zip(ends.chunks(2).cycle()).flat_map(of).unzip();
            upload_together([distance, length], &[], &device)
        },
    }
}

/// Returns o + t d of each sample, `[M, 3]`: differentiable in the rays' `origins` and `directions`, `[R, 3]`, but not in
/// the distances `t`, `[M]`.
pub fn points_on_rays(origins: Tensor<2>, directions: Tensor<2>, t: Tensor<1>, segments: &Segments) -> Tensor<2> {
    dispatch! {
        &t.device();
        cube if segments.samples() > 0 => {
            let [origins, directions] = [origins, directions].map(Tensor::into_dispatch);
            let kernel = crate::cube::rays::PointsOnRays(segments.clone());
            crate::cube::apply(kernel, [origins, directions, t.detach().into_dispatch()])
        },
        plain => {
            let owners = segments.owners(&origins.device());
            origins.select(0, owners.clone()) + directions.select(0, owners) * t.detach().unsqueeze_dim(1)
        },
    }
}

/// Uploads a row of values for each ray, given its place and its stream.
fn rows(
    count: usize,
    device: &Device,
    jitter: Option<&Streams>,
    row: impl Fn(usize, Option<Stream>) -> Vec<f32> + Sync,
) -> Tensor<2> {
    let streams = jitter.map(Streams::on_host);
    let row = |ray: usize| row(ray, streams.as_ref().map(|streams| streams[ray]));
    let rows: Vec<Vec<f32>> = (0..count).into_par_iter().map(row).collect();
    let columns = rows.first().map_or(0, Vec::len);
    upload(rows.concat(), [count, columns], device)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uploaded_streams_keep_their_bits() {
        let streams =
            [Stream { key: u64::MAX - 7, item: 3 }, Stream { key: 0x7fa0_0001_ff80_0001, item: u32::MAX as usize }];
        assert_eq!(Streams::new(streams, &Device::flex()).on_host(), streams);
    }
}
