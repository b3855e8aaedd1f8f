//! The kernels: one thread a coordinate, and a sine that is the same on every device.

use burn::cubecl::{self, prelude::*};

/// An angle in quarter turns: a sum, as one `f32` does not keep enough digits for the high frequencies.
#[derive(CubeType)]
pub(crate) struct Angle {
    pub(crate) coarse: f32,
    pub(crate) fine: f32,
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
    let (coarse, fine) = (angle.coarse * scale, angle.fine * scale);
    let (coarse_turns, fine_turns) = (f32::round(coarse), f32::round(fine));
    let rest = (coarse - coarse_turns) + (fine - fine_turns);
    let rest_turns = f32::round(rest);
    let turns = coarse_turns + fine_turns + rest_turns;
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
pub(super) fn frequency(
    points: &Tensor<f32>,
    angles: &Tensor<f32>,
    window: &Tensor<f32>,
    out: &mut Tensor<f32>,
    frequencies: usize,
) {
    let dims = points.shape(1);
    if ABSOLUTE_POS >= points.shape(0) * dims {
        terminate!();
    }
    let (row, axis) = (ABSOLUTE_POS / dims, ABSOLUTE_POS % dims);
    let start = row * out.shape(1);
    let x = points[ABSOLUTE_POS];
    out[start + axis] = x;
    let angle = Angle { coarse: angles[2 * ABSOLUTE_POS], fine: angles[2 * ABSOLUTE_POS + 1] };
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let wave = wave(&angle, scale);
        let place = start + dims * (1 + 2 * frequency) + axis;
        out[place] = window[frequency] * wave.sine;
        out[place + dims] = window[frequency] * wave.cosine;
        scale *= 2.0f32;
    }
}

/// The same without the point, faded by its variance.
#[cube(launch)]
pub(super) fn integrated(
    angles: &Tensor<f32>,
    variances: &Tensor<f32>,
    window: &Tensor<f32>,
    out: &mut Tensor<f32>,
    frequencies: usize,
) {
    if ABSOLUTE_POS >= variances.shape(0) * 3 {
        terminate!();
    }
    let (row, axis) = (ABSOLUTE_POS / 3, ABSOLUTE_POS % 3);
    let start = row * out.shape(1);
    let angle = Angle { coarse: angles[2 * ABSOLUTE_POS], fine: angles[2 * ABSOLUTE_POS + 1] };
    let mut fading = -0.5f32 * variances[ABSOLUTE_POS];
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let wave = wave(&angle, scale);
        let weight = window[frequency] * f32::exp(fading);
        let place = start + 6 * frequency + axis;
        out[place] = weight * wave.sine;
        out[place + 3] = weight * wave.cosine;
        fading *= 4.0f32;
        scale *= 2.0f32;
    }
}
