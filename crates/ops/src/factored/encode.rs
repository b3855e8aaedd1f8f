//! From positions to the MLP's input, feature-major over a block; and back into the tables.

use super::dense::BLOCK;
use super::layout::{Level, PLANES};

/// Positions of a block, one row per axis.
pub(super) type Block = [[f32; BLOCK]; 3];

/// Positions `[samples, 3]` of a block, one row per axis.
pub(super) fn block(positions: &[f32]) -> Block {
    let mut block = [[0.0; BLOCK]; 3];
    for (s, u) in positions.chunks_exact(3).enumerate() {
        for axis in 0..3 {
            block[axis][s] = u[axis];
        }
    }
    block
}

/// The texel before `u` along an axis, and how far behind it `u` is.
#[inline(always)]
pub(super) fn texel(u: f32, resolution: usize) -> (usize, f32) {
    let last = (resolution - 1) as f32;
    // Texel centres lie at (i + ½)/res. NaN becomes 0.
    let v = (u * resolution as f32 - 0.5).min(last - 1e-3).max(0.0);
    let i = v as usize;
    (i, v - i as f32)
}

/// How fast [`texel`]'s place moves with `u`: not at all beyond the outermost texels' centres.
#[inline(always)]
fn pace(u: f32, resolution: usize) -> f32 {
    let v = u * resolution as f32 - 0.5;
    if v > 0.0 && v < (resolution - 1) as f32 - 1e-3 { resolution as f32 } else { 0.0 }
}

/// Position and its frequencies: rows x, y, z, then for each frequency sin and cos of 2^k π (u − ½) of each axis.
#[inline(always)]
pub(super) fn frequencies(positions: &Block, weights: &[f32], x: &mut [f32], samples: usize) {
    for axis in 0..3 {
        for s in 0..samples {
            x[axis * BLOCK + s] = 2.0 * positions[axis][s] - 1.0;
        }
        for s in 0..samples {
            let (mut sin, mut cos) = sin_cos_pi(positions[axis][s] - 0.5);
            for (frequency, weight) in weights.iter().enumerate() {
                let row = 3 + frequency * 6 + axis * 2;
                x[row * BLOCK + s] = sin * weight;
                x[(row + 1) * BLOCK + s] = cos * weight;
                // Double the angle.
                (sin, cos) = (2.0 * sin * cos, 1.0 - 2.0 * sin * sin);
            }
        }
    }
}

/// Gradient with respect to the positions, of what [`frequencies`] made of them: `x`, given its own gradient `dx`.
#[inline(always)]
pub(super) fn frequency_gradient(x: &[f32], dx: &[f32], frequencies: usize, samples: usize) -> Block {
    let mut gradient = [[0.0; BLOCK]; 3];
    for axis in 0..3 {
        for s in 0..samples {
            gradient[axis][s] = 2.0 * dx[axis * BLOCK + s];
        }
        let mut slope = std::f32::consts::PI;
        for frequency in 0..frequencies {
            let sine = (3 + frequency * 6 + axis * 2) * BLOCK;
            let cosine = sine + BLOCK;
            for s in 0..samples {
                gradient[axis][s] += slope * (dx[sine + s] * x[cosine + s] - dx[cosine + s] * x[sine + s]);
            }
            slope *= 2.0;
        }
    }
    gradient
}

/// sin πx and cos πx.
#[inline(always)]
fn sin_cos_pi(x: f32) -> (f32, f32) {
    let quarters = (x * 2.0).round_ties_even();
    let r = (x - quarters * 0.5) * std::f32::consts::PI;
    let r2 = r * r;
    let s = r * (1.0 + r2 * (-1.0 / 6.0 + r2 * (1.0 / 120.0 + r2 * (-1.0 / 5040.0 + r2 / 362_880.0))));
    let c = 1.0 + r2 * (-0.5 + r2 * (1.0 / 24.0 + r2 * (-1.0 / 720.0 + r2 / 40_320.0)));
    let quarter = quarters as i32;
    let (a, b) = if quarter & 1 == 0 { (s, c) } else { (c, s) };
    (if quarter & 2 != 0 { -a } else { a }, if (quarter + 1) & 2 != 0 { -b } else { b })
}

/// Four texels of a plane around a point, with their weights.
struct Corners {
    at: [usize; 2],
    weights: [f32; 4],
}

