//! What this machine's processors can do at best, to hold what kernels reach against.

use std::time::Instant;

use crate::matmul::{Matrix, Onto, product};

/// Rates of all threads together, the best of some trials.
#[derive(Clone, Copy, Debug)]
pub struct Peak {
    /// Floating-point operations per second, in products of matrices that stay in cache.
    pub flops: f64,
    /// Bytes read and written per second, in copies of arrays that do not.
    pub bytes: f64,
}

impl Peak {
    /// Measures both, in about half a second.
    pub fn measured() -> Self {
        const TRIALS: usize = 5;
        let best = |rate: fn() -> f64| {
            let trial = |_| rayon::broadcast(|_| rate()).into_iter().sum();
            (0..TRIALS).map(trial).fold(0.0, f64::max)
        };
        Self { flops: best(products), bytes: best(copies) }
    }
}

/// Operations per second of one thread in products of 240 × 64 by 64 × 32.
fn products() -> f64 {
    const SIZES: [usize; 3] = [240, 32, 64];
    const REPEATS: usize = 4000;
    let ([m, n, k], at) = (SIZES, Matrix::rows);
    let (a, b, mut y) = (vec![0.5; m * k], vec![0.5; k * n], vec![0.0; m * n]);
    let start = Instant::now();
    for _ in 0..REPEATS {
        product(SIZES, Onto::Nothing, (&mut y, at(0, n)), (&a, at(0, k)), (std::hint::black_box(&b), at(0, n)));
    }
    (2 * m * n * k * REPEATS) as f64 / start.elapsed().as_secs_f64()
}

/// Bytes per second of one thread in a copy of 64 MiB.
fn copies() -> f64 {
    const NUMBERS: usize = 1 << 24;
    let (from, mut to) = (vec![1f32; NUMBERS], vec![2f32; NUMBERS]);
    let start = Instant::now();
    to.copy_from_slice(std::hint::black_box(&from));
    std::hint::black_box(&to);
    (8 * NUMBERS) as f64 / start.elapsed().as_secs_f64()
}
