//! Bilinear reading of feature maps at many places.

use std::sync::Arc;

use burn::tensor::Tensor;

use crate::dispatch::dispatch;
use crate::upload;

/// Where maps are read: four rows of a table with their weights for each place.
#[derive(Clone, Debug)]
pub struct Taps {
    rows: Arc<[[u32; 4]]>,
    weights: Arc<[[f32; 4]]>,
}

impl Taps {
    /// Places `(map, x, y)` in a stack of `height × width` maps, whose texels are the rows of a table, map by map and
    /// row-major in each.
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
        let (rows, weights): (Vec<_>, Vec<_>) = places
            .map(|(map, x, y)| {
                let ((left, right, u), (top, bottom, v)) = (axis(x, width), axis(y, height));
                let row = |y: usize, x: usize| ((map * height + y) * width + x) as u32;
                let rows = [row(top, left), row(top, right), row(bottom, left), row(bottom, right)];
                (rows, [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v])
            })
            .unzip();
        Self { rows: rows.into(), weights: weights.into() }
    }

    /// The places at which each of `maps` maps of `from` = (height, width) texels is read to give it `to` texels, corners
    /// on corners (PyTorch: `align_corners=True`).
    pub fn resize(maps: usize, from: (usize, usize), to: (usize, usize)) -> Self {
        let scale = |from: usize, to: usize| if to > 1 { (from - 1) as f32 / (to - 1) as f32 } else { 0.0 };
        let (down, right) = (scale(from.0, to.0), scale(from.1, to.1));
        let places = (0..maps).flat_map(move |map| {
            (0..to.0).flat_map(move |y| (0..to.1).map(move |x| (map, x as f32 * right, y as f32 * down)))
        });
        Self::new(places, from.0, from.1)
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no places.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }
}

/// `out[n] = Σₖ weights[n][k] · table[rows[n][k]]`: `[P, C]` → `[N, C]`, differentiable in the table.
///
/// # Panics
/// If a tap lies beyond the table.
pub fn bilinear(table: Tensor<2>, taps: &Taps) -> Tensor<2> {
    dispatch! {
        &table.device();
        host => {
            let [rows, channels] = table.dims();
            crate::kernel::apply(host::BilinearKernel { taps: taps.clone(), rows, channels }, table)
        },
        plain => plain(table, taps),
    }
}

/// [`bilinear`] from plain tensor operations, on any backend.
pub fn plain(table: Tensor<2>, taps: &Taps) -> Tensor<2> {
    let device = table.device();
    let count = taps.len();
    let tap = |k: usize| {
        let rows: Vec<i32> = taps.rows.iter().map(|rows| rows[k] as i32).collect();
        let weights: Vec<f32> = taps.weights.iter().map(|weights| weights[k]).collect();
        let rows = upload(rows, [count], &device);
        table.clone().select(0, rows) * upload(weights, [count, 1], &device)
    };
    tap(0) + tap(1) + tap(2) + tap(3)
}

#[cfg(feature = "flex")]
mod host {
    use rayon::prelude::*;

    use super::Taps;
    use crate::kernel::{Kernel, Pass};

    /// Rows that a thread takes at a time.
    const CHUNK: usize = 256;

    #[derive(Debug)]
    pub(super) struct BilinearKernel {
        pub(super) taps: Taps,
        pub(super) rows: usize,
        pub(super) channels: usize,
    }

    /// `sum += weight · row`.
    fn add(sum: &mut [f32], row: &[f32], weight: f32) {
        for (sum, value) in sum.iter_mut().zip(row) {
            *sum += weight * value;
        }
    }

    impl BilinearKernel {
        /// For each row of the table the (place, weight) that read it, in the order of the places: the transpose of the
        /// taps, so that each thread writes rows of its own and sums in one order.
        fn readers(&self) -> (Vec<u32>, Vec<(u32, f32)>) {
            let mut ends = vec![0u32; self.rows + 1];
            for row in self.taps.rows.as_flattened() {
                ends[*row as usize + 1] += 1;
            }
            for row in 0..self.rows {
                ends[row + 1] += ends[row];
            }
            let mut next = ends.clone();
            let mut readers = vec![(0, 0.0); 4 * self.taps.len()];
            for (place, (rows, weights)) in self.taps.rows.iter().zip(self.taps.weights.iter()).enumerate() {
                for (row, weight) in rows.iter().zip(weights) {
                    let slot = &mut next[*row as usize];
                    readers[*slot as usize] = (place as u32, *weight);
                    *slot += 1;
                }
            }
            (ends, readers)
        }
    }

    impl Kernel for BilinearKernel {
        fn shape(&self, _inputs: &[Vec<usize>]) -> Vec<usize> {
            vec![self.taps.len(), self.channels]
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            let &[table] = inputs else { unreachable!("bilinear reading has one input") };
            let channels = self.channels;
            let mut out = vec![0.0; self.taps.len() * channels];
            let taps = self.taps.rows.par_chunks(CHUNK).zip(self.taps.weights.par_chunks(CHUNK));
            out.par_chunks_mut(CHUNK * channels).zip(taps).for_each(|(out, (rows, weights))| {
                for ((out, rows), weights) in out.chunks_exact_mut(channels).zip(rows).zip(weights) {
                    for (row, weight) in rows.iter().zip(weights) {
                        let start = *row as usize * channels;
                        add(out, &table[start..start + channels], *weight);
                    }
                }
            });
            out
        }

        fn backward(&self, pass: Pass<'_>, wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            if !wanted[0] {
                return vec![None];
            }
            let (channels, grad) = (self.channels, pass.grad);
            let (ends, readers) = self.readers();
            let mut table = vec![0.0; self.rows * channels];
            table.par_chunks_mut(CHUNK * channels).enumerate().for_each(|(chunk, part)| {
                for (index, sum) in part.chunks_exact_mut(channels).enumerate() {
                    let row = chunk * CHUNK + index;
                    for (place, weight) in &readers[ends[row] as usize..ends[row + 1] as usize] {
                        let start = *place as usize * channels;
                        add(sum, &grad[start..start + channels], *weight);
                    }
                }
            });
            vec![Some(table)]
        }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::to_host;

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
        let device = Device::flex().autodiff();
        let run = |read: fn(Tensor<2>, &Taps) -> Tensor<2>| {
            let table = table(&device).require_grad();
            let out = read(table.clone(), &places());
            let grads = (out.clone() * out.clone().sin()).sum().backward();
            (to_host(out), to_host(table.grad(&grads).expect("the table was read")))
        };
        let (host, plain) = (run(bilinear), run(plain));
        for (a, b) in host.0.iter().zip(&plain.0).chain(host.1.iter().zip(&plain.1)) {
            assert!((a - b).abs() <= 1e-4 * b.abs().max(1.0), "{a} {b}");
        }
    }
}