#[inline(always)]
fn corners<const C: usize>(resolution: usize, (i, a): (usize, f32), (j, b): (usize, f32)) -> Corners {
    let first = (j * resolution + i) * C;
    Corners {
        at: [first, first + resolution * C],
        weights: [(1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b],
    }
}

#[inline(always)]
fn bilinear<const C: usize>(plane: &[f32], corners: &Corners) -> [f32; C] {
    let (near, far) = (&plane[corners.at[0]..corners.at[0] + 2 * C], &plane[corners.at[1]..corners.at[1] + 2 * C]);
    let w = corners.weights;
    // A loop, not `from_fn`: closures are not compiled for the instruction set chosen at run time.
    let mut out = [0.0; C];
    for c in 0..C {
        out[c] = w[0] * near[c] + w[1] * near[C + c] + w[2] * far[c] + w[3] * far[C + c];
    }
    out
}

#[inline(always)]
fn linear<const C: usize>(line: &[f32], (i, a): (usize, f32)) -> [f32; C] {
    let row = &line[i * C..(i + 2) * C];
    let mut out = [0.0; C];
    for c in 0..C {
        out[c] = row[c] + a * (row[C + c] - row[c]);
    }
    out
}

/// Features of one level into rows `0..3C` of `x`.
#[inline(always)]
pub(super) fn level_features<const C: usize>(
    level: &Level,
    weight: f32,
    tables: &[f32],
    positions: &Block,
    x: &mut [f32],
    samples: usize,
) {
    let res = level.resolution;
    for s in 0..samples {
        let at = [texel(positions[0][s], res), texel(positions[1][s], res), texel(positions[2][s], res)];
        for (p, [a, b, c]) in PLANES.into_iter().enumerate() {
            let plane = bilinear::<C>(
                &tables[level.plane(p)..level.plane(p) + level.plane_len()],
                &corners::<C>(res, at[a], at[b]),
            );
            let line = linear::<C>(&tables[level.line(p)..level.line(p) + level.line_len()], at[c]);
            for k in 0..C {
                x[(p * C + k) * BLOCK + s] = weight * plane[k] * line[k];
            }
        }
    }
}

/// Gradient of one plane and its line, from rows `p·C..(p + 1)·C` of the level's features (`dx`).
#[inline(always)]
pub(super) fn plane_gradient<const C: usize>(
    (resolution, axes, weight): (usize, [usize; 3], f32),
    (plane, line): (&[f32], &[f32]),
    positions: &[f32],
    dx: &[f32],
    (dplane, dline): (&mut [f32], &mut [f32]),
) {
    let [a, b, c] = axes;
    for (s, u) in positions.chunks_exact(3).enumerate() {
        let mut d = [0.0; C];
        for k in 0..C {
            d[k] = weight * dx[k * BLOCK + s];
        }
        let corners = corners::<C>(resolution, texel(u[a], resolution), texel(u[b], resolution));
        let (i, t) = texel(u[c], resolution);
        let (on_plane, on_line) = (bilinear::<C>(plane, &corners), linear::<C>(line, (i, t)));
        let w = corners.weights;
        for (at, [near, far]) in corners.at.into_iter().zip([[w[0], w[1]], [w[2], w[3]]]) {
            let out = &mut dplane[at..at + 2 * C];
            for k in 0..C {
                out[k] += near * d[k] * on_line[k];
            }
            for k in 0..C {
                out[C + k] += far * d[k] * on_line[k];
            }
        }
        let out = &mut dline[i * C..(i + 2) * C];
        for k in 0..C {
            out[k] += (1.0 - t) * d[k] * on_plane[k];
        }
        for k in 0..C {
            out[C + k] += t * d[k] * on_plane[k];
        }
    }
}

/// Adds the gradient of one level's features with respect to the positions, given the features' own (`dx`).
#[inline(always)]
pub(super) fn position_gradient<const C: usize>(
    level: &Level,
    weight: f32,
    tables: &[f32],
    positions: &Block,
    dx: &[f32],
    samples: usize,
    gradient: &mut Block,
) {
    let res = level.resolution;
    for s in 0..samples {
        let at = [0, 1, 2].map(|axis| texel(positions[axis][s], res));
        for (p, [a, b, c]) in PLANES.into_iter().enumerate() {
            let plane = &tables[level.plane(p)..level.plane(p) + level.plane_len()];
            let line = &tables[level.line(p)..level.line(p) + level.line_len()];
            let corners = corners::<C>(res, at[a], at[b]);
            let (on_plane, on_line) = (bilinear::<C>(plane, &corners), linear::<C>(line, at[c]));
            let (near, far) = (&plane[corners.at[0]..], &plane[corners.at[1]..]);
            let ends = &line[at[c].0 * C..];
            let mut slopes = [0.0; 3];
            for k in 0..C {
                let d = weight * dx[(p * C + k) * BLOCK + s];
                let (across, along) = (far[C + k] - far[k], near[C + k] - near[k]);
                slopes[0] += d * on_line[k] * (along + at[b].1 * (across - along));
                let (across, along) = (far[C + k] - near[C + k], far[k] - near[k]);
                slopes[1] += d * on_line[k] * (along + at[a].1 * (across - along));
                slopes[2] += d * on_plane[k] * (ends[C + k] - ends[k]);
            }
            for (axis, slope) in [a, b, c].into_iter().zip(slopes) {
                gradient[axis][s] += pace(positions[axis][s], res) * slope;
            }
        }
    }
}

/// Calls a function with the number of channels as a constant.
macro_rules! with_channels {
    ($channels:expr, $function:ident, $($argument:expr),+ $(,)?) => {
        match $channels {
            2 => $function::<2>($($argument),+),
            4 => $function::<4>($($argument),+),
            8 => $function::<8>($($argument),+),
            16 => $function::<16>($($argument),+),
            other => unreachable!("a level has 2, 4, 8 or 16 channels, not {other}"),
        }
    };
}
pub(super) use with_channels;
