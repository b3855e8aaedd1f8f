//! Winograd's convolution F(4×4, 3×3) (Lavin and Gray 2016): 2.25 multiplications per output instead of 9.
//!
//! Each 4×4 tile of the output is `Y = Aᵀ [(G g Gᵀ) ⊙ (Bᵀ d B)] A` of the 6×6 tile d of the input below it and the kernel
//! g. Summed over channels, each of the 36 products is a matrix product of tiles and weights.

use std::array::from_fn;
use std::cell::RefCell;

use infonerf_ops::matmul::{Matrix, Onto, product};
use infonerf_ops::simd::{self, Job};
use rayon::prelude::*;

use super::HostMaps;

/// Channels that are transformed side by side.
const LANES: usize = 16;
/// Side of a tile of the input.
const SIDE: usize = 6;
/// Side of a tile of the output.
const OUT: usize = 4;
/// Outputs whose weights are side by side: as many as a product works on at a time.
const STRIP: usize = 32;
/// Numbers of transformed tiles, inputs and outputs, that a thread holds at a time: half of a cache of 2 MiB.
const HELD: usize = 1 << 18;
/// Most tiles beyond these that are multiplied with the weights at a time, which are read once for all of them.
const MOST: usize = 192;

type Lanes = [f32; LANES];

/// A convolution of 3×3 windows, one pixel apart and padded by one, with the rectifier behind it.
pub(super) struct Winograd {
    /// Inputs and outputs.
    channels: [usize; 2],
    /// `G g Gᵀ`, `[36, outputs / STRIP, inputs, STRIP]`, the last strip as wide as what is left: read in one run.
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
                let (input, output) = (pair / outputs, pair % outputs);
                let first = output - output % STRIP;
                let at = first * inputs + input * STRIP.min(outputs - first) + output % STRIP;
                for (y, value) in kernel(from_fn(|y| rows[y][x])).into_iter().enumerate() {
                    turned[(SIDE * y + x) * pairs + at] = value as f32;
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
        let tiles = (HELD / (SIDE * SIDE * (inputs + outputs))).max((inputs * outputs / 256).min(MOST));
        let rows = OUT * tiles.div_ceil(across).max(1);
        let mut maps = HostMaps::of([count, height, width, outputs]);
        maps.values_mut().par_chunks_mut(height * width * outputs).enumerate().for_each(|(n, picture)| {
            picture.par_chunks_mut(rows * width * outputs).enumerate().for_each(|(band, out)| {
                // Kept from layer to layer: fresh pages take long.
                thread_local!(static ROOM: RefCell<[Vec<f32>; 2]> = const { RefCell::new([const { Vec::new() }; 2]) });
                let [mut v, mut m] = ROOM.take();
                self.band(x, [n, band * rows], out, &mut v, &mut m);
                ROOM.set([v, m]);
            });
        });
        maps
    }

    /// The output of picture `n` from row `top` on, with room for what is between.
    fn band(&self, x: &HostMaps, [n, top]: [usize; 2], out: &mut [f32], v: &mut Vec<f32>, m: &mut Vec<f32>) {
        let [inputs, outputs] = self.channels;
        let width = x.shape[2];
        let height = out.len() / (width * outputs);
        let tiles = width.div_ceil(OUT) * height.div_ceil(OUT);
        let [v, m] = [(v, inputs), (m, outputs)].map(|(room, channels)| {
            let count = SIDE * SIDE * tiles * channels;
            room.resize(count.max(room.len()), 0.0);
            &mut room[..count]
        });
        simd::run(Inputs { x, n, top, tiles, v });
        let products = m.chunks_exact_mut(tiles * outputs).zip(v.chunks_exact(tiles * inputs));
        for ((m, v), weight) in products.zip(self.weight.chunks_exact(inputs * outputs)) {
            for (strip, weight) in weight.chunks(inputs * STRIP).enumerate() {
                let (width, m_at) = (weight.len() / inputs, Matrix::rows(strip * STRIP, outputs));
                let [v_at, weight_at] = [inputs, width].map(|row| Matrix::rows(0, row));
                product([tiles, width, inputs], Onto::Nothing, (m, m_at), (v, v_at), (weight, weight_at));
            }
        }
        simd::run(Outputs { m, bias: &self.bias, width, tiles, out });
    }
}

