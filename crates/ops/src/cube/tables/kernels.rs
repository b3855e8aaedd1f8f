//! The kernels: one thread per coordinate of a sample, or per plane that it reads.

use burn::cubecl::{self, prelude::*};

use crate::cube::encode::{Angle, wave};

/// 2u − 1 of each coordinate, and sines and cosines of 2ˡπ(u − ½).
#[cube(launch)]
pub(super) fn frequencies(positions: &Tensor<f32>, weights: &Tensor<f32>, out: &mut Tensor<f32>, frequencies: usize) {
    if ABSOLUTE_POS >= positions.shape(0) * 3 {
        terminate!();
    }
    let (sample, axis) = (ABSOLUTE_POS / 3, ABSOLUTE_POS % 3);
    let start = sample * out.shape(1);
    let u = positions[ABSOLUTE_POS];
    out[start + axis] = 2.0f32 * u - 1.0f32;
    // π(u − ½) is this many quarter turns, exactly.
    let angle = Angle { first: 2.0f32 * (u - 0.5f32), second: 0.0f32, third: 0.0f32, rest: 0.0f32 };
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let wave = wave(&angle, scale);
        let place = start + 3 + frequency * 6 + axis * 2;
        out[place] = weights[frequency] * wave.sine;
        out[place + 1] = weights[frequency] * wave.cosine;
        scale *= 2.0f32;
    }
}

/// Gradient of the same with respect to the positions, given their output and its gradient.
#[cube(launch)]
pub(super) fn frequencies_backward(
    out: &Tensor<f32>,
    grad: &Tensor<f32>,
    dpositions: &mut Tensor<f32>,
    frequencies: usize,
) {
    if ABSOLUTE_POS >= dpositions.shape(0) * 3 {
        terminate!();
    }
    let (sample, axis) = (ABSOLUTE_POS / 3, ABSOLUTE_POS % 3);
    let start = sample * out.shape(1);
    let mut sum = 2.0f32 * grad[start + axis];
    // A mutable that begins as a named constant is no variable to CubeCL, which then refuses to compile `*=`.
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let sine = start + 3 + frequency * 6 + axis * 2;
        sum += std::f32::consts::PI * scale * (grad[sine] * out[sine + 1] - grad[sine + 1] * out[sine]);
        scale *= 2.0f32;
    }
    dpositions[ABSOLUTE_POS] = sum;
}

/// Where a coordinate lies among texels, the centres of which are at (i + ½)/res.
#[derive(CubeType)]
struct Texel {
    /// The texel before it.
    at: usize,
    /// How far behind that it is.
    t: f32,
}

#[cube]
fn texel(u: f32, resolution: usize) -> Texel {
    let last = f32::cast_from(resolution - 1) - 1e-3f32;
    let v = f32::min(f32::max(u * f32::cast_from(resolution) - 0.5f32, 0.0f32), last);
    let at = usize::cast_from(v);
    Texel { at, t: v - f32::cast_from(at) }
}

/// How fast it moves with `u`: not at all beyond the outermost centres.
#[cube]
fn pace(u: f32, resolution: usize) -> f32 {
    let v = u * f32::cast_from(resolution) - 0.5f32;
    let mut pace = 0.0f32;
    if v > 0.0f32 && v < f32::cast_from(resolution - 1) - 1e-3f32 {
        pace = f32::cast_from(resolution);
    }
    pace
}

/// What a plane and its line are read at: the first feature of each of the four corners and two ends, with their shares.
#[derive(CubeType)]
struct Reading {
    /// Corner (0, 0).
    corner: usize,
    /// From a row of the plane to the next.
    row: usize,
    a: f32,
    b: f32,
    /// The first end.
    end: usize,
    c: f32,
}

/// Plane `p` of (xy, xz, yz), and line `p` of (z, y, x).
#[cube]
fn reading(
    positions: &Tensor<f32>,
    sample: usize,
    p: usize,
    offset: usize,
    resolution: usize,
    #[comptime] channels: usize,
) -> Reading {
    let a = texel(positions[3 * sample + p / 2], resolution);
    let b = texel(positions[3 * sample + 1 + (p + 1) / 2], resolution);
    let c = texel(positions[3 * sample + 2 - p], resolution);
    let plane = offset + p * resolution * resolution * channels;
    let line = offset + (3 * resolution + p) * resolution * channels;
    Reading {
        corner: plane + (b.at * resolution + a.at) * channels,
        row: resolution * channels,
        a: a.t,
        b: b.t,
        end: line + c.at * channels,
        c: c.t,
    }
}

/// Feature `k` of the plane.
#[cube]
fn on_plane(tables: &Tensor<f32>, read: &Reading, k: usize, #[comptime] channels: usize) -> f32 {
    let first = read.corner + k;
    let second = first + read.row;
    (1.0f32 - read.b) * ((1.0f32 - read.a) * tables[first] + read.a * tables[first + channels])
        + read.b * ((1.0f32 - read.a) * tables[second] + read.a * tables[second + channels])
}

/// Feature `k` of the line.
#[cube]
fn on_line(tables: &Tensor<f32>, read: &Reading, k: usize, #[comptime] channels: usize) -> f32 {
    (1.0f32 - read.c) * tables[read.end + k] + read.c * tables[read.end + k + channels]
}

