//! Sums that make a loss, over all numbers of a tensor and of a few scalars: one launch each way.

use burn::cubecl::{self, prelude::*};
use burn::tensor::{self, Shape};
use burn_cubecl::tensor::CubeTensor;

use super::outputs::Outputs;
use super::{CubeKernel, Pass, apply, arg, empty, empty_like};

/// Threads that share a sum: all numbers of a batch of rays are few.
const THREADS: usize = 256;

/// What is summed up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Summand {
    /// (a − b)².
    SquaredDifference,
    /// a where b is above the first of three numbers.
    Above,
    /// a times the number whose index is b.
    OfClass,
}

/// `scale` times the sum of what `a` and `b`, of the same shape, make up, `[1]`; differentiable in `a`.
pub(crate) fn sum<const D: usize>(
    [a, b]: [tensor::Tensor<D>; 2],
    summand: Summand,
    numbers: [f32; 3],
    scale: f32,
) -> tensor::Tensor<1> {
    apply(Sum { summand, numbers, scale }, (a, b.detach()))
}

#[derive(Debug)]
struct Sum {
    summand: Summand,
    numbers: [f32; 3],
    scale: f32,
}

impl CubeKernel for Sum {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let out = empty(&inputs[0], [1]);
        let [first, second, third] = self.numbers;
        add_up::launch(
            &out.client,
            CubeCount::new_single(),
            CubeDim::new_1d(THREADS as u32),
            arg(&inputs[0]),
            arg(&inputs[1]),
            arg(&out),
            first,
            second,
            third,
            self.scale,
            self.summand,
            THREADS,
        );
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let [a, b] = pass.inputs else { unreachable!("a sum is of two inputs") };
        let da = empty_like(a);
        let [first, second, third] = self.numbers;
        launch!(
            slopes::launch, a.meta.num_elements();
            a, b, pass.grad, &da;
            first, second, third, self.scale, self.summand
        );
        vec![Some(da), None]
    }
}

/// As many as an operation has inputs.
pub(crate) const MOST_SCALARS: usize = 4;

/// [`weighted_sum`](crate::means::weighted_sum) of two to [`MOST_SCALARS`].
pub(crate) fn weighted_sum(terms: Vec<(tensor::Tensor<1>, f32)>) -> tensor::Tensor<1> {
    let (scalars, mut weights): (Vec<_>, Vec<f32>) = terms.into_iter().unzip();
    weights.resize(MOST_SCALARS, 0.0);
    let kernel = WeightedSum(std::array::from_fn(|index| weights[index]));
    match <[_; 2]>::try_from(scalars) {
        Ok([a, b]) => apply(kernel, (a, b)),
        Err(scalars) => match <[_; 3]>::try_from(scalars) {
            Ok([a, b, c]) => apply(kernel, (a, b, c)),
            Err(scalars) => match <[_; 4]>::try_from(scalars) {
                Ok([a, b, c, d]) => apply(kernel, (a, b, c, d)),
                Err(_) => unreachable!("two to four scalars are summed"),
            },
        },
    }
}

#[derive(Debug)]
struct WeightedSum([f32; MOST_SCALARS]);

impl CubeKernel for WeightedSum {
    fn forward(&self, inputs: &[CubeTensor]) -> CubeTensor {
        let out = empty(&inputs[0], [1]);
        let of = |index: usize| inputs.get(index).unwrap_or(&inputs[0]);
        let [a, b, c, d] = self.0;
        launch!(weigh::launch, 1; of(0), of(1), of(2), of(3), &out; a, b, c, d, inputs.len());
        out
    }

    fn backward(&self, pass: Pass<'_>) -> Vec<Option<CubeTensor>> {
        let slopes = Outputs::new([0; MOST_SCALARS].map(|_| Shape::new([1])));
        let buffer = slopes.buffer(pass.grad);
        let [a, b, c, d] = self.0;
        launch!(shares::launch, MOST_SCALARS; pass.grad, &buffer; a, b, c, d, slopes.starts()[1]);
        slopes.parts(&buffer).into_iter().take(pass.inputs.len()).map(Some).collect()
    }
}

#[cube(launch)]
fn weigh(
    a: &Tensor<f32>,
    b: &Tensor<f32>,
    c: &Tensor<f32>,
    d: &Tensor<f32>,
    out: &mut Tensor<f32>,
    of_a: f32,
    of_b: f32,
    of_c: f32,
    of_d: f32,
    #[comptime] count: usize,
) {
    if ABSOLUTE_POS > 0 {
        terminate!();
    }
    let mut sum = of_a * a[0] + of_b * b[0];
    if comptime!(count > 2) {
        sum += of_c * c[0];
    }
    if comptime!(count > 3) {
        sum += of_d * d[0];
    }
    out[0] = sum;
}

/// The gradient of each scalar, `apart` numbers from the one before.
#[cube(launch)]
fn shares(grad: &Tensor<f32>, out: &mut Tensor<f32>, a: f32, b: f32, c: f32, d: f32, apart: usize) {
    let place = ABSOLUTE_POS;
    if place >= 4 {
        terminate!();
    }
    out[place * apart] = grad[0] * select(place == 0, a, select(place == 1, b, select(place == 2, c, d)));
}

/// The number of a class: 0, 1 or 2.
#[cube]
fn of_class(class: f32, first: f32, second: f32, third: f32) -> f32 {
    select(class < 0.5f32, first, select(class < 1.5f32, second, third))
}

#[cube(launch)]
fn add_up(
    a: &Tensor<f32>,
    b: &Tensor<f32>,
    out: &mut Tensor<f32>,
    first: f32,
    second: f32,
    third: f32,
    scale: f32,
    #[comptime] summand: Summand,
    #[comptime] threads: usize,
) {
    let unit = UNIT_POS as usize;
    let mut sum = 0.0f32;
    let mut i = UNIT_POS as usize;
    while i < a.len() {
        if comptime!(summand == Summand::SquaredDifference) {
            let difference = a[i] - b[i];
            sum += difference * difference;
        } else if comptime!(summand == Summand::OfClass) {
            sum += a[i] * of_class(b[i], first, second, third);
        } else if b[i] > first {
            sum += a[i];
        }
        i += CUBE_DIM as usize;
    }
    let mut sums = Shared::<[f32]>::new_slice(threads);
    sums[unit] = sum;
    let mut half = CUBE_DIM as usize / 2;
    while half > 0 {
        sync_cube();
        if unit < half {
            let other = sums[unit + half];
            sums[unit] += other;
        }
        half /= 2;
    }
    if unit == 0 {
        out[0] = scale * sums[0];
    }
}

#[cube(launch)]
fn slopes(
    a: &Tensor<f32>,
    b: &Tensor<f32>,
    grad: &Tensor<f32>,
    da: &mut Tensor<f32>,
    first: f32,
    second: f32,
    third: f32,
    scale: f32,
    #[comptime] summand: Summand,
) {
    if ABSOLUTE_POS >= da.len() {
        terminate!();
    }
    let mut slope = 0.0f32;
    if comptime!(summand == Summand::SquaredDifference) {
        slope = 2.0f32 * (a[ABSOLUTE_POS] - b[ABSOLUTE_POS]);
    } else if comptime!(summand == Summand::OfClass) {
        slope = of_class(b[ABSOLUTE_POS], first, second, third);
    } else if b[ABSOLUTE_POS] > first {
        slope = 1.0f32;
    }
    da[ABSOLUTE_POS] = grad[0] * scale * slope;
}
