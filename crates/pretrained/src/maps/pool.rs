use burn::tensor::module::{avg_pool2d, max_pool2d};
use burn::tensor::ops::{AvgPoolOptions, MaxPoolOptions};
use infonerf_ops::to_host;
use rayon::prelude::*;

use super::{HostMaps, Maps, Window};

/// The largest value of each window.
///
/// # Panics
/// If the maps are smaller than the window.
pub(crate) fn max_pool(x: &Maps, window: Window) -> Maps {
    match x {
        Maps::Host(x) => Maps::Host(pooled(x, window, f32::NEG_INFINITY, f32::max, |largest, _| largest)),
        Maps::Device(x) => {
            let options =
                MaxPoolOptions::new(window.kernel).with_stride([window.stride; 2]).with_padding(window.padding);
            Maps::Device(max_pool2d(x.clone(), options))
        }
    }
}

/// The mean of what each window sees; padding does not count.
///
/// # Panics
/// If the maps are smaller than the window.
pub(crate) fn mean_pool(x: &Maps, window: Window) -> Maps {
    match x {
        Maps::Host(x) => Maps::Host(pooled(x, window, 0.0, |sum, value| sum + value, |sum, count| sum / count)),
        Maps::Device(x) => {
            let options = AvgPoolOptions::new(window.kernel)
                .with_stride([window.stride; 2])
                .with_padding(window.padding)
                .with_count_include_pad(false);
            Maps::Device(avg_pool2d(x.clone(), options))
        }
    }
}

/// The mean of each map, a vector per picture.
pub(crate) fn means(x: &Maps) -> Vec<Vec<f32>> {
    match x {
        Maps::Host(x) => {
            let mean = |picture: &[f32]| {
                let mut sums = vec![0.0; x.channels()];
                for pixel in picture.chunks_exact(x.channels()) {
                    sums.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += f64::from(*value));
                }
                let pixels = (x.shape[1] * x.shape[2]) as f64;
                sums.into_iter().map(|sum| (sum / pixels) as f32).collect()
            };
            x.pictures().map(mean).collect()
        }
        Maps::Device(x) => {
            let [n, channels, height, width] = x.dims();
            let means = x.clone().reshape([n, channels, height * width]).mean_dim(2);
            to_host(means).chunks_exact(channels).map(<[f32]>::to_vec).collect()
        }
    }
}

/// `finish(join(… join(join(initial, x₁), x₂) …), n)` of the n values that each window sees, for each channel.
fn pooled(
    x: &HostMaps,
    window: Window,
    initial: f32,
    join: impl Fn(f32, f32) -> f32 + Sync,
    finish: impl Fn(f32, f32) -> f32 + Sync,
) -> HostMaps {
    let size = x.size();
    let [height, width] = window.output(size).expect("maps are as large as the window");
    let shape = [x.shape[0], height, width, x.channels()];
    let mut maps = HostMaps::of(shape);
    maps.values_mut().par_chunks_mut(width * x.channels()).enumerate().for_each(|(line, values)| {
        let (lines, _) = window.seen(0, line % height, size[0]);
        values.fill(initial);
        for (column, pixel) in values.chunks_exact_mut(x.channels()).enumerate() {
            let (columns, _) = window.seen(1, column, size[1]);
            for (y, x_at) in lines.clone().flat_map(|y| columns.clone().map(move |x| (y, x))) {
                let seen = x.pixel(line / height, y, x_at);
                pixel.iter_mut().zip(seen).for_each(|(value, seen)| *value = join(*value, *seen));
            }
            let count = (lines.len() * columns.len()) as f32;
            pixel.iter_mut().for_each(|value| *value = finish(*value, count));
        }
    });
    maps
}
