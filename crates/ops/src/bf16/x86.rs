//! Instructions of x86 processors for pairs of bfloat16. All functions are given products that lie within their slices.

use std::arch::x86_64::{
    __m512bh, __m512i, _mm512_dpbf16_ps, _mm512_loadu_ps, _mm512_loadu_si512, _mm512_set1_epi32, _mm512_setzero_ps,
    _mm512_storeu_ps,
};
use std::mem::transmute;
#[cfg(target_os = "linux")]
use std::sync::LazyLock;

use super::{BLOCK_PAIRS, HALF, RoundedProduct, SIZE_MULTIPLE, TILE};

/// Returns whether the processor has AMX tiles with products of bfloat16, and the system lets this process use them.
pub(super) fn has_tiles() -> bool {
    #[cfg(target_os = "linux")]
    {
        use std::arch::x86_64::{__cpuid, __cpuid_count};
        /// Bits of AMX-BF16 and AMX-TILE in EDX of leaf 7.
        const TILES: u32 = 1 << 22 | 1 << 24;
        /// `ARCH_REQ_XCOMP_PERM` of `arch_prctl`, and the feature number of tile registers.
        const REQUEST: [libc::c_long; 2] = [0x1023, 18];
        static GRANTED: LazyLock<bool> = LazyLock::new(|| {
            // SAFETY: the call only requests a permission; a system that does not know the request returns an error.
            #[allow(unsafe_code, reason = "the standard library has no such call")]
            let granted = || unsafe { libc::syscall(libc::SYS_arch_prctl, REQUEST[0], REQUEST[1]) } == 0;
            __cpuid(0).eax >= 7 && __cpuid_count(7, 0).edx & TILES == TILES && granted()
        });
        *GRANTED
    }
    #[cfg(not(target_os = "linux"))]
    false
}

/// Returns whether the processor has products of vectors of pairs.
pub(super) fn has_pairs() -> bool {
    is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512bf16")
}

/// Computes blocks of 32 × 32 elements of y in four tile registers, which this thread configures and releases.
pub(super) fn tiles(product: RoundedProduct<'_>) {
    /// Palette 1: eight tiles of 16 rows of 64 bytes.
    #[repr(C, align(64))]
    struct TileConfig([u8; 16], [u16; 16], [u8; 16]);
    const LAYOUT: TileConfig = {
        let (mut palette, mut bytes, mut rows) = ([0; 16], [0; 16], [0; 16]);
        palette[0] = 1;
        let mut tile = 0;
        while tile < 8 {
            (bytes[tile], rows[tile]) = (64, 16);
            tile += 1;
        }
        TileConfig(palette, bytes, rows)
    };
    let RoundedProduct { sizes: [m, n, k], add, y: (y, y_row), a, b } = product;
    assert!(has_tiles(), "not on this machine");
    // SAFETY: the machine has tiles, and the layout is a valid one. Rows 16 apart and columns of 64 bytes, within sizes that are
    // multiples of 32, are within the slices: that is asserted before. Nothing else uses tiles, and they are released.
    #[allow(unsafe_code, reason = "the standard library has no such instructions yet")]
    unsafe {
        std::arch::asm!("ldtilecfg [{}]", in(reg) &LAYOUT, options(nostack, readonly));
        let b_step = b.step;
        for column in (0..n).step_by(SIZE_MULTIPLE) {
            for row in (0..m).step_by(SIZE_MULTIPLE) {
                let y = y.as_mut_ptr().add(row * y_row + column);
                let (a, b) = (
                    a.pairs.as_ptr().add(row / SIZE_MULTIPLE * a.step),
                    b.pairs.as_ptr().add(column / SIZE_MULTIPLE * BLOCK_PAIRS),
                );
                std::arch::asm!(
                    "tilezero tmm0",
                    "tilezero tmm1",
                    "tilezero tmm2",
                    "tilezero tmm3",
                    "test {add:e}, {add:e}",
                    "jz 2f",
                    "tileloadd tmm0, [{y} + {y_row}*1]",
                    "tileloadd tmm1, [{y} + {y_row}*1 + 64]",
                    "tileloadd tmm2, [{below} + {y_row}*1]",
                    "tileloadd tmm3, [{below} + {y_row}*1 + 64]",
                    "2:",
                    "tileloadd tmm4, [{a} + {line}*1]",
                    "tileloadd tmm6, [{b} + {line}*1]",
                    "tileloadd tmm7, [{b} + {line}*1 + 1024]",
                    "tileloadd tmm5, [{a} + {line}*1 + 1024]",
                    "tdpbf16ps tmm0, tmm4, tmm6",
                    "tdpbf16ps tmm1, tmm4, tmm7",
                    "tdpbf16ps tmm2, tmm5, tmm6",
                    "tdpbf16ps tmm3, tmm5, tmm7",
                    "add {a}, 2048",
                    "add {b}, {b_step}",
                    "dec {k}",
                    "jnz 2b",
                    "tilestored [{y} + {y_row}*1], tmm0",
                    "tilestored [{y} + {y_row}*1 + 64], tmm1",
                    "tilestored [{below} + {y_row}*1], tmm2",
                    "tilestored [{below} + {y_row}*1 + 64], tmm3",
                    add = in(reg) u32::from(add),
                    y = in(reg) y,
                    below = in(reg) y.add(HALF * y_row),
                    y_row = in(reg) 4 * y_row,
                    a = inout(reg) a => _,
                    b = inout(reg) b => _,
                    b_step = in(reg) 4 * b_step,
                    line = in(reg) 64_usize,
                    k = inout(reg) k / SIZE_MULTIPLE => _,
                    out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                    out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                    options(nostack),
                );
            }
        }
        std::arch::asm!("tilerelease", options(nomem, nostack));
    }
}

