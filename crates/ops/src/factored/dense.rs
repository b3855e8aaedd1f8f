//! Dense layers over a block of samples that stays in cache.
//!
//! Everything is feature-major: row `f` of a block holds feature `f` of its [`BLOCK`] samples, so that the samples fill
//! the vectors and every weight is read once for many of them.

use crate::simd::fma;

/// Samples in a block; a multiple of [`TILE`].
pub(super) const BLOCK: usize = 240;
/// Samples that one inner loop works on: three vectors of eight.
pub(super) const TILE: usize = 24;

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
    let w = &w[o * stride..(o + O - 1) * stride + inputs];
    let y = &mut y[o * BLOCK + at..(o + O - 1) * BLOCK + at + TILE];
    let x = &x[at..];
    let mut sums = [[0f32; TILE]; O];
    if let Some(bias) = bias {
        for (sum, &b) in sums.iter_mut().zip(&bias[o..o + O]) {
            *sum = [b; TILE];
        }
    }
    #[cfg(target_arch = "x86_64")]
    if FMA {
        // SAFETY: `FMA` is set only where AVX2 and FMA were detected.
        #[allow(unsafe_code, reason = "intrinsics")]
        unsafe {
            super::avx2::accumulate::<O>(w, stride, x, inputs, &mut sums);
        }
        store(&sums, y, relu);
        return;
    }
    for i in 0..inputs {
        let x = &x[i * BLOCK..i * BLOCK + TILE];
        for (k, sums) in sums.iter_mut().enumerate() {
            let w = w[k * stride + i];
            for (sum, x) in sums.iter_mut().zip(x) {
                *sum = fma::<FMA>(w, *x, *sum);
            }
        }
    }
    store(&sums, y, relu);
}

#[inline(always)]
fn store<const O: usize>(sums: &[[f32; TILE]; O], y: &mut [f32], relu: bool) {
    for (k, sums) in sums.iter().enumerate() {
        let y = &mut y[k * BLOCK..k * BLOCK + TILE];
        for (y, sum) in y.iter_mut().zip(sums) {
            // As written, what is not a number stays so.
            *y = if relu && *sum < 0.0 { 0.0 } else { *sum };
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
pub(super) const LANES: usize = 8;

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
    let (dy, x) = (&dy[o * BLOCK..(o + O) * BLOCK], &x[i * BLOCK..(i + I) * BLOCK]);
    let mut sums = [[[0f32; LANES]; I]; O];
    let used = padded(samples);
    #[cfg(target_arch = "x86_64")]
    if FMA {
        // SAFETY: `FMA` is set only where AVX2 and FMA were detected.
        #[allow(unsafe_code, reason = "intrinsics")]
        unsafe {
            super::avx2::products::<O, I>(dy, x, used, &mut sums);
        }
        return add(&sums, dw, inputs, o, i);
    }
    for at in (0..used).step_by(LANES) {
        for (k, sums) in sums.iter_mut().enumerate() {
            let dy = &dy[k * BLOCK + at..k * BLOCK + at + LANES];
            for (j, sums) in sums.iter_mut().enumerate() {
                let x = &x[j * BLOCK + at..j * BLOCK + at + LANES];
                for ((sum, dy), x) in sums.iter_mut().zip(dy).zip(x) {
                    *sum = fma::<FMA>(*dy, *x, *sum);
                }
            }
        }
    }
    add(&sums, dw, inputs, o, i);
}

#[inline(always)]
fn add<const O: usize, const I: usize>(
    sums: &[[[f32; LANES]; I]; O],
    dw: &mut [f32],
    inputs: usize,
    o: usize,
    i: usize,
) {
    for (k, sums) in sums.iter().enumerate() {
        for (j, sums) in sums.iter().enumerate() {
            dw[(o + k) * inputs + i + j] += sums.iter().sum::<f32>();
        }
    }
}

/// dy ← dy where the ReLU's output y is positive, else 0.
#[inline(always)]
pub(super) fn relu_gradient(y: &[f32], dy: &mut [f32]) {
    for (dy, y) in dy.iter_mut().zip(y) {
        *dy = if *y <= 0.0 { 0.0 } else { *dy };
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
