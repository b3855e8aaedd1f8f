//! The MLP's input from positions and tables, a row per sample, and its gradients.

use super::dense::BLOCK;
use super::layout::{Level, PLANES};

/// Positions of a block, one row per axis.
pub(super) type Block = [[f32; BLOCK]; 3];

pub(super) fn block<'a>(positions: impl Iterator<Item = &'a [f32]>) -> Block {
    let mut block = [[0.0; BLOCK]; 3];
    for (s, u) in positions.enumerate() {
        for axis in 0..3 {
            block[axis][s] = u[axis];
        }
    }
    block
}

/// Finds the texel before `u` along an axis, and the distance of `u` behind its centre, in texels.
#[inline(always)]
fn texel(u: f32, resolution: usize) -> (i32, f32) {
    let last = (resolution - 1) as f32;
    // Texel centres lie at (i + ½)/res. NaN is placed at the far end.
    let v = (u * resolution as f32 - 0.5).min(last - 1e-3).max(0.0);
    // SAFETY: v lies between 0 and the last texel.
    #[allow(unsafe_code, reason = "a checked conversion is not vectorised")]
    let i = unsafe { v.to_int_unchecked::<i32>() };
    (i, v - i as f32)
}

/// Computes the derivative of [`texel`]'s place with respect to `u`: 0 beyond the outermost texels' centres.
#[inline(always)]
fn texel_derivative(u: f32, resolution: usize) -> f32 {
    let v = u * resolution as f32 - 0.5;
    if v > 0.0 && v < (resolution - 1) as f32 - 1e-3 { resolution as f32 } else { 0.0 }
}

/// Writes position and frequencies to the first columns of `x`, whose rows are `stride` apart: x, y, z, then for each
/// frequency sin and cos of 2^k π (u − ½) of each axis.
#[inline(always)]
pub(super) fn frequencies(positions: &Block, weights: &[f32], x: &mut [f32], stride: usize, samples: usize) {
    let (mut sine, mut cosine) = ([0.0; BLOCK], [0.0; BLOCK]);
    for axis in 0..3 {
        for s in 0..samples {
            x[s * stride + axis] = 2.0 * positions[axis][s] - 1.0;
        }
        if weights.is_empty() {
            continue;
        }
        for s in 0..BLOCK {
            (sine[s], cosine[s]) = sin_cos_pi(positions[axis][s] - 0.5);
        }
        for (frequency, weight) in weights.iter().enumerate() {
            let column = 3 + frequency * 6 + axis * 2;
            for s in 0..samples {
                x[s * stride + column] = sine[s] * weight;
                x[s * stride + column + 1] = cosine[s] * weight;
            }
            for s in 0..BLOCK {
                // Double the angle.
                (sine[s], cosine[s]) = (2.0 * sine[s] * cosine[s], 1.0 - 2.0 * sine[s] * sine[s]);
            }
        }
    }
}

/// Computes the gradient with respect to the positions through [`frequencies`], from their result `x` and its gradient `dx`; rows
/// of both are `stride` apart.
#[inline(always)]
pub(super) fn frequency_gradient(x: &[f32], dx: &[f32], frequencies: usize, stride: usize, samples: usize) -> Block {
    let mut gradient = [[0.0; BLOCK]; 3];
    for (s, (x, dx)) in x.chunks(stride).zip(dx.chunks(stride)).take(samples).enumerate() {
        for axis in 0..3 {
            let (mut sum, mut scale) = (2.0 * dx[axis], std::f32::consts::PI);
            for frequency in 0..frequencies {
                let sine = 3 + frequency * 6 + axis * 2;
                sum += scale * (dx[sine] * x[sine + 1] - dx[sine + 1] * x[sine]);
                scale *= 2.0;
            }
            gradient[axis][s] = sum;
        }
    }
    gradient
}

/// Computes sin πx and cos πx, for |x| < 2^20.
#[inline(always)]
fn sin_cos_pi(x: f32) -> (f32, f32) {
    // Values near 1.5 × 2^23 have a spacing of 1, and their last bits are those of the integer.
    const ROUNDING: f32 = 12_582_912.0;
    let rounded = x * 2.0 + ROUNDING;
    let quarters = rounded - ROUNDING;
    let r = (x - quarters * 0.5) * std::f32::consts::PI;
    let r2 = r * r;
    let s = r * (1.0 + r2 * (-1.0 / 6.0 + r2 * (1.0 / 120.0 + r2 * (-1.0 / 5040.0 + r2 / 362_880.0))));
    let c = 1.0 + r2 * (-0.5 + r2 * (1.0 / 24.0 + r2 * (-1.0 / 720.0 + r2 / 40_320.0)));
    let quarter = rounded.to_bits();
    let (a, b) = if quarter & 1 == 0 { (s, c) } else { (c, s) };
    (if quarter & 2 != 0 { -a } else { a }, if (quarter + 1) & 2 != 0 { -b } else { b })
}

