//! Kernels that place samples. A row holds the values of a ray; all rows have one length.

use burn::cubecl::{self, prelude::*};

use crate::cube::random::{self, Bits};
use crate::cube::rays::alpha_of;
use crate::sampling::Placement;

/// Returns number `index` of a row's stream, uniform in [0, 1): [`Stream::uniform`](crate::random::Stream::uniform).
#[cube]
pub(super) fn uniform(streams: &Tensor<u32>, row: usize, index: usize) -> f32 {
    let key = Bits { high: streams[3 * row + 1], low: streams[3 * row] };
    random::uniform(&key, streams[3 * row + 2], u32::cast_from(index))
}

/// Returns the near (0) or far (1) end of a row's interval; a single interval serves all rows.
#[cube]
fn end(ends: &Tensor<f32>, row: usize, which: usize) -> f32 {
    ends[(2 * row + which) % ends.len()]
}

/// Returns the distance of the share `u` of [near, far].
#[cube]
fn between(ends: &Tensor<f32>, row: usize, u: f32) -> f32 {
    end(ends, row, 0) * (1.0f32 - u) + end(ends, row, 1) * u
}

/// Computes stratified distances: samples in the middle of equal intervals if `in_middle`, else by NeRF's rule.
#[cube(launch)]
pub(super) fn stratified(
    ends: &Tensor<f32>,
    streams: &Tensor<u32>,
    out: &mut Tensor<f32>,
    #[comptime] in_middle: bool,
    #[comptime] jitter: bool,
) {
    let at = ABSOLUTE_POS;
    if at >= out.len() {
        terminate!();
    }
    let count = out.shape(1);
    let (row, i) = (at / count, at % count);
    let place = f32::cast_from(i);
    if comptime!(in_middle) {
        let mut u = 0.5f32;
        if comptime!(jitter) {
            u = uniform(streams, row, i);
        }
        out[at] = between(ends, row, (place + u) / f32::cast_from(count));
    } else {
        let last = f32::cast_from(count - 1);
        let even = between(ends, row, place / last);
        let mut t = even;
        if comptime!(jitter) {
            let mut lower = even;
            if i > 0 {
                lower = 0.5f32 * (between(ends, row, (place - 1.0f32) / last) + even);
            }
            let mut upper = even;
            if i + 1 < count {
                upper = 0.5f32 * (even + between(ends, row, (place + 1.0f32) / last));
            }
            t = lower + (upper - lower) * uniform(streams, row, i);
        }
        out[at] = t;
    }
}

/// Computes the cumulative distribution from which importance samples are drawn, one thread per row. NeRF's bins lie
/// between the midpoints of samples; their weights are those of the inner samples + 1e-5.
#[cube(launch)]
pub(super) fn importance_cdf(tau: &Tensor<f32>, cdf: &mut Tensor<f32>) {
    let row = ABSOLUTE_POS;
    if row >= cdf.shape(0) {
        terminate!();
    }
    let bins = cdf.shape(1);
    let (from, to) = (row * (bins + 1), row * bins);
    let mut trans = f32::exp(-tau[from]);
    let mut total = 0.0f32;
    for i in 1..bins {
        let w = trans * alpha_of(tau[from + i]) + 1e-5f32;
        trans *= f32::exp(-tau[from + i]);
        cdf[to + i] = w;
        total += w;
    }
    accumulate(cdf, to, bins, total);
}

/// Computes the cumulative distribution over mip-NeRF's intervals, one thread per row: weights are the mean of the
/// maxima over each pair of neighbouring weights, + 0.01.
#[cube(launch)]
pub(super) fn blurred_cdf(tau: &Tensor<f32>, cdf: &mut Tensor<f32>) {
    let row = ABSOLUTE_POS;
    if row >= cdf.shape(0) {
        terminate!();
    }
    let edges = cdf.shape(1);
    let intervals = edges - 1;
    let (from, to) = (row * intervals, row * edges);
    let mut trans = f32::exp(-tau[from]);
    let mut before = alpha_of(tau[from]);
    let mut here = before;
    let mut total = 0.0f32;
    for i in 0..intervals {
        let mut next = here;
        if i + 1 < intervals {
            next = trans * alpha_of(tau[from + i + 1]);
            trans *= f32::exp(-tau[from + i + 1]);
        }
        let w = 0.5f32 * (f32::max(before, here) + f32::max(here, next)) + 0.01f32;
        cdf[to + i + 1] = w;
        total += w;
        before = here;
        here = next;
    }
    accumulate(cdf, to, edges, total);
}

/// Replaces weights, which add up to `total`, by their cumulative distribution: `count` values from 0 to 1, from `start` on.
#[cube]
fn accumulate(cdf: &mut Tensor<f32>, start: usize, count: usize, total: f32) {
    cdf[start] = 0.0f32;
    let mut sum = 0.0f32;
    for i in 1..count {
        sum += cdf[start + i] / total;
        cdf[start + i] = f32::min(sum, 1.0f32);
    }
    cdf[start + count - 1] = 1.0f32;
}

