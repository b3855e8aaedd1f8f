use burn::tensor::{Tensor, TensorData};
use infonerf_ops::to_host;
use rayon::prelude::*;

use crate::maps::Maps;

/// Keeps the length of a vector of zeros from 0.
const EPSILON: f32 = 1e-10;

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
    let scale = |pixel: &[f32]| 1.0 / (pixel.iter().map(|value| value * value).sum::<f32>().sqrt() + EPSILON);
    let of_pixel = |(x, y): (&[f32], &[f32])| {
        let (scale_x, scale_y) = (scale(x), scale(y));
        let squares = x.iter().zip(y).zip(weights).map(|((x, y), w)| w * (x * scale_x - y * scale_y).powi(2));
        f64::from(squares.sum::<f32>())
    };
    let groups = render.par_chunks(GROUP * channels).zip(truth.par_chunks(GROUP * channels));
    let sums: Vec<f64> =
        groups.map(|(x, y)| x.chunks_exact(channels).zip(y.chunks_exact(channels)).map(of_pixel).sum()).collect();
    sums.iter().sum::<f64>() / (render.len() / channels) as f64
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
