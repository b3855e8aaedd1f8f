//! The two inner loops of a dense layer with AVX2 and FMA: compilers do not keep their sums in registers by themselves.

#![allow(clippy::needless_range_loop, reason = "plain loops over arrays are what becomes registers")]
#![allow(unsafe_code, reason = "vector loads and stores take pointers; every access is checked against a slice first")]

use std::arch::x86_64::{_mm256_fmadd_ps, _mm256_loadu_ps, _mm256_set1_ps, _mm256_setzero_ps, _mm256_storeu_ps};

use super::dense::{BLOCK, LANES, TILE};

/// sums[k] += Σᵢ w[k·stride + i] · x[i·BLOCK ..][..TILE]
#[target_feature(enable = "avx2,fma")]
#[inline]
pub(super) fn accumulate<const O: usize>(
    w: &[f32],
    stride: usize,
    x: &[f32],
    inputs: usize,
    sums: &mut [[f32; TILE]; O],
) {
    if inputs == 0 {
        return;
    }
    assert!(w.len() >= (O - 1) * stride + inputs && x.len() >= (inputs - 1) * BLOCK + TILE);
    // SAFETY: the largest offsets read are (O − 1)·stride + inputs − 1 of `w` and (inputs − 1)·BLOCK + TILE − 1 of `x`,
    // both inside by the assertion; each row of `sums` holds three vectors.
    unsafe {
        let mut a = [[_mm256_setzero_ps(); 3]; O];
        for k in 0..O {
            for v in 0..3 {
                a[k][v] = _mm256_loadu_ps(sums[k].as_ptr().add(v * LANES));
            }
        }
        for i in 0..inputs {
            let x = x.as_ptr().add(i * BLOCK);
            let (x0, x1, x2) = (_mm256_loadu_ps(x), _mm256_loadu_ps(x.add(LANES)), _mm256_loadu_ps(x.add(2 * LANES)));
            for k in 0..O {
                let w = _mm256_set1_ps(*w.as_ptr().add(k * stride + i));
                a[k][0] = _mm256_fmadd_ps(w, x0, a[k][0]);
                a[k][1] = _mm256_fmadd_ps(w, x1, a[k][1]);
                a[k][2] = _mm256_fmadd_ps(w, x2, a[k][2]);
            }
        }
        for k in 0..O {
            for v in 0..3 {
                _mm256_storeu_ps(sums[k].as_mut_ptr().add(v * LANES), a[k][v]);
            }
        }
    }
}

/// sums[k][j][l] = Σ over s ≡ l (mod 8), s < `used`, of dy[k·BLOCK + s] · x[j·BLOCK + s]
#[target_feature(enable = "avx2,fma")]
#[inline]
pub(super) fn products<const O: usize, const I: usize>(
    dy: &[f32],
    x: &[f32],
    used: usize,
    sums: &mut [[[f32; LANES]; I]; O],
) {
    assert!(used.is_multiple_of(LANES) && used <= BLOCK && dy.len() >= O * BLOCK && x.len() >= I * BLOCK);
    // SAFETY: rows of `dy` and `x` hold BLOCK numbers each, of which `used` are read, in whole vectors.
    unsafe {
        let mut a = [[_mm256_setzero_ps(); I]; O];
        for at in (0..used).step_by(LANES) {
            let mut xs = [_mm256_setzero_ps(); I];
            for j in 0..I {
                xs[j] = _mm256_loadu_ps(x.as_ptr().add(j * BLOCK + at));
            }
            for k in 0..O {
                let d = _mm256_loadu_ps(dy.as_ptr().add(k * BLOCK + at));
                for j in 0..I {
                    a[k][j] = _mm256_fmadd_ps(d, xs[j], a[k][j]);
                }
            }
        }
        for k in 0..O {
            for j in 0..I {
                _mm256_storeu_ps(sums[k][j].as_mut_ptr(), a[k][j]);
            }
        }
    }
}
