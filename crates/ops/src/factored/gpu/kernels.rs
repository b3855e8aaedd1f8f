//! Kernels with one thread per sample and axis, or sample and plane, for all levels, whose sizes are compile-time constants.

use burn::cubecl::{self, prelude::*};

use crate::factored::Level;
use crate::frequency::gpu::{Angle, wave};

/// Writes 2u − 1 of a coordinate, and sines and cosines of 2ˡπ(u − ½).
#[cube]
fn encode_coordinate(
    u: f32,
    weights: &Tensor<f32>,
    out: &mut Tensor<f32>,
    start: usize,
    axis: usize,
    #[comptime] frequencies: usize,
) {
    out[start + axis] = 2.0f32 * u - 1.0f32;
    // π(u − ½) is exactly 2(u − ½) quarter turns.
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

/// Computes the gradient with respect to the coordinate, given the output and its gradient.
#[cube]
fn coordinate_gradient(
    out: &Tensor<f32>,
    grad: &Tensor<f32>,
    start: usize,
    axis: usize,
    #[comptime] frequencies: usize,
) -> f32 {
    let mut sum = 2.0f32 * grad[start + axis];
    // CubeCL takes a mutable that begins as a named constant for a constant, and refuses to compile `*=`.
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let sine = start + 3 + frequency * 6 + axis * 2;
        sum += std::f32::consts::PI * scale * (grad[sine] * out[sine + 1] - grad[sine + 1] * out[sine]);
        scale *= 2.0f32;
    }
    sum
}

/// Place of a coordinate among texels, whose centres are at (i + ½)/res.
#[derive(CubeType)]
struct Texel {
    /// Texel before the coordinate.
    at: usize,
    /// Distance behind that texel, in texels.
    t: f32,
}

#[cube]
fn texel(u: f32, resolution: usize) -> Texel {
    let last = f32::cast_from(resolution - 1) - 1e-3f32;
    let v = f32::min(f32::max(u * f32::cast_from(resolution) - 0.5f32, 0.0f32), last);
    let at = usize::cast_from(v);
    Texel { at, t: v - f32::cast_from(at) }
}

/// Computes the derivative of the place with respect to `u`: 0 beyond the outermost centres.
#[cube]
fn texel_derivative(u: f32, resolution: usize) -> f32 {
    let v = u * f32::cast_from(resolution) - 0.5f32;
    let mut derivative = 0.0f32;
    if v > 0.0f32 && v < f32::cast_from(resolution - 1) - 1e-3f32 {
        derivative = f32::cast_from(resolution);
    }
    derivative
}

/// Places at which a plane and its line are read.
#[derive(CubeType)]
struct Reading {
    /// First feature of the corner (0, 0) of the plane's four texels.
    corner: usize,
    /// Distance between rows of the plane.
    row: usize,
    a: f32,
    b: f32,
    /// First feature of the first of the line's two texels.
    end: usize,
    c: f32,
}

/// Locates a sample in plane `p` of (xy, xz, yz), and in line `p` of (z, y, x).
#[cube]
fn reading(positions: &Tensor<f32>, sample: usize, p: usize, #[comptime] level: Level) -> Reading {
    let offset = comptime!(level.offset);
    let resolution = comptime!(level.resolution);
    let channels = comptime!(level.channels);
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

/// Interpolates feature `k` of the plane.
#[cube]
fn on_plane(tables: &Tensor<f32>, read: &Reading, k: usize, #[comptime] channels: usize) -> f32 {
    let first = read.corner + k;
    let second = first + read.row;
    (1.0f32 - read.b) * ((1.0f32 - read.a) * tables[first] + read.a * tables[first + channels])
        + read.b * ((1.0f32 - read.a) * tables[second] + read.a * tables[second + channels])
}

/// Interpolates feature `k` of the line.
#[cube]
fn on_line(tables: &Tensor<f32>, read: &Reading, k: usize, #[comptime] channels: usize) -> f32 {
    (1.0f32 - read.c) * tables[read.end + k] + read.c * tables[read.end + k + channels]
}

/// Computes the MLP's input, one thread per sample and axis, or plane. `weights` has the weights of the frequencies, then of
/// the levels.
#[cube(launch)]
pub(super) fn features(
    tables: &Tensor<f32>,
    positions: &Tensor<f32>,
    weights: &Tensor<f32>,
    out: &mut Tensor<f32>,
    #[comptime] frequencies: usize,
    #[comptime] levels: Vec<Level>,
) {
    if ABSOLUTE_POS >= out.shape(0) * 3 {
        terminate!();
    }
    let (sample, p) = (ABSOLUTE_POS / 3, ABSOLUTE_POS % 3);
    let start = sample * out.shape(1);
    encode_coordinate(positions[ABSOLUTE_POS], weights, out, start, p, frequencies);
    #[unroll]
    for l in 0..levels.len() {
        let channels = comptime!(levels[l].channels);
        let read = reading(positions, sample, p, comptime!(levels[l].clone()));
        let place = start + comptime!(levels[l].feature) + p * channels;
        let weight = weights[frequencies + l];
        for k in 0..channels {
            let mut feature = 0.0f32;
            if weight != 0.0f32 {
                feature = weight * on_plane(tables, &read, k, channels) * on_line(tables, &read, k, channels);
            }
            out[place + k] = feature;
        }
    }
}

/// Addition to an element to which other threads add at the same time; the device chooses the order.
#[cube]
pub(super) trait Accumulate: Send + Sync + 'static {
    /// Representation of the element.
    type Word: Numeric;

    /// Adds `value`.
    fn add(to: &mut Atomic<Self::Word>, value: f32);
}

