//! GPU kernels of the encodings, and sine and cosine that are the same on every device.

use burn::cubecl::{self, prelude::*};
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;

use crate::cube::{Operation, Pass, empty, empty_like, launch, uploaded};

/// Encoding of at least one point, or Gaussian if `integrated`.
#[derive(Debug)]
pub(super) struct GpuEncoding {
    /// Weight of each frequency.
    pub(super) window: Vec<f32>,
    pub(super) integrated: bool,
}

impl Operation<CubeBackend> for GpuEncoding {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let (points, variances) = (&inputs[0], inputs.get(1).unwrap_or(&inputs[0]));
        let [rows, dims] = points.meta.shape().dims();
        let blocks = 2 * self.window.len() + if self.integrated { 0 } else { 1 };
        let out = empty(points, [rows, dims * blocks]);
        let window = uploaded(&self.window, points);
        launch!(waves::launch, rows * dims; points, variances, &window, &out; self.window.len(), self.integrated);
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let (dpoints, frequencies) = (empty_like(&pass.inputs[0]), self.window.len());
        let count = dpoints.meta.num_elements();
        launch!(point_gradient::launch, count; pass.output, pass.grad, &dpoints; frequencies, self.integrated);
        let variances = pass.inputs.get(1).map(|variances| {
            let dvariances = empty_like(variances);
            launch!(variance_gradient::launch, count; pass.output, pass.grad, &dvariances; frequencies);
            Some(dvariances)
        });
        std::iter::once(Some(dpoints)).chain(variances).collect()
    }
}

/// Encodes one coordinate per thread. Rows hold the point, unless `integrated`, then sines and cosines of each frequency.
#[cube(launch)]
fn waves(
    points: &Tensor<f32>,
    variances: &Tensor<f32>,
    window: &Tensor<f32>,
    out: &mut Tensor<f32>,
    frequencies: usize,
    #[comptime] integrated: bool,
) {
    let dims = points.shape(1);
    if ABSOLUTE_POS >= points.shape(0) * dims {
        terminate!();
    }
    let start = ABSOLUTE_POS / dims * out.shape(1) + ABSOLUTE_POS % dims;
    let first = start + dims * comptime!(if integrated { 0usize } else { 1usize });
    let x = points[ABSOLUTE_POS];
    let mut exponent = 0.0f32;
    if comptime!(integrated) {
        exponent = -0.5f32 * variances[ABSOLUTE_POS];
    } else {
        out[start] = x;
    }
    let angle = angle(x);
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let wave = wave(&angle, scale);
        let weight = window[frequency] * f32::exp(exponent);
        let place = first + 2 * dims * frequency;
        out[place] = weight * wave.sine;
        out[place + dims] = weight * wave.cosine;
        exponent *= 4.0f32;
        scale *= 2.0f32;
    }
}

/// Computes the gradient with respect to the points from the encoding: ∂/∂x sin 2ˡx = 2ˡ cos 2ˡx.
#[cube(launch)]
fn point_gradient(
    out: &Tensor<f32>,
    grad: &Tensor<f32>,
    dpoints: &mut Tensor<f32>,
    frequencies: usize,
    #[comptime] integrated: bool,
) {
    let dims = dpoints.shape(1);
    if ABSOLUTE_POS >= dpoints.shape(0) * dims {
        terminate!();
    }
    let start = ABSOLUTE_POS / dims * out.shape(1) + ABSOLUTE_POS % dims;
    let first = start + dims * comptime!(if integrated { 0usize } else { 1usize });
    let mut sum = 0.0f32;
    if comptime!(!integrated) {
        sum = grad[start];
    }
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let sine = first + 2 * dims * frequency;
        let cosine = sine + dims;
        sum += scale * (grad[sine] * out[cosine] - grad[cosine] * out[sine]);
        scale *= 2.0f32;
    }
    dpoints[ABSOLUTE_POS] = sum;
}

/// Computes the gradient with respect to the variances from the integrated encoding.
#[cube(launch)]
fn variance_gradient(out: &Tensor<f32>, grad: &Tensor<f32>, dvariances: &mut Tensor<f32>, frequencies: usize) {
    let dims = dvariances.shape(1);
    if ABSOLUTE_POS >= dvariances.shape(0) * dims {
        terminate!();
    }
    let start = ABSOLUTE_POS / dims * out.shape(1) + ABSOLUTE_POS % dims;
    let mut sum = 0.0f32;
    let mut scale = 1.0f32;
    for frequency in 0..frequencies {
        let sine = start + 2 * dims * frequency;
        let cosine = sine + dims;
        sum -= 0.5f32 * scale * scale * (grad[sine] * out[sine] + grad[cosine] * out[cosine]);
        scale *= 2.0f32;
    }
    dvariances[ABSOLUTE_POS] = sum;
}

/// Angle in quarter turns, as a sum: a single `f32` does not keep enough digits for high frequencies.
#[derive(CubeType)]
pub(crate) struct Angle {
    pub(crate) first: f32,
    pub(crate) second: f32,
    pub(crate) third: f32,
    pub(crate) rest: f32,
}

/// Converts `x` radians to quarter turns, 2x/π, accurate to 45 bits and without whole turns.
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
        first: without_whole_turns(high * c1),
        second: without_whole_turns(high * c2),
        third: without_whole_turns(low * c1),
        rest: without_whole_turns((high * c3 + low * c2) + (high * c4 + low * c3)),
    }
}

#[cube]
fn without_whole_turns(quarters: f32) -> f32 {
    quarters - 4.0f32 * f32::round(quarters / 4.0f32)
}

/// Sine and cosine, accurate to 2e-7 on every device.
#[derive(CubeType)]
pub(crate) struct Wave {
    pub(crate) sine: f32,
    pub(crate) cosine: f32,
}

/// Computes sine and cosine of `angle` times `scale`, a power of two.
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
