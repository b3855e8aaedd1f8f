//! Bilinear reading of feature maps at many places.

#[cfg(feature = "flex")]
mod host;

use std::sync::Arc;

use burn::tensor::Tensor;

use crate::dispatch::dispatch;
use crate::traffic::upload;

/// Places at which maps are read: four rows of a table with their weights for each place.
#[derive(Clone, Debug)]
pub struct Taps(Arc<[([u32; 4], [f32; 4])]>);

impl Taps {
    /// Creates taps at places `(map, x, y)` in a stack of `height × width` maps. Their texels are the rows of a table,
    /// map by map and row-major in each map.
    ///
    /// `(0, 0)` is the centre of a map's first texel, `(width − 1, height − 1)` that of its last. A place beyond them reads
    /// the border (PyTorch: `align_corners=True`, `padding_mode="border"`); NaN reads the first texel.
    ///
    /// # Panics
    /// If a map has no texel.
    pub fn new(places: impl Iterator<Item = (usize, f32, f32)>, height: usize, width: usize) -> Self {
        assert!(height > 0 && width > 0, "a map has at least one texel");
        let axis = |at: f32, size: usize| {
            let at = if at > 0.0 { at.min((size - 1) as f32) } else { 0.0 };
            let below = at as usize;
            (below, (below + 1).min(size - 1), at - below as f32)
        };
        let taps = places.map(|(map, x, y)| {
            let ((left, right, u), (top, bottom, v)) = (axis(x, width), axis(y, height));
            let row = |y: usize, x: usize| ((map * height + y) * width + x) as u32;
            let rows = [row(top, left), row(top, right), row(bottom, left), row(bottom, right)];
            (rows, [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v])
        });
        Self(taps.collect())
    }

    /// Creates the taps that resize each of `maps` maps of `from` = (height, width) texels to `to` texels, with corners
    /// aligned (PyTorch: `align_corners=True`).
    pub fn resize(maps: usize, from: (usize, usize), to: (usize, usize)) -> Self {
        let scale = |from: usize, to: usize| if to > 1 { (from - 1) as f32 / (to - 1) as f32 } else { 0.0 };
        let (down, right) = (scale(from.0, to.0), scale(from.1, to.1));
        let places = (0..maps).flat_map(move |map| {
            (0..to.0).flat_map(move |y| (0..to.1).map(move |x| (map, x as f32 * right, y as f32 * down)))
        });
        Self::new(places, from.0, from.1)
    }
}

/// Computes Σₖ wₖ rₖ of the four weights wₖ and rows rₖ of the table of each of N taps: `[rows, C]` → `[N, C]`. Differentiable in the
/// table.
///
/// # Panics
/// If a tap lies beyond the table.
pub fn bilinear(table: Tensor<2>, taps: &Taps) -> Tensor<2> {
    dispatch! {
        &table.device();
        host => {
            let [rows, channels] = table.dims();
            let kernel = host::BilinearKernel { taps: taps.clone(), rows, channels };
            crate::host::apply(kernel, [taps.0.len(), channels], [table.into_dispatch()])
        },
        plain => plain(table, taps),
    }
}

/// Computes [`bilinear`] by plain tensor operations, on any backend.
pub fn plain(table: Tensor<2>, taps: &Taps) -> Tensor<2> {
    let device = table.device();
    let count = taps.0.len();
    let tap = |k: usize| {
        let rows: Vec<i32> = taps.0.iter().map(|(rows, _)| rows[k] as i32).collect();
        let weights: Vec<f32> = taps.0.iter().map(|(_, weights)| weights[k]).collect();
        let rows = upload(rows, [count], &device);
        table.clone().select(0, rows) * upload(weights, [count, 1], &device)
    };
    tap(0) + tap(1) + tap(2) + tap(3)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::traffic::to_host;

    /// Two maps of 2 × 3 texels with two channels: 10·map + texel, and its square.
    fn table(device: &Device) -> Tensor<2> {
        let texel = |i: usize| (10 * (i / 6) + i % 6) as f32;
        let values = (0..12).flat_map(|i| [texel(i), texel(i).powi(2)]).collect();
        upload(values, [12, 2], device)
    }

    fn places() -> Taps {
        let places = [(0, 0.0, 0.0), (0, 1.25, 0.5), (1, 2.0, 1.0), (1, -3.0, 9.0), (0, f32::NAN, 0.0), (1, 0.5, 0.0)];
        Taps::new(places.into_iter(), 2, 3)
    }

    #[test]
    fn by_hand() {
        let got = to_host(bilinear(table(&Device::flex()), &places()));
        let first: Vec<f32> = got.chunks(2).map(|pair| pair[0]).collect();
        assert_eq!(first, [0.0, 1.25 + 1.5, 15.0, 13.0, 0.0, 10.5]);
        assert_eq!(got[11], 0.5 * (100.0 + 121.0));
    }

    #[test]
    fn resizing_keeps_corners_and_is_linear_between() {
        let taps = Taps::resize(2, (2, 3), (3, 5));
        let got = to_host(bilinear(table(&Device::flex()), &taps));
        let first: Vec<f32> = got.chunks(2).map(|pair| pair[0]).take(15).collect();
        assert_eq!(first, [0.0, 0.5, 1.0, 1.5, 2.0, 1.5, 2.0, 2.5, 3.0, 3.5, 3.0, 3.5, 4.0, 4.5, 5.0]);
        assert_eq!(got[2 * 29], 15.0);
    }

    #[test]
    fn host_and_plain_bodies_agree_with_their_gradients() {
        let run = |read: fn(Tensor<2>, &Taps) -> Tensor<2>, device: Device| {
            let table = table(&device.autodiff()).require_grad();
            let out = read(table.clone(), &places());
            let grads = (out.clone() * out.clone().sin()).sum().backward();
            [to_host(out), to_host(table.grad(&grads).expect("the table was read"))]
        };
        let host = run(bilinear, Device::flex());
        for device in [Device::flex(), Device::ndarray()] {
            for (host, plain) in host.iter().zip(run(plain, device)) {
                approx::assert_relative_eq!(host[..], plain[..], epsilon = 1e-4, max_relative = 1e-4);
            }
        }
    }
}
