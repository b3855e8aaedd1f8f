//! Products of matrices rounded to bfloat16, added in single precision, by the fastest instructions of the processor.
//!
//! Every instruction set rounds factors to the nearest bfloat16, ties to even, and adds their exact products in `f32`. They
//! differ in the order of the sum, and those of x86 replace factors and sums below 2⁻¹²⁶ by 0.
//!
//! All of them multiply *pairs*, the 32 bits of two bfloat16: y `[m, n]` is Σⱼ of the two products of a `[m, k/2]` and b
//! `[k/2, n]`. Of 32 elements along k, the first 16 are the low halves and the others the high halves, so that pairs are made
//! from vectors without moving elements within a vector. All sizes are multiples of 32.

mod mlp;
mod stages;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use mlp::RoundedMlpKernel;

use std::sync::OnceLock;

use crate::host::simd::{self, Job};

/// Number that divides all sizes of matrices.
pub(crate) const SIZE_MULTIPLE: usize = 32;
const HALF: usize = SIZE_MULTIPLE / 2;

/// Two bfloat16, the first in the low half.
pub(crate) type Pair = u32;

/// Rounds x to bfloat16, in the upper half of the bits; the lower half has no meaning. NaN stays NaN.
#[inline(always)]
fn rounded(x: f32) -> u32 {
    let bits = x.to_bits();
    if x.is_nan() { bits | 1 << 22 } else { bits + 0x7fff + (bits >> 16 & 1) }
}

#[inline(always)]
fn pair(low: f32, high: f32) -> Pair {
    rounded(low) >> 16 | rounded(high) & 0xffff_0000
}

/// Rounded matrix that is a factor of products. A left factor has pairs along its columns, a right factor along its rows.
///
/// Blocks of 32 × 32 elements are stored in row-major order. Each consists of two *tiles* of 16 rows of 16 pairs: the
/// upper and the lower half in a left factor, columns from 0 and from 16 on in a right factor.
#[derive(Debug, Default)]
pub(crate) struct Factor {
    pub(crate) columns: usize,
    /// Pairs of the left factor; empty if it is not wanted.
    left: Vec<Pair>,
    /// Pairs of the right factor; empty if it is not wanted.
    right: Vec<Pair>,
}

const TILE: usize = HALF * HALF;
/// Pairs of the two tiles that hold 32 × 32 elements.
const BLOCK_PAIRS: usize = 2 * TILE;

impl Factor {
    pub(crate) fn new(rows: usize, columns: usize, left: bool, right: bool) -> Self {
        let pairs = |wanted: bool| vec![0; if wanted { rows * columns / 2 } else { 0 }];
        Self { columns, left: pairs(left), right: pairs(right) }
    }

    pub(crate) fn of(matrix: &[f32], columns: usize, left: bool, right: bool) -> Self {
        let mut factor = Self::new(matrix.len() / columns, columns, left, right);
        for (index, strip) in matrix.chunks_exact(SIZE_MULTIPLE * columns).enumerate() {
            factor.set(SIZE_MULTIPLE * index, strip);
        }
        factor
    }

    /// Rounds `strip` to the 32 rows from `row` on, which is a multiple of 32.
    pub(crate) fn set(&mut self, row: usize, strip: &[f32]) {
        let Self { columns, left, right } = self;
        let pairs = row / 2 * *columns..(row + SIZE_MULTIPLE) / 2 * *columns;
        let [left, right] = [left, right].map(|side| side.get_mut(pairs.clone()).unwrap_or_default());
        simd::run(RoundStrip { strip: &strip[..SIZE_MULTIPLE * *columns], columns: *columns, left, right });
    }

    /// Returns the left factor from element (`row`, `column`) on; both indices are multiples of 32.
    pub(crate) fn left(&self, row: usize, column: usize) -> FactorSide<'_> {
        self.side(&self.left, row, column)
    }

    /// Returns the right factor from element (`row`, `column`) on; both indices are multiples of 32.
    pub(crate) fn right(&self, row: usize, column: usize) -> FactorSide<'_> {
        self.side(&self.right, row, column)
    }

    fn side<'a>(&self, pairs: &'a [Pair], row: usize, column: usize) -> FactorSide<'a> {
        let start = row / 2 * self.columns + column / SIZE_MULTIPLE * BLOCK_PAIRS;
        FactorSide { pairs: &pairs[start..], step: HALF * self.columns }
    }
}

/// Part of a [`Factor`] on one side of a product.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FactorSide<'a> {
    pairs: &'a [Pair],
    /// Number of pairs from 32 rows to the next.
    step: usize,
}

impl FactorSide<'_> {
    fn has(self, rows: usize, columns: usize) -> bool {
        (rows / SIZE_MULTIPLE - 1) * self.step + columns / SIZE_MULTIPLE * BLOCK_PAIRS <= self.pairs.len()
    }
}

struct RoundStrip<'a> {
    strip: &'a [f32],
    columns: usize,
    left: &'a mut [Pair],
    right: &'a mut [Pair],
}

