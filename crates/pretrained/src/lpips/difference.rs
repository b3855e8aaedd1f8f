use burn::tensor::{Tensor, TensorData};
use infonerf_ops::simd::{self, Job};
use infonerf_ops::to_host;
use rayon::prelude::*;

use crate::maps::Maps;

/// Keeps the length of a vector of zeros from 0.
const EPSILON: f32 = 1e-10;
/// Sums of channels side by side.
const LANES: usize = 16;

/// `mean_hw Σ_c w_c (x̂_hwc − ŷ_hwc)²` for each pair of the first and the second half of the maps.
pub(super) fn difference(maps: &Maps, weights: &[f32]) -> Vec<f64> {
    match maps {
        Maps::Host(maps) => {
            let pictures: Vec<&[f32]> = maps.pictures().collect();
            let (renders, truths) = pictures.split_at(pictures.len() / 2);
            renders.iter().zip(truths).map(|(render, truth)| on_host(render, truth, weights)).collect()
        }
        Maps::Device(maps) => on_device(maps.clone(), weights),
    }
}

/// Sums are taken per group of pixels and then in order, so that the number of threads changes no digit.
fn on_host(render: &[f32], truth: &[f32], weights: &[f32]) -> f64 {
    const GROUP: usize = 4096;
    let channels = weights.len();
    let groups = render.par_chunks(GROUP * channels).zip(truth.par_chunks(GROUP * channels));
    let of_group = |(render, truth)| {
        let mut sum = 0.0;
        simd::run(Group { render, truth, weights, sum: &mut sum });
        sum
    };
    let sums: Vec<f64> = groups.map(of_group).collect();
    sums.iter().sum::<f64>() / (render.len() / channels) as f64
}

/// `Σ_hw Σ_c w_c (x̂_hwc − ŷ_hwc)²` of some pixels.
struct Group<'a> {
    render: &'a [f32],
    truth: &'a [f32],
    weights: &'a [f32],
    sum: &'a mut f64,
}

impl Job for Group<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let channels = self.weights.len();
        for (x, y) in self.render.chunks_exact(channels).zip(self.truth.chunks_exact(channels)) {
            let scale_x = 1.0 / (summed(x, y, x, |x, _, _| x * x).sqrt() + EPSILON);
            let scale_y = 1.0 / (summed(y, x, y, |y, _, _| y * y).sqrt() + EPSILON);
            *self.sum += f64::from(summed(x, y, self.weights, |x, y, w| {
                let difference = x * scale_x - y * scale_y;
                w * difference * difference
            }));
        }
    }
}

/// Σ `of`(a, b, c) of numbers at the same places.
#[inline(always)]
fn summed(a: &[f32], b: &[f32], c: &[f32], of: impl Fn(f32, f32, f32) -> f32) -> f32 {
    // Loops: iterators are not compiled for the instruction set chosen at run time.
    let ((a, a_rest), (b, b_rest), (c, c_rest)) =
        (a.as_chunks::<LANES>(), b.as_chunks::<LANES>(), c.as_chunks::<LANES>());
    let mut lanes = [0.0; LANES];
    for i in 0..a.len().min(b.len()).min(c.len()) {
        for lane in 0..LANES {
            lanes[lane] += of(a[i][lane], b[i][lane], c[i][lane]);
        }
    }
    let mut sum = 0.0;
    for i in 0..a_rest.len() {
        sum += of(a_rest[i], b_rest[i], c_rest[i]);
    }
    for lane in lanes {
        sum += lane;
    }
    sum
}

fn on_device(maps: Tensor<4>, weights: &[f32]) -> Vec<f64> {
    let [count, channels, _, _] = maps.dims();
    let unit = maps.clone() / (maps.square().sum_dim(1).sqrt() + EPSILON);
    let weights = TensorData::new(weights.to_vec(), [1, channels, 1, 1]);
    let weights = Tensor::<4>::from_data(weights, &unit.device());
    let pairs = count / 2;
    let squares = (unit.clone().narrow(0, 0, pairs) - unit.narrow(0, pairs, pairs)).square() * weights;
    let sums = squares.sum_dim(1).flatten::<2>(1, 3).mean_dim(1);
    to_host(sums).into_iter().map(f64::from).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::maps::tests::devices;

    #[test]
    fn both_bodies_have_the_closed_form() {
        // Two pairs of 1×2 maps with 2 channels: (3, 4) against (1, 0), and 0 against (0, 2); then the same pictures.
        let values = vec![3.0, 4.0, 0.0, 0.0, 1.0, 1.0, 2.0, 5.0, 1.0, 0.0, 0.0, 2.0, 1.0, 1.0, 2.0, 5.0];
        for device in devices() {
            let maps = Maps::new(values.clone(), [4, 1, 2, 2], &device);
            let found = difference(&maps, &[0.5, 2.0]);
            let expected = (0.5 * 0.16 + 2.0 * 0.64 + 2.0) / 2.0;
            approx::assert_relative_eq!(found[0], expected, max_relative = 1e-6);
            assert_eq!(found[1], 0.0);
        }
    }
}