/// Returns the number of values at most `u` among `count` sorted ones from `start` on.
#[cube]
fn at_most(sorted: &Tensor<f32>, start: usize, count: usize, u: f32) -> usize {
    let mut low = 0usize;
    let mut high = count;
    while low < high {
        let middle = (low + high) / 2;
        if sorted[start + middle] <= u {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    low
}

/// Draws distances by NeRF's inverse transform, in the order of their random numbers.
#[cube(launch)]
pub(super) fn importance_draw(
    t: &Tensor<f32>,
    cdf: &Tensor<f32>,
    streams: &Tensor<u32>,
    out: &mut Tensor<f32>,
    #[comptime] jitter: bool,
) {
    let at = ABSOLUTE_POS;
    if at >= out.len() {
        terminate!();
    }
    let (row, i) = (at / out.shape(1), at % out.shape(1));
    let bins = cdf.shape(1);
    let (start, first) = (row * bins, row * (bins + 1));
    let mut u = 0.0f32;
    if comptime!(jitter) {
        u = uniform(streams, row, i);
    } else if out.shape(1) > 1 {
        u = f32::cast_from(i) / f32::cast_from(out.shape(1) - 1);
    }
    let count = at_most(cdf, start, bins, u);
    // The first value of the distribution is 0, so `count` is at least 1.
    let below = count - 1;
    let above = usize::min(count, bins - 1);
    let mut width = cdf[start + above] - cdf[start + below];
    let fraction = u - cdf[start + below];
    if width < 1e-5f32 {
        width = 1.0f32;
    }
    let low = 0.5f32 * (t[first + below] + t[first + below + 1]);
    let high = 0.5f32 * (t[first + above] + t[first + above + 1]);
    out[at] = low + fraction / width * (high - low);
}

/// Merges `drawn` into the sorted `t`, one thread per value.
#[cube(launch)]
pub(super) fn merge(t: &Tensor<f32>, drawn: &Tensor<f32>, out: &mut Tensor<f32>) {
    let at = ABSOLUTE_POS;
    if at >= out.len() {
        terminate!();
    }
    let (known, fresh) = (t.shape(1), drawn.shape(1));
    let both = known + fresh;
    let (row, i) = (at / both, at % both);
    // Among equal values those of `t` come first, then drawn ones in their order.
    let (is_known, own) = (i < known, usize::saturating_sub(i, known));
    let mut value = drawn[row * fresh + own];
    if is_known {
        value = t[row * known + i];
    }
    let mut place = i;
    if !is_known {
        place = at_most(t, row * known, known, value);
    }
    for j in 0..fresh {
        let other = drawn[row * fresh + j];
        if other < value || (other == value && !is_known && j < own) {
            place += 1;
        }
    }
    out[row * both + place] = value;
}

/// Draws sorted edges by mip-NeRF's inverse transform.
#[cube(launch)]
pub(super) fn resample_draw(
    edges: &Tensor<f32>,
    cdf: &Tensor<f32>,
    streams: &Tensor<u32>,
    out: &mut Tensor<f32>,
    #[comptime] jitter: bool,
) {
    let at = ABSOLUTE_POS;
    if at >= out.len() {
        terminate!();
    }
    let count = out.shape(1);
    let (row, i) = (at / count, at % count);
    let start = row * cdf.shape(1);
    // 1 − `f32::EPSILON`, as on the host.
    let last = 0.999_999_9f32;
    let mut u = f32::cast_from(i) / f32::cast_from(count - 1) * last;
    if comptime!(jitter) {
        u = f32::min((f32::cast_from(i) + uniform(streams, row, i)) / f32::cast_from(count), last);
    }
    let interval = at_most(cdf, start, cdf.shape(1), u) - 1;
    let (below, above) = (start + interval, start + interval + 1);
    let fraction = (u - cdf[below]) / (cdf[above] - cdf[below]);
    let share = f32::min(f32::max(fraction, 0.0f32), 1.0f32);
    out[at] = edges[below] + share * (edges[above] - edges[below]);
}

/// Computes the distance of each sample and the length of its interval ([`intervals`](crate::sampling::intervals)). The last
/// interval under [`Placement::Left`] has length `last`, or that of the one before if `last` is 0.
#[cube(launch)]
pub(super) fn intervals(
    t: &Tensor<f32>,
    ends: &Tensor<f32>,
    distance: &mut Tensor<f32>,
    length: &mut Tensor<f32>,
    last: f32,
    #[comptime] rule: Placement,
) {
    let at = ABSOLUTE_POS;
    if at >= length.len() {
        terminate!();
    }
    let count = t.shape(1);
    let (row, i) = (at / count, at % count);
    let mut place = t[at];
    let mut own = last;
    match comptime!(rule) {
        Placement::Left => {
            if i + 1 < count {
                own = t[at + 1] - t[at];
            } else if last == 0.0f32 {
                if count > 1 {
                    own = t[at] - t[at - 1];
                } else {
                    own = end(ends, row, 1) - t[at];
                }
            }
        }
        Placement::Mid => {
            let mut lower = end(ends, row, 0);
            if i > 0 {
                lower = 0.5f32 * (t[at - 1] + t[at]);
            }
            let mut upper = end(ends, row, 1);
            if i + 1 < count {
                upper = 0.5f32 * (t[at] + t[at + 1]);
            }
            own = f32::max(upper - lower, 0.0f32);
        }
        Placement::Interval => {
            let edge = at / (count - 1) * count + at % (count - 1);
            place = 0.5f32 * (t[edge] + t[edge + 1]);
            own = t[edge + 1] - t[edge];
        }
    }
    distance[at] = place;
    length[at] = own;
}
