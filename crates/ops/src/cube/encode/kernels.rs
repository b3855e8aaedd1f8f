//! The kernels: one thread per coordinate, and a sine that is the same on every device.

use burn::cubecl::{self, prelude::*};

/// An angle in quarter turns, as a sum: a single `f32` does not keep enough digits for the high frequencies.
#[derive(CubeType)]
pub(crate) struct Angle {
    pub(crate) first: f32,
    pub(crate) second: f32,
    pub(crate) third: f32,
    pub(crate) rest: f32,
}

/// `x` radians: 2x/π to 45 bits, less whole turns.
///
/// Both factors are split into pieces of 12 bits, whose products are exact, so that it does not matter whether a compiler
/// fuses or reorders.
#[cube]
pub(crate) fn angle(x: f32) -> Angle {
    // 2/π
    let (c1, c2, c3, c4) = (0.636_474_6f32, 1.451_373_1e-4f32, 2.567_685_4e-8f32, 5.698_552_7e-12f32);
    let high = f32::from_bits(x.to_bits() & 0xffff_f000u32);
    let low = x - high;
    Angle {
        first: less_whole_turns(high * c1),
        second: less_whole_turns(high * c2),
        third: less_whole_turns(low * c1),
        rest: less_whole_turns((high * c3 + low * c2) + (high * c4 + low * c3)),
    }
}

#[cube]
fn less_whole_turns(quarters: f32) -> f32 {
    quarters - 4.0f32 * f32::round(quarters / 4.0f32)
}

/// (sine, cosine). A GPU's own are only as good as its maker cares; these are right to 2e-7.
#[derive(CubeType)]
pub(crate) struct Wave {
    pub(crate) sine: f32,
    pub(crate) cosine: f32,
}

/// Sine and cosine of `angle` times `scale`, a power of two.
#[cube]
pub(crate) fn wave(angle: &Angle, scale: f32) -> Wave {
    let first = angle.first * scale;
    let second = angle.second * scale;
    let third = angle.third * scale;
    let last = angle.rest * scale;
    let (first_turns, second_turns, third_turns, last_turns) =
        (f32::round(first), f32::round(second), f32::round(third), f32::round(last));
    let rest = (first - first_turns) + (second - second_turns) + ((third - third_turns) + (last - last_turns));
    let rest_turns = f32::round(rest);
    let turns = first_turns + second_turns + third_turns + last_turns + rest_turns;
    let r = (rest - rest_turns) * std::f32::consts::FRAC_PI_2;
    let square = r * r;
    let s = r
        * (1.0f32
            - square / 6.0f32
                * (1.0f32 - square / 20.0f32 * (1.0f32 - square / 42.0f32 * (1.0f32 - square / 72.0f32))));
    let c = 1.0f32
        - square / 2.0f32
            * (1.0f32
                - square / 12.0f32
                    * (1.0f32 - square / 30.0f32 * (1.0f32 - square / 56.0f32 * (1.0f32 - square / 90.0f32))));
    let quadrant = i32::cast_from(turns - 4.0f32 * f32::floor(turns / 4.0f32));
    let mut sine = s;
    let mut cosine = c;
    if quadrant == 1 || quadrant == 3 {
        sine = c;
        cosine = -s;
    }
    if quadrant >= 2 {
        sine = -sine;
        cosine = -cosine;
    }
    Wave { sine, cosine }
}

/// Row by row the point, then sines and cosines of each frequency.
#[cube(launch)]
pub(super) fn frequency(points: &Tensor<f32>, window: &Tensor<f32>, out: &mut Tensor<f32>, frequencies: usize) {
    let dims = points.shape(1);
    if ABSOLUTE_POS >= points.shape(0) * dims {
        terminate!();
    }
    let (row, axis) = (ABSOLUTE_POS / dims, ABSOLUTE_POS % dims);
    let start = row * out.shape(1) + axis;
    let x = points[ABSOLUTE_POS];
    out[start] = x;
    let angle = angle(x);
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let wave = wave(&angle, scale);
        let place = start + dims * (1 + 2 * frequency);
        out[place] = window[frequency] * wave.sine;
        out[place + dims] = window[frequency] * wave.cosine;
        scale *= 2.0f32;
    }
}

/// Gradient with respect to the points. A sine's slope is its frequency times the cosine beside it, a cosine's the sine.
#[cube(launch)]
pub(super) fn frequency_backward(out: &Tensor<f32>, grad: &Tensor<f32>, dpoints: &mut Tensor<f32>, frequencies: usize) {
    let dims = dpoints.shape(1);
    if ABSOLUTE_POS >= dpoints.shape(0) * dims {
        terminate!();
    }
    let (row, axis) = (ABSOLUTE_POS / dims, ABSOLUTE_POS % dims);
    let start = row * out.shape(1) + axis;
    let mut sum = grad[start];
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let sine = start + dims * (1 + 2 * frequency);
        let cosine = sine + dims;
        sum += scale * (grad[sine] * out[cosine] - grad[cosine] * out[sine]);
        scale *= 2.0f32;
    }
    dpoints[ABSOLUTE_POS] = sum;
}

/// The same without the point, faded by its variance.
#[cube(launch)]
pub(super) fn integrated(
    means: &Tensor<f32>,
    variances: &Tensor<f32>,
    window: &Tensor<f32>,
    out: &mut Tensor<f32>,
    frequencies: usize,
) {
    if ABSOLUTE_POS >= variances.shape(0) * 3 {
        terminate!();
    }
    let (row, axis) = (ABSOLUTE_POS / 3, ABSOLUTE_POS % 3);
    let start = row * out.shape(1) + axis;
    let angle = angle(means[ABSOLUTE_POS]);
    let mut fading = -0.5f32 * variances[ABSOLUTE_POS];
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let wave = wave(&angle, scale);
        let weight = window[frequency] * f32::exp(fading);
        let place = start + 6 * frequency;
        out[place] = weight * wave.sine;
        out[place + 3] = weight * wave.cosine;
        fading *= 4.0f32;
        scale *= 2.0f32;
    }
}

/// Gradients with respect to means and variances.
#[cube(launch)]
pub(super) fn integrated_backward(
    out: &Tensor<f32>,
    grad: &Tensor<f32>,
    dmeans: &mut Tensor<f32>,
    dvariances: &mut Tensor<f32>,
    frequencies: usize,
) {
    if ABSOLUTE_POS >= dmeans.shape(0) * 3 {
        terminate!();
    }
    let (row, axis) = (ABSOLUTE_POS / 3, ABSOLUTE_POS % 3);
    let start = row * out.shape(1) + axis;
    let mut along = 0.0f32;
    let mut fading = 0.0f32;
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let sine = start + 6 * frequency;
        let cosine = sine + 3;
        along += scale * (grad[sine] * out[cosine] - grad[cosine] * out[sine]);
        fading -= 0.5f32 * scale * scale * (grad[sine] * out[sine] + grad[cosine] * out[cosine]);
        scale *= 2.0f32;
    }
    dmeans[ABSOLUTE_POS] = along;
    dvariances[ABSOLUTE_POS] = fading;
}