/// Places of the samples of a block among the texels of a level: the texel before each along an axis, and the distance behind
/// it.
pub(super) struct Places {
    resolution: usize,
    before: [[i32; BLOCK]; 3],
    behind: Block,
}

#[allow(clippy::needless_range_loop, reason = "iterators are not compiled for the instruction set chosen at run time")]
#[inline(always)]
pub(super) fn places(positions: &Block, resolution: usize) -> Places {
    let mut places = Places { resolution, before: [[0; BLOCK]; 3], behind: [[0.0; BLOCK]; 3] };
    for axis in 0..3 {
        for s in 0..BLOCK {
            (places.before[axis][s], places.behind[axis][s]) = texel(positions[axis][s], resolution);
        }
    }
    places
}

/// Place along one axis: the texel before it, which is not the last, and the distance behind that texel.
type Place = (usize, f32);

impl Places {
    /// Returns each plane of a level with its line, after [`Self::check`].
    #[inline(always)]
    fn checked<'a, const C: usize>(&self, tables: &'a [f32], level: &Level) -> [(&'a [f32], &'a [f32]); 3] {
        let tables = [tables_of(tables, level, 0), tables_of(tables, level, 1), tables_of(tables, level, 2)];
        for (plane, line) in tables {
            self.check::<C>(plane, line);
        }
        tables
    }

    /// Panics unless a plane and its line have the resolution of these places, so that both texels of each are inside.
    #[inline(always)]
    fn check<const C: usize>(&self, plane: &[f32], line: &[f32]) {
        let [row, all] = [self.resolution * C, self.resolution * self.resolution * C];
        // Above 8192 texels, `f32` does not resolve a place 1e-3 before the last one.
        assert!((2..=1 << 13).contains(&self.resolution), "2 to 8192 texels along each axis");
        assert!(line.len() == row && plane.len() == all, "tables of {} texels along each axis", self.resolution);
    }

    #[inline(always)]
    fn at(&self, axis: usize, sample: usize) -> Place {
        (self.before[axis][sample] as usize, self.behind[axis][sample])
    }
}

/// Interpolates the `C` channels of two neighbouring texels at the distance `behind` from the first.
#[inline(always)]
fn mixed<const C: usize>(texels: &[f32], behind: f32) -> [f32; C] {
    // A loop, not `from_fn`: closures are not compiled for the instruction set chosen at run time.
    let mut out = [0.0; C];
    for c in 0..C {
        out[c] = texels[c] + behind * (texels[C + c] - texels[c]);
    }
    out
}

/// Returns the two texels from `first` on, the place in a plane or line of tables that were [checked](Places::check).
#[inline(always)]
fn pair<const C: usize>(table: &[f32], first: usize) -> &[f32] {
    debug_assert!((first + 2) * C <= table.len());
    // SAFETY: a place's texel is not the last of its axis, and the tables have the places' resolution.
    #[allow(unsafe_code, reason = "checks would take as long as the sums")]
    unsafe {
        table.get_unchecked(first * C..first * C + 2 * C)
    }
}

#[inline(always)]
fn linear<const C: usize>(line: &[f32], (i, t): Place) -> [f32; C] {
    mixed(pair::<C>(line, i), t)
}

#[inline(always)]
fn bilinear<const C: usize>(plane: &[f32], resolution: usize, (i, a): Place, (j, b): Place) -> [f32; C] {
    let (near, far) = (pair::<C>(plane, j * resolution + i), pair::<C>(plane, (j + 1) * resolution + i));
    let mut columns = [[0.0; C]; 2];
    for side in 0..2 {
        for c in 0..C {
            columns[side][c] = near[side * C + c] + b * (far[side * C + c] - near[side * C + c]);
        }
    }
    mixed(columns.as_flattened(), a)
}

#[inline(always)]
pub(super) fn tables_of<'a>(tables: &'a [f32], level: &Level, p: usize) -> (&'a [f32], &'a [f32]) {
    let plane = &tables[level.plane(p)..level.plane(p) + level.plane_len()];
    (plane, &tables[level.line(p)..level.line(p) + level.line_len()])
}

