//! Dense layers over a block of samples that stays in cache.
//!
//! Everything is feature-major: row `f` of a block holds feature `f` of its [`BLOCK`] samples, so that the samples fill
//! the vectors and every weight is read once for many of them.

use crate::simd::fma;

/// Samples in a block; a multiple of [`TILE`].
pub(super) const BLOCK: usize = 240;
/// Samples that one inner loop works on: three vectors of eight.
const TILE: usize = 24;

/// Rounds a number of samples up to whole tiles.
pub(super) fn padded(samples: usize) -> usize {
    samples.div_ceil(TILE) * TILE
}

/// y[o] = relu?(bias[o] + Σᵢ w[o, i] x[i]) for the first `samples` samples, rounded up to a tile.
///
/// `stride` is the distance between rows of `w`.
#[inline(always)]
pub(super) fn forward<const FMA: bool>(
    w: &[f32],
    stride: usize,
    bias: Option<&[f32]>,
    x: &[f32],
    y: &mut [f32],
    samples: usize,
    relu: bool,
) {
    let (inputs, outputs) = (x.len() / BLOCK, y.len() / BLOCK);
    for at in (0..padded(samples)).step_by(TILE) {
        let mut o = 0;
        while o + 4 <= outputs {
            tile::<FMA, 4>(w, stride, bias, x, y, inputs, o, at, relu);
            o += 4;
        }
        while o < outputs {
            tile::<FMA, 1>(w, stride, bias, x, y, inputs, o, at, relu);
            o += 1;
        }
    }
}

#[inline(always)]
#[allow(clippy::too_many_arguments, reason = "an inner loop")]
fn tile<const FMA: bool, const O: usize>(
    w: &[f32],
    stride: usize,
    bias: Option<&[f32]>,
    x: &[f32],
    y: &mut [f32],
    inputs: usize,
    o: usize,
    at: usize,
    relu: bool,
) {
    let mut sums = [[0f32; TILE]; O];
    if let Some(bias) = bias {
        for (sum, &b) in sums.iter_mut().zip(&bias[o..o + O]) {
            *sum = [b; TILE];
        }
    }
    let rows: [&[f32]; O] = std::array::from_fn(|k| &w[(o + k) * stride..(o + k) * stride + inputs]);
    for (i, x) in x.chunks_exact(BLOCK).enumerate() {
        let x: &[f32; TILE] = x[at..at + TILE].first_chunk().expect("a whole tile");
        for k in 0..O {
            let w = rows[k][i];
            for l in 0..TILE {
                sums[k][l] = fma::<FMA>(w, x[l], sums[k][l]);
            }
        }
    }
    for k in 0..O {
        let y = &mut y[(o + k) * BLOCK + at..(o + k) * BLOCK + at + TILE];
        for l in 0..TILE {
            y[l] = if relu { sums[k][l].max(0.0) } else { sums[k][l] };
        }
    }
}

/// dw[o, i] += Σₛ dy[o, s] x[i, s] and db[o] += Σₛ dy[o, s], over whole tiles: rows of `dy` are 0 beyond the samples.
#[inline(always)]
pub(super) fn weight_gradient<const FMA: bool>(dy: &[f32], x: &[f32], dw: &mut [f32], db: &mut [f32], samples: usize) {
    let (inputs, outputs) = (x.len() / BLOCK, dy.len() / BLOCK);
    let mut o = 0;
    while o < outputs {
        let step = if o + 4 <= outputs { 4 } else { 1 };
        let mut i = 0;
        while i < inputs {
            let width = if i + 3 <= inputs { 3 } else { 1 };
            match (step, width) {
                (4, 3) => products::<FMA, 4, 3>(dy, x, dw, inputs, o, i, samples),
                (4, _) => products::<FMA, 4, 1>(dy, x, dw, inputs, o, i, samples),
                (_, 3) => products::<FMA, 1, 3>(dy, x, dw, inputs, o, i, samples),
                _ => products::<FMA, 1, 1>(dy, x, dw, inputs, o, i, samples),
            }
            i += width;
        }
        o += step;
    }
    for (db, dy) in db.iter_mut().zip(dy.chunks_exact(BLOCK)) {
        *db += dy[..samples].iter().sum::<f32>();
    }
}

/// Lanes of the sums over samples.
const LANES: usize = 8;

#[inline(always)]
fn products<const FMA: bool, const O: usize, const I: usize>(
    dy: &[f32],
    x: &[f32],
    dw: &mut [f32],
    inputs: usize,
    o: usize,
    i: usize,
    samples: usize,
) {
    let mut sums = [[[0f32; LANES]; I]; O];
    let dys: [&[f32]; O] = std::array::from_fn(|k| &dy[(o + k) * BLOCK..(o + k + 1) * BLOCK]);
    let xs: [&[f32]; I] = std::array::from_fn(|k| &x[(i + k) * BLOCK..(i + k + 1) * BLOCK]);
    for at in (0..padded(samples)).step_by(LANES) {
        let x: [&[f32; LANES]; I] = std::array::from_fn(|k| xs[k][at..at + LANES].first_chunk().expect("whole lanes"));
        for k in 0..O {
            let dy: &[f32; LANES] = dys[k][at..at + LANES].first_chunk().expect("whole lanes");
            for j in 0..I {
                for l in 0..LANES {
                    sums[k][j][l] = fma::<FMA>(dy[l], x[j][l], sums[k][j][l]);
                }
            }
        }
    }
    for k in 0..O {
        for j in 0..I {
            dw[(o + k) * inputs + i + j] += sums[k][j].iter().sum::<f32>();
        }
    }
}

/// dy ← dy where the ReLU's output y is positive, else 0.
#[inline(always)]
pub(super) fn relu_gradient(y: &[f32], dy: &mut [f32]) {
    for (dy, y) in dy.iter_mut().zip(y) {
        *dy = if *y > 0.0 { *dy } else { 0.0 };
    }
}

/// wᵀ of a layer.
pub(super) fn transposed(w: &[f32], inputs: usize, outputs: usize) -> Vec<f32> {
    let mut t = vec![0.0; inputs * outputs];
    for o in 0..outputs {
        for i in 0..inputs {
            t[i * outputs + o] = w[o * inputs + i];
        }
    }
    t
}