/// The features of one level.
#[cube(launch)]
pub(super) fn products(
    tables: &Tensor<f32>,
    positions: &Tensor<f32>,
    out: &mut Tensor<f32>,
    offset: usize,
    feature: usize,
    resolution: usize,
    weight: f32,
    #[comptime] channels: usize,
) {
    if ABSOLUTE_POS >= positions.shape(0) * 3 {
        terminate!();
    }
    let (sample, p) = (ABSOLUTE_POS / 3, ABSOLUTE_POS % 3);
    let read = reading(positions, sample, p, offset, resolution, channels);
    let place = sample * out.shape(1) + feature + p * channels;
    for k in 0..channels {
        out[place + k] = weight * on_plane(tables, &read, k, channels) * on_line(tables, &read, k, channels);
    }
}

/// Adds to a number to which other threads add at the same time. The order of additions is the device's choice.
#[cube]
pub(super) trait Accumulate: Send + Sync + 'static {
    /// What the number is kept as.
    type Word: Numeric;

    fn add(to: &mut Atomic<Self::Word>, value: f32);
}

/// By the device's own atomic addition of `f32`.
#[derive(CubeType)]
pub(super) struct Native;

#[cube]
impl Accumulate for Native {
    type Word = f32;

    fn add(to: &mut Atomic<f32>, value: f32) {
        to.fetch_add(value);
    }
}

/// By exchanging the number's bits until nobody came in between, for devices that lack it.
#[derive(CubeType)]
pub(super) struct Exchange;

#[cube]
impl Accumulate for Exchange {
    type Word = u32;

    fn add(to: &mut Atomic<u32>, value: f32) {
        let mut seen = to.load();
        loop {
            let expected = seen;
            seen = to.compare_exchange_weak(expected, (f32::from_bits(expected) + value).to_bits());
            if seen == expected {
                break;
            }
        }
    }
}

/// The gradient with respect to the tables of one level.
#[cube(launch)]
pub(super) fn products_backward<A: Accumulate>(
    tables: &Tensor<f32>,
    positions: &Tensor<f32>,
    grad: &Tensor<f32>,
    dtables: &mut Tensor<Atomic<A::Word>>,
    offset: usize,
    feature: usize,
    resolution: usize,
    weight: f32,
    #[comptime] channels: usize,
) {
    if ABSOLUTE_POS >= positions.shape(0) * 3 {
        terminate!();
    }
    let (sample, p) = (ABSOLUTE_POS / 3, ABSOLUTE_POS % 3);
    let read = reading(positions, sample, p, offset, resolution, channels);
    let place = sample * grad.shape(1) + feature + p * channels;
    for k in 0..channels {
        let g = weight * grad[place + k];
        if g != 0.0f32 {
            let dplane = g * on_line(tables, &read, k, channels);
            let dline = g * on_plane(tables, &read, k, channels);
            let first = read.corner + k;
            let second = first + read.row;
            A::add(&mut dtables[first], (1.0f32 - read.a) * (1.0f32 - read.b) * dplane);
            A::add(&mut dtables[first + channels], read.a * (1.0f32 - read.b) * dplane);
            A::add(&mut dtables[second], (1.0f32 - read.a) * read.b * dplane);
            A::add(&mut dtables[second + channels], read.a * read.b * dplane);
            A::add(&mut dtables[read.end + k], (1.0f32 - read.c) * dline);
            A::add(&mut dtables[read.end + k + channels], read.c * dline);
        }
    }
}

/// Adds the gradient of one level's features with respect to the positions.
#[cube(launch)]
pub(super) fn products_backward_in_positions(
    tables: &Tensor<f32>,
    positions: &Tensor<f32>,
    grad: &Tensor<f32>,
    dpositions: &mut Tensor<f32>,
    offset: usize,
    feature: usize,
    resolution: usize,
    weight: f32,
    #[comptime] channels: usize,
) {
    let sample = ABSOLUTE_POS;
    if sample >= positions.shape(0) {
        terminate!();
    }
    for p in 0..3usize {
        let read = reading(positions, sample, p, offset, resolution, channels);
        let place = sample * grad.shape(1) + feature + p * channels;
        let mut along_a = 0.0f32;
        let mut along_b = 0.0f32;
        let mut along_c = 0.0f32;
        for k in 0..channels {
            let g = weight * grad[place + k];
            let first = read.corner + k;
            let second = first + read.row;
            let dplane = g * on_line(tables, &read, k, channels);
            along_a += dplane
                * ((1.0f32 - read.b) * (tables[first + channels] - tables[first])
                    + read.b * (tables[second + channels] - tables[second]));
            along_b += dplane
                * ((1.0f32 - read.a) * (tables[second] - tables[first])
                    + read.a * (tables[second + channels] - tables[first + channels]));
            along_c +=
                g * on_plane(tables, &read, k, channels) * (tables[read.end + k + channels] - tables[read.end + k]);
        }
        let (a, b, c) = (3 * sample + p / 2, 3 * sample + 1 + (p + 1) / 2, 3 * sample + 2 - p);
        dpositions[a] += along_a * pace(positions[a], resolution);
        dpositions[b] += along_b * pace(positions[b], resolution);
        dpositions[c] += along_c * pace(positions[c], resolution);
    }
}