/// Writes the features of one level to `3C` columns of `x`, whose rows are `stride` apart.
#[inline(always)]
pub(super) fn level_features<const C: usize>(
    (level, weight): (&Level, f32),
    tables: &[f32],
    places: &Places,
    (x, stride): (&mut [f32], usize),
    samples: usize,
) {
    let tables = places.checked::<C>(tables, level);
    for s in 0..samples {
        let row = &mut x[s * stride + level.feature..][..3 * C];
        let at = [places.at(0, s), places.at(1, s), places.at(2, s)];
        for p in 0..3 {
            let [a, b, c] = PLANES[p];
            let plane = bilinear::<C>(tables[p].0, places.resolution, at[a], at[b]);
            let line = linear::<C>(tables[p].1, at[c]);
            for k in 0..C {
                row[p * C + k] = weight * plane[k] * line[k];
            }
        }
    }
}

/// Adds the gradient `g` of an interpolated value to the gradients of its two texels.
#[inline(always)]
fn add_to_pair<const C: usize>(texels: &mut [f32], g: &[f32; C], behind: f32) {
    for c in 0..C {
        texels[c] += g[c] - behind * g[c];
    }
    for c in 0..C {
        texels[C + c] += behind * g[c];
    }
}

/// Adds to the gradients of a plane and its line, given the gradient of their features, `dx` `[samples, C]`.
#[inline(always)]
pub(super) fn plane_gradient<const C: usize>(
    (axes, weight): ([usize; 3], f32),
    (plane, line): (&[f32], &[f32]),
    places: &Places,
    dx: &[f32],
    (dplane, dline): (&mut [f32], &mut [f32]),
    samples: usize,
) {
    let ([a, b, c], resolution) = (axes, places.resolution);
    places.check::<C>(plane, line);
    for (s, dx) in dx.as_chunks::<C>().0.iter().enumerate().take(samples) {
        let ((i, along), (j, across), at) = (places.at(a, s), places.at(b, s), places.at(c, s));
        let on_plane = bilinear::<C>(plane, resolution, (i, along), (j, across));
        let on_line = linear::<C>(line, at);
        let (mut near, mut far, mut of_line) = ([0.0; C], [0.0; C], [0.0; C]);
        for k in 0..C {
            let d = weight * dx[k];
            far[k] = across * (d * on_line[k]);
            near[k] = d * on_line[k] - far[k];
            of_line[k] = d * on_plane[k];
        }
        let first = j * resolution + i;
        add_to_pair(&mut dplane[first * C..(first + 2) * C], &near, along);
        add_to_pair(&mut dplane[(first + resolution) * C..(first + resolution + 2) * C], &far, along);
        add_to_pair(&mut dline[at.0 * C..(at.0 + 2) * C], &of_line, at.1);
    }
}

/// Adds to the `gradient` of the positions the part through one level's features, whose gradient is `dx`.
#[inline(always)]
pub(super) fn position_gradient<const C: usize>(
    (level, weight): (&Level, f32),
    tables: &[f32],
    positions: &Block,
    (dx, stride): (&[f32], usize),
    samples: usize,
    gradient: &mut Block,
) {
    let places = places(positions, level.resolution);
    let res = places.resolution;
    let tables = places.checked::<C>(tables, level);
    for s in 0..samples {
        for p in 0..3 {
            let ([a, b, c], (plane, line)) = (PLANES[p], tables[p]);
            let ((i, along), (j, across), at) = (places.at(a, s), places.at(b, s), places.at(c, s));
            let (near, far) = (pair::<C>(plane, j * res + i), pair::<C>(plane, (j + 1) * res + i));
            let on_plane = bilinear::<C>(plane, res, (i, along), (j, across));
            let (on_line, ends) = (linear::<C>(line, at), pair::<C>(line, at.0));
            let mut derivatives = [0.0; 3];
            for k in 0..C {
                let d = weight * dx[s * stride + level.feature + p * C + k];
                let (first, second) = (near[C + k] - near[k], far[C + k] - far[k]);
                derivatives[0] += d * on_line[k] * (first + across * (second - first));
                let (first, second) = (far[k] - near[k], far[C + k] - near[C + k]);
                derivatives[1] += d * on_line[k] * (first + along * (second - first));
                derivatives[2] += d * on_plane[k] * (ends[C + k] - ends[k]);
            }
            for (axis, derivative) in [a, b, c].into_iter().zip(derivatives) {
                gradient[axis][s] += texel_derivative(positions[axis][s], res) * derivative;
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