impl Job for RoundStrip<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        let Self { strip, columns, left, right } = self;
        let row = |r: usize, column: usize| &strip[r * columns + column..][..HALF];
        for (block, left) in left.chunks_exact_mut(BLOCK_PAIRS).enumerate() {
            for (r, pairs) in left.chunks_exact_mut(HALF).enumerate() {
                let (low, high) = (row(r, SIZE_MULTIPLE * block), row(r, SIZE_MULTIPLE * block + HALF));
                for i in 0..HALF {
                    pairs[i] = pair(low[i], high[i]);
                }
            }
        }
        for (tile, right) in right.chunks_exact_mut(TILE).enumerate() {
            for (r, pairs) in right.chunks_exact_mut(HALF).enumerate() {
                let (low, high) = (row(r, HALF * tile), row(HALF + r, HALF * tile));
                for i in 0..HALF {
                    pairs[i] = pair(low[i], high[i]);
                }
            }
        }
    }
}

/// Computes y = a b, or y += a b if `add`, of sizes `[m, n, k]`; `y` is a slice and the distance of its rows.
pub(crate) fn product(sizes: [usize; 3], add: bool, y: (&mut [f32], usize), a: FactorSide<'_>, b: FactorSide<'_>) {
    static FASTEST: OnceLock<PairInstructions> = OnceLock::new();
    let fastest = || PairInstructions::ALL.into_iter().find(|instructions| instructions.present());
    let instructions = FASTEST.get_or_init(|| fastest().expect("every processor has the baseline"));
    instructions.run(RoundedProduct { sizes, add, y, a, b });
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum PairInstructions {
    /// Tiles of 16 rows (AMX).
    Tiles,
    /// Vectors of 16 pairs (AVX512_BF16).
    Pairs,
    /// Vectors of `f32`, on every processor.
    Singles,
}

impl PairInstructions {
    const ALL: [Self; 3] = [Self::Tiles, Self::Pairs, Self::Singles];

    fn present(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Tiles => x86::has_tiles(),
            #[cfg(target_arch = "x86_64")]
            Self::Pairs => x86::has_pairs(),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Tiles | Self::Pairs => false,
            Self::Singles => true,
        }
    }

    fn run(self, product: RoundedProduct<'_>) {
        let RoundedProduct { sizes: [m, n, k], y, a, b, .. } = &product;
        let are_multiples = [m, n, k].iter().all(|size| size.is_multiple_of(SIZE_MULTIPLE) && **size > 0);
        assert!(are_multiples, "multiples of {SIZE_MULTIPLE}");
        assert!(y.1 >= *n && (m - 1) * y.1 + n <= y.0.len(), "the product within its slice");
        assert!(a.has(*m, *k) && b.has(*k, *n), "factors within slices");
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Tiles => x86::tiles(product),
            #[cfg(target_arch = "x86_64")]
            Self::Pairs => x86::pairs(product),
            _ => simd::run(product),
        }
    }
}

/// Product whose sizes are multiples of 32, and whose matrices are known to lie within their slices.
struct RoundedProduct<'a> {
    sizes: [usize; 3],
    add: bool,
    y: (&'a mut [f32], usize),
    a: FactorSide<'a>,
    b: FactorSide<'a>,
}

impl Job for RoundedProduct<'_> {
    #[inline(always)]
    fn run<const FMA: bool, const WIDE: bool>(self) {
        // Tile sizes whose sums fit into registers next to a row of b and an element of a.
        match (FMA, WIDE) {
            (_, true) => self.singles::<FMA, 8, 32>(),
            (true, false) => self.singles::<FMA, 4, 16>(),
            (false, false) => self.singles::<FMA, 2, 16>(),
        }
    }
}

impl RoundedProduct<'_> {
    #[allow(clippy::needless_range_loop, reason = "iterators are not compiled for the chosen instruction set")]
    #[inline(always)]
    fn singles<const FMA: bool, const R: usize, const N: usize>(self) {
        let Self { sizes: [m, n, k], add, y: (y, y_row), a, b } = self;
        for (row, column) in (0..m).step_by(R).flat_map(|row| (0..n).step_by(N).map(move |column| (row, column))) {
            let mut sums = [[0f32; N]; R];
            for r in 0..if add { R } else { 0 } {
                sums[r].copy_from_slice(&y[(row + r) * y_row + column..][..N]);
            }
            for j in 0..k / 2 {
                let (block, within) = (j / HALF, j % HALF);
                let (mut low, mut high) = ([0f32; N], [0f32; N]);
                for tile in 0..N / HALF {
                    let pairs = &b.pairs[block * b.step + (column / HALF + tile) * TILE + HALF * within..][..HALF];
                    for c in 0..HALF {
                        (low[HALF * tile + c], high[HALF * tile + c]) = unpacked(pairs[c]);
                    }
                }
                let pairs = &a.pairs
                    [row / SIZE_MULTIPLE * a.step + block * BLOCK_PAIRS + row % SIZE_MULTIPLE * HALF + within..];
                for r in 0..R {
                    let (first, second) = unpacked(pairs[HALF * r]);
                    for c in 0..N {
                        let add = |a: f32, b: f32, sum: f32| if FMA { a.mul_add(b, sum) } else { sum + a * b };
                        sums[r][c] = add(second, high[c], add(first, low[c], sums[r][c]));
                    }
                }
            }
            for r in 0..R {
                y[(row + r) * y_row + column..][..N].copy_from_slice(&sums[r]);
            }
        }
    }
}