/// `Bᵀ d B` of the tiles below those of a band, `[36, tiles, inputs]`.
struct Inputs<'a> {
    x: &'a HostMaps,
    n: usize,
    top: usize,
    tiles: usize,
    v: &'a mut [f32],
}

impl Job for Inputs<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { x, n, top, tiles, v } = self;
        let ([height, width], inputs) = (x.size(), x.channels());
        let across = width.div_ceil(OUT);
        for tile in 0..tiles {
            let (row, column) = (top + tile / across * OUT, tile % across * OUT);
            for first in (0..inputs).step_by(LANES) {
                let mut patch = [[[0.0; LANES]; SIDE]; SIDE];
                for (dy, patch) in patch.iter_mut().enumerate() {
                    for (dx, patch) in patch.iter_mut().enumerate() {
                        // Padded by one pixel.
                        let (row, column) = ((row + dy).wrapping_sub(1), (column + dx).wrapping_sub(1));
                        if row < height && column < width {
                            patch.copy_from_slice(&x.pixel(n, row, column)[first..first + LANES]);
                        }
                    }
                }
                let turned = turn::<SIDE, SIDE>(&patch, input);
                for (place, lanes) in turned.as_flattened().iter().enumerate() {
                    v[(place * tiles + tile) * inputs + first..][..LANES].copy_from_slice(lanes);
                }
            }
        }
    }
}

/// `max(0, Aᵀ m A + b)` of the products m, `[36, tiles, outputs]`.
struct Outputs<'a> {
    m: &'a [f32],
    bias: &'a [f32],
    width: usize,
    tiles: usize,
    /// Rows of pixels of a band.
    out: &'a mut [f32],
}

impl Job for Outputs<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { m, bias, width, tiles, out } = self;
        let outputs = bias.len();
        let (across, height) = (width.div_ceil(OUT), out.len() / (width * outputs));
        for tile in 0..tiles {
            let [y, x] = [tile / across * OUT, tile % across * OUT];
            for first in (0..outputs).step_by(LANES) {
                let mut products = [[[0.0; LANES]; SIDE]; SIDE];
                for (place, lanes) in products.as_flattened_mut().iter_mut().enumerate() {
                    lanes.copy_from_slice(&m[(place * tiles + tile) * outputs + first..][..LANES]);
                }
                let turned = turn::<SIDE, OUT>(&products, output);
                let bias = &bias[first..first + LANES];
                for (dy, row) in turned.iter().enumerate().take(height - y) {
                    for (dx, sums) in row.iter().enumerate().take(width - x) {
                        let pixel = &mut out[((y + dy) * width + x + dx) * outputs + first..][..LANES];
                        for lane in 0..LANES {
                            pixel[lane] = (sums[lane] + bias[lane]).max(0.0);
                        }
                    }
                }
            }
        }
    }
}

/// `T d Tᵀ` of each lane, for `transform(x) = T x`.
#[inline(always)]
fn turn<const I: usize, const O: usize>(
    tile: &[[Lanes; I]; I],
    transform: impl Fn([f32; I]) -> [f32; O],
) -> [[Lanes; O]; O] {
    // Loops: iterators are not compiled for the instruction set chosen at run time.
    let mut rows = [[[0.0; LANES]; O]; I];
    for y in 0..I {
        for lane in 0..LANES {
            let mut line = [0.0; I];
            for x in 0..I {
                line[x] = tile[y][x][lane];
            }
            let line = transform(line);
            for x in 0..O {
                rows[y][x][lane] = line[x];
            }
        }
    }
    let mut turned = [[[0.0; LANES]; O]; O];
    for x in 0..O {
        for lane in 0..LANES {
            let mut line = [0.0; I];
            for y in 0..I {
                line[y] = rows[y][x][lane];
            }
            let line = transform(line);
            for y in 0..O {
                turned[y][x][lane] = line[y];
            }
        }
    }
    turned
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
