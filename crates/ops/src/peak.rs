//! Peak rates of this machine's processors, for comparison with kernels.

use std::hint::black_box;
use std::time::Instant;

use crate::bf16::{self, Factor};
use crate::matmul::{Matrix, Onto, product};
use crate::mlp::Precision;

/// Rates of all threads together, the best of five trials.
#[derive(Clone, Copy, Debug)]
pub struct Peak {
    /// Floating-point operations per second, in products of matrices that stay in cache.
    pub flops: f64,
    /// Precision of the products.
    pub precision: Precision,
    /// Bytes read and written per second, in copies of arrays that do not.
    pub bytes: f64,
}

impl Peak {
    /// Measures both rates, in about half a second.
    pub fn measured(precision: Precision) -> Self {
        const TRIALS: usize = 5;
        let best = |rate: fn() -> f64| {
            let trial = |_| rayon::broadcast(|_| rate()).into_iter().sum();
            (0..TRIALS).map(trial).fold(0.0, f64::max)
        };
        let products = match precision {
            Precision::F32 => products,
            Precision::Bf16 => rounded_products,
        };
        Self { flops: best(products), precision, bytes: best(copies) }
    }
}

/// Measures how much of `size` one thread does per second, in `repeats` calls of `work`, which does it once.
fn rate(size: usize, repeats: usize, mut work: impl FnMut()) -> f64 {
    let start = Instant::now();
    (0..repeats).for_each(|_| work());
    (size * repeats) as f64 / start.elapsed().as_secs_f64()
}

/// Measures operations per second of one thread in products of 240 × 64 by 64 × 32.
fn products() -> f64 {
    const SIZES: [usize; 3] = [240, 32, 64];
    let ([m, n, k], at) = (SIZES, Matrix::rows);
    let (a, b, mut y) = (vec![0.5; m * k], vec![0.5; k * n], vec![0.0; m * n]);
    rate(2 * m * n * k, 4000, || {
        product(SIZES, Onto::Nothing, (&mut y, at(0, n)), (&a, at(0, k)), (black_box(&b), at(0, n)));
    })
}

/// Measures operations per second of one thread in products of 32 × 512 by 512 × 32 in bfloat16.
fn rounded_products() -> f64 {
    const SIZES: [usize; 3] = [32, 32, 512];
    let ([m, n, k], mut y) = (SIZES, [0.0; 32 * 32]);
    let (a, b) = (Factor::of(&vec![0.5; m * k], k, true, false), Factor::of(&vec![0.5; k * n], n, false, true));
    rate(2 * m * n * k, 20_000, || {
        bf16::product(SIZES, false, (&mut y, n), a.left(0, 0), black_box(&b).right(0, 0));
    })
}

/// Measures bytes per second of one thread in a copy of 64 MiB.
fn copies() -> f64 {
    const VALUES: usize = 1 << 24;
    let (from, mut to) = (vec![1f32; VALUES], vec![2f32; VALUES]);
    rate(8 * VALUES, 1, || {
        to.copy_from_slice(black_box(&from));
        black_box(&to);
    })
}