/// Computes blocks of 8 × 32 elements of y in vector registers.
pub(super) fn pairs(product: RoundedProduct<'_>) {
    const ROWS: usize = 8;
    #[target_feature(enable = "avx512f,avx512bf16")]
    fn multiply(product: RoundedProduct<'_>) {
        let RoundedProduct { sizes: [m, n, k], add, y: (y, y_row), a, b } = product;
        for (row, column) in
            (0..m).step_by(ROWS).flat_map(|row| (0..n).step_by(SIZE_MULTIPLE).map(move |column| (row, column)))
        {
            // SAFETY: rows below m and 32 columns from one below n, both multiples of 32, are within the slices: that is
            // asserted before. The transmuted types are the same bits.
            #[allow(unsafe_code, reason = "loads and stores of vectors")]
            unsafe {
                let y = y.as_mut_ptr().add(row * y_row + column);
                let mut sums = [[_mm512_setzero_ps(); 2]; ROWS];
                for (r, sums) in sums.iter_mut().enumerate().filter(|_| add) {
                    *sums = [0, HALF].map(|half| _mm512_loadu_ps(y.add(r * y_row + half)));
                }
                for j in 0..k / 2 {
                    let (block, within) = (j / HALF, j % HALF);
                    let b = b.pairs.as_ptr().add(block * b.step + column / SIZE_MULTIPLE * BLOCK_PAIRS + HALF * within);
                    let a = a
                        .pairs
                        .as_ptr()
                        .add(row / SIZE_MULTIPLE * a.step + block * BLOCK_PAIRS + row % SIZE_MULTIPLE * HALF + within);
                    let b =
                        [0, TILE].map(|half| transmute::<__m512i, __m512bh>(_mm512_loadu_si512(b.add(half).cast())));
                    for (r, sums) in sums.iter_mut().enumerate() {
                        let a = _mm512_set1_epi32(*a.add(HALF * r) as i32);
                        let a = transmute::<__m512i, __m512bh>(a);
                        *sums = [_mm512_dpbf16_ps(sums[0], a, b[0]), _mm512_dpbf16_ps(sums[1], a, b[1])];
                    }
                }
                for (r, sums) in sums.into_iter().enumerate() {
                    _mm512_storeu_ps(y.add(r * y_row), sums[0]);
                    _mm512_storeu_ps(y.add(r * y_row + HALF), sums[1]);
                }
            }
        }
    }
    assert!(has_pairs(), "not on this processor");
    // SAFETY: the features that `multiply` is compiled for are present.
    #[allow(unsafe_code, reason = "the only way to call code for a detected instruction set")]
    unsafe {
        multiply(product);
    }
}
