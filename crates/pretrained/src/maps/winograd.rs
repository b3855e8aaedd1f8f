//! Winograd's convolution F(4×4, 3×3) (Lavin and Gray 2016): 2.25 multiplications per output instead of 9.
//!
//! Each 4×4 tile of the output is `Y = Aᵀ [(G g Gᵀ) ⊙ (Bᵀ d B)] A` of the 6×6 tile d of the input below it and the kernel
//! g. Summed over channels, each of the 36 products is a matrix product of tiles and weights.

use std::array::from_fn;

use nalgebra::{DMatrixView, DMatrixViewMut};
use rayon::prelude::*;

use super::HostMaps;

/// Channels that are transformed side by side.
const LANES: usize = 16;
/// Side of a tile of the input.
const SIDE: usize = 6;
/// Side of a tile of the output.
const OUT: usize = 4;
/// Numbers of transformed tiles, inputs and outputs, that a thread holds at a time.
const HELD: usize = 1 << 20;
/// Fewest tiles that are multiplied with the weights at a time, which are read once for all of them.
const FEWEST: usize = 128;

type Lanes = [f32; LANES];

/// A convolution of 3×3 windows, one pixel apart and padded by one, with the rectifier behind it.
pub(super) struct Winograd {
    /// Inputs and outputs.
    channels: [usize; 2],
    /// `G g Gᵀ`, `[36, inputs, outputs]`.
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Winograd {
    /// Whether so many inputs and outputs are worth it.
    pub(super) fn suits([inputs, outputs]: [usize; 2]) -> bool {
        inputs.is_multiple_of(LANES) && outputs.is_multiple_of(LANES)
    }

    /// From weights `[3, 3, inputs, outputs]`.
    pub(super) fn new(channels @ [inputs, outputs]: [usize; 2], weight: &[f32], bias: Vec<f32>) -> Self {
        let pairs = inputs * outputs;
        let mut turned = vec![0.0; SIDE * SIDE * pairs];
        for pair in 0..pairs {
            let rows: [[f64; SIDE]; 3] =
                from_fn(|y| kernel(from_fn(|x| f64::from(weight[(3 * y + x) * pairs + pair]))));
            for x in 0..SIDE {
                for (y, value) in kernel(from_fn(|y| rows[y][x])).into_iter().enumerate() {
                    turned[(SIDE * y + x) * pairs + pair] = value as f32;
                }
            }
        }
        Self { channels, weight: turned, bias }
    }

    /// max(0, W ∗ x + b): bands of tiles in parallel.
    pub(super) fn forward(&self, x: &HostMaps) -> HostMaps {
        let [inputs, outputs] = self.channels;
        let [count, height, width, _] = x.shape;
        let across = width.div_ceil(OUT);
        let tiles = (HELD / (SIDE * SIDE * (inputs + outputs))).max(FEWEST);
        let rows = OUT * tiles.div_ceil(across).max(1);
        let mut values = vec![0.0; count * height * width * outputs];
        values.par_chunks_mut(height * width * outputs).enumerate().for_each(|(n, picture)| {
            picture.par_chunks_mut(rows * width * outputs).enumerate().for_each_init(
                || (Vec::new(), Vec::new()),
                |(v, m), (band, out)| self.band(x, [n, band * rows], out, v, m),
            );
        });
        HostMaps::new(values, [count, height, width, outputs])
    }

    /// The output of picture `n` from row `top` on, with room for what is between.
    fn band(&self, x: &HostMaps, [n, top]: [usize; 2], out: &mut [f32], v: &mut Vec<f32>, m: &mut Vec<f32>) {
        let [inputs, outputs] = self.channels;
        let width = x.shape[2];
        let height = out.len() / (width * outputs);
        let across = width.div_ceil(OUT);
        let tiles = across * height.div_ceil(OUT);
        v.resize(SIDE * SIDE * tiles * inputs, 0.0);
        m.resize(SIDE * SIDE * tiles * outputs, 0.0);
        for tile in 0..tiles {
            let corner = [top + tile / across * OUT, tile % across * OUT];
            for first in (0..inputs).step_by(LANES) {
                let turned = turn::<SIDE, SIDE>(patch(x, n, corner, first), input);
                for (place, lanes) in turned.as_flattened().iter().enumerate() {
                    v[(place * tiles + tile) * inputs + first..][..LANES].copy_from_slice(lanes);
                }
            }
        }
        let products = m.chunks_exact_mut(tiles * outputs).zip(v.chunks_exact(tiles * inputs));
        for ((m, v), weight) in products.zip(self.weight.chunks_exact(inputs * outputs)) {
            // Row-major matrices are the transposes of nalgebra's: mᵀ = Wᵀ vᵀ.
            let mut m = DMatrixViewMut::from_slice(m, outputs, tiles);
            let (w, v) = (DMatrixView::from_slice(weight, outputs, inputs), DMatrixView::from_slice(v, inputs, tiles));
            m.gemm(1.0, &w, &v, 0.0);
        }
        for tile in 0..tiles {
            let [y, x] = [tile / across * OUT, tile % across * OUT];
            for first in (0..outputs).step_by(LANES) {
                let product = |place: usize| lanes(&m[(place * tiles + tile) * outputs + first..]);
                let turned = turn::<SIDE, OUT>(from_fn(|y| from_fn(|x| product(SIDE * y + x))), output);
                let bias = lanes(&self.bias[first..]);
                for (dy, row) in turned.iter().enumerate().take(height - y) {
                    for (dx, sums) in row.iter().enumerate().take(width - x) {
                        let pixel = &mut out[((y + dy) * width + x + dx) * outputs + first..][..LANES];
                        let sums = sums.iter().zip(bias);
                        pixel.iter_mut().zip(sums).for_each(|(pixel, (sum, bias))| *pixel = (sum + bias).max(0.0));
                    }
                }
            }
        }
    }
}

/// The channels from the `first` on of the 6×6 pixels below the output tile at `corner` (row, column); 0 outside.
fn patch(x: &HostMaps, n: usize, corner: [usize; 2], first: usize) -> [[Lanes; SIDE]; SIDE] {
    let [height, width] = x.size();
    let inside = |at: usize, side: usize| at.checked_sub(1).filter(|at| *at < side);
    from_fn(|dy| {
        from_fn(|dx| match (inside(corner[0] + dy, height), inside(corner[1] + dx, width)) {
            (Some(row), Some(column)) => lanes(&x.pixel(n, row, column)[first..]),
            _ => [0.0; LANES],
        })
    })
}

fn lanes(values: &[f32]) -> Lanes {
    values[..LANES].try_into().expect("as many as there are lanes")
}

/// `T d Tᵀ` of each lane, for `transform(x) = T x`.
#[inline(always)]
fn turn<const I: usize, const O: usize>(
    tile: [[Lanes; I]; I],
    transform: impl Fn([f32; I]) -> [f32; O],
) -> [[Lanes; O]; O] {
    let line = |line: [&Lanes; I]| {
        let mut turned = [[0.0; LANES]; O];
        for lane in 0..LANES {
            let values = transform(from_fn(|at| line[at][lane]));
            turned.iter_mut().zip(values).for_each(|(turned, value)| turned[lane] = value);
        }
        turned
    };
    let rows: [[Lanes; O]; I] = from_fn(|y| line(from_fn(|x| &tile[y][x])));
    let columns: [[Lanes; O]; O] = from_fn(|x| line(from_fn(|y| &rows[y][x])));
    from_fn(|y| from_fn(|x| columns[x][y]))
}

/// G x.
fn kernel([a, b, c]: [f64; 3]) -> [f64; SIDE] {
    let (near, far) = (-(a + c) / 6.0, a / 24.0 + c / 6.0);
    [a / 4.0, near - b / 6.0, near + b / 6.0, far + b / 12.0, far - b / 12.0, c]
}

/// Bᵀ x.
#[inline(always)]
fn input([a, b, c, d, e, f]: [f32; SIDE]) -> [f32; SIDE] {
    let (near, odd) = (e - 4.0 * c, d - 4.0 * b);
    let (far, double) = (e - c, 2.0 * (d - b));
    [4.0 * a - 5.0 * c + e, near + odd, near - odd, far + double, far - double, 4.0 * b - 5.0 * d + f]
}

/// Aᵀ x.
#[inline(always)]
fn output([a, b, c, d, e, f]: [f32; SIDE]) -> [f32; OUT] {
    let (near, odd, far, double) = (b + c, b - c, d + e, d - e);
    [a + near + far, odd + 2.0 * double, near + 4.0 * far, odd + 8.0 * double + f]
}