/// Atomic addition of `f32` by the device.
#[derive(CubeType)]
pub(super) struct Native;

#[cube]
impl Accumulate for Native {
    type Word = f32;

    fn add(to: &mut Atomic<f32>, value: f32) {
        to.fetch_add(value);
    }
}

/// Atomic addition by compare-and-exchange of the bits, for devices without a native one.
#[derive(CubeType)]
pub(super) struct CompareExchange;

#[cube]
impl Accumulate for CompareExchange {
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

/// Adds the gradient with respect to the tables, one thread per sample and plane.
#[cube(launch)]
pub(super) fn table_gradient<A: Accumulate>(
    tables: &Tensor<f32>,
    positions: &Tensor<f32>,
    weights: &Tensor<f32>,
    grad: &Tensor<f32>,
    dtables: &mut Tensor<Atomic<A::Word>>,
    #[comptime] frequencies: usize,
    #[comptime] levels: Vec<Level>,
) {
    if ABSOLUTE_POS >= positions.shape(0) * 3 {
        terminate!();
    }
    let (sample, p) = (ABSOLUTE_POS / 3, ABSOLUTE_POS % 3);
    #[unroll]
    for l in 0..levels.len() {
        let channels = comptime!(levels[l].channels);
        let read = reading(positions, sample, p, comptime!(levels[l].clone()));
        let place = sample * grad.shape(1) + comptime!(levels[l].feature) + p * channels;
        for k in 0..channels {
            let g = weights[frequencies + l] * grad[place + k];
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
}

/// Computes the gradient with respect to the positions, one thread per sample.
#[cube(launch)]
pub(super) fn position_gradient(
    tables: &Tensor<f32>,
    positions: &Tensor<f32>,
    weights: &Tensor<f32>,
    out: &Tensor<f32>,
    grad: &Tensor<f32>,
    dpositions: &mut Tensor<f32>,
    #[comptime] frequencies: usize,
    #[comptime] levels: Vec<Level>,
) {
    let sample = ABSOLUTE_POS;
    if sample >= positions.shape(0) {
        terminate!();
    }
    let start = sample * grad.shape(1);
    for axis in 0..3usize {
        dpositions[3 * sample + axis] = coordinate_gradient(out, grad, start, axis, frequencies);
    }
    #[unroll]
    for l in 0..levels.len() {
        let channels = comptime!(levels[l].channels);
        let resolution = comptime!(levels[l].resolution);
        for p in 0..3usize {
            let read = reading(positions, sample, p, comptime!(levels[l].clone()));
            let place = start + comptime!(levels[l].feature) + p * channels;
            let mut along_a = 0.0f32;
            let mut along_b = 0.0f32;
            let mut along_c = 0.0f32;
            for k in 0..channels {
                let g = weights[frequencies + l] * grad[place + k];
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
            dpositions[a] += along_a * texel_derivative(positions[a], resolution);
            dpositions[b] += along_b * texel_derivative(positions[b], resolution);
            dpositions[c] += along_c * texel_derivative(positions[c], resolution);
        }
    }
}