#[inline(always)]
fn unpacked(pair: Pair) -> (f32, f32) {
    (f32::from_bits(pair << 16), f32::from_bits(pair & 0xffff_0000))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Values of many magnitudes and both signs.
    fn drawn(count: usize, seed: u32) -> Vec<f32> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        (0..count).map(|_| next() * (4.0 * next()).exp2()).collect()
    }

    /// Unpacks each side of `factor`, row by row.
    fn sides(factor: &Factor, rows: usize) -> [Vec<f32>; 2] {
        let of = |pair: Pair, k: usize| if k % SIZE_MULTIPLE < HALF { unpacked(pair).0 } else { unpacked(pair).1 };
        let columns = factor.columns;
        let all = || (0..rows).flat_map(|r| (0..columns).map(move |c| (r, c)));
        let block = |r: usize, c: usize| r / SIZE_MULTIPLE * HALF * columns + c / SIZE_MULTIPLE * BLOCK_PAIRS;
        let left = |(r, c)| of(factor.left[block(r, c) + r % SIZE_MULTIPLE * HALF + c % HALF], c);
        let right =
            |(r, c)| of(factor.right[block(r, c) + c % SIZE_MULTIPLE / HALF * TILE + r % HALF * HALF + c % HALF], r);
        [all().map(left).collect(), all().map(right).collect()]
    }

    #[test]
    fn values_are_rounded_to_the_nearest_and_ties_to_even() {
        let one = 2f32.powi(-7);
        let cases = [
            (1.0 + 0.49 * one, 1.0),
            (1.0 + 0.51 * one, 1.0 + one),
            (1.0 + 0.5 * one, 1.0),
            (1.0 + 1.5 * one, 1.0 + 2.0 * one),
            (2f32.powi(-130), 2f32.powi(-130)),
            (f32::MAX, f32::INFINITY),
            (f32::NEG_INFINITY, f32::NEG_INFINITY),
        ];
        for (x, want) in cases {
            assert_eq!(unpacked(pair(x, -x)), (want, -want), "{x}");
        }
        assert!(unpacked(pair(f32::from_bits(0x7f80_0001), 0.0)).0.is_nan(), "not infinite");
    }

    /// Compares with `f64` products of the rounded factors, within the error of an `f32` sum of k terms.
    #[test]
    fn products_agree_for_all_instruction_sets() {
        for [m, n, k] in [[32, 32, 32], [32, 96, 64], [64, 32, 320], [96, 160, 128]] {
            // Each matrix has one strip of 32 more in each direction, which must not be read.
            let (wide_a, wide_b, wide_y) = (k + SIZE_MULTIPLE, n + SIZE_MULTIPLE, n + 5);
            let a = Factor::of(&drawn((m + SIZE_MULTIPLE) * wide_a, 1), wide_a, true, true);
            let b = Factor::of(&drawn((k + SIZE_MULTIPLE) * wide_b, 2), wide_b, true, true);
            let [[a_left, a_right], [b_left, b_right]] = [sides(&a, m + SIZE_MULTIPLE), sides(&b, k + SIZE_MULTIPLE)];
            assert!(a_left == a_right && b_left == b_right, "both sides hold the same");
            for instructions in PairInstructions::ALL.into_iter().filter(|instructions| instructions.present()) {
                for add in [false, true] {
                    let mut y = vec![0.5; m * wide_y];
                    let (a, b) = (a.left(SIZE_MULTIPLE, SIZE_MULTIPLE), b.right(SIZE_MULTIPLE, SIZE_MULTIPLE));
                    instructions.run(RoundedProduct { sizes: [m, n, k], add, y: (&mut y, wide_y), a, b });
                    for (r, c) in (0..m).flat_map(|r| (0..wide_y).map(move |c| (r, c))) {
                        let term = |i: usize| {
                            let a = a_left[(SIZE_MULTIPLE + r) * wide_a + SIZE_MULTIPLE + i];
                            f64::from(a) * f64::from(b_left[(SIZE_MULTIPLE + i) * wide_b + SIZE_MULTIPLE + c])
                        };
                        let got = f64::from(y[r * wide_y + c]);
                        let (want, size) = if c < n {
                            let onto = if add { 0.5 } else { 0.0 };
                            ((0..k).map(term).sum::<f64>() + onto, (0..k).map(|i| term(i).abs()).sum::<f64>() + onto)
                        } else {
                            (0.5, 0.0)
                        };
                        let bound = k as f64 * f64::from(f32::EPSILON) / 2.0 * size;
                        assert!((got - want).abs() <= bound, "{instructions:?} {m} {n} {k}: {got} {want} at {r}, {c}");
                    }
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "factors within slices")]
    fn factors_beyond_their_slices_are_refused() {
        let factor = Factor::new(64, 64, true, true);
        product([32, 64, 64], false, (&mut [0.0; 32 * 64], 64), factor.left(32, 0), factor.right(0, 32));
    }
}
