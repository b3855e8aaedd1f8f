//! Functions that stay accurate over the whole range of optical depths: branch-free polynomials, accurate to a few units of the
//! last place, which the compiler vectorises. Library functions would be called once per value.

use std::f64::consts::LOG2_E;

/// ln 2 in two parts: the first has 32 trailing zero bits, so that its product with an exponent is exact.
const LN2_HIGH: f64 = f64::from_bits(0x3fe6_2e42_fee0_0000);
const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;
/// Constant that, added to a value below 2⁵¹, leaves the nearest integer, plus the exponent's bias, in the last bits.
const ROUND: f64 = 6_755_399_441_055_744.0 + 1023.0;
/// Max depth: e^−708 is close to the smallest normal `f64`.
const MAX_DEPTH: f64 = 708.0;

/// Computes a · b + c, fused if that is one instruction.
#[inline(always)]
fn fma<const FMA: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Computes Σ cₖ xᵏ, the highest power's factor first.
#[inline(always)]
fn horner<const FMA: bool, const N: usize>(x: f64, factors: [f64; N]) -> f64 {
    factors.into_iter().fold(0.0, |sum, factor| fma::<FMA>(sum, x, factor))
}

/// Computes `(1 − e^−τ, e^−τ)`: with −τ = k ln 2 + r, expm1(−τ) = 2ᵏ expm1(r) + (2ᵏ − 1), in which nothing cancels.
#[inline(always)]
fn opacity<const FMA: bool>(tau: f32) -> (f64, f64) {
    let tau = f64::from(tau);
    // Not `f64::min`, which would turn NaN into the bound.
    let x = -(if tau > MAX_DEPTH { MAX_DEPTH } else { tau });
    let rounded = fma::<FMA>(x, LOG2_E, ROUND);
    let k = rounded - ROUND;
    let r = fma::<FMA>(-k, LN2_LOW, fma::<FMA>(-k, LN2_HIGH, x));
    let scale = f64::from_bits(rounded.to_bits() << 52);
    // Taylor: the first term left out is 3e-18 of r at |r| = ln 2 / 2.
    const FACTORS: [f64; 13] = {
        let mut factors = [1.0; 13];
        let (mut n, mut factorial) = (1, 1.0);
        while n <= 13 {
            factorial *= n as f64;
            factors[13 - n] = 1.0 / factorial;
            n += 1;
        }
        factors
    };
    let m1 = scale * (horner::<FMA, 13>(r, FACTORS) * r);
    (-(m1 + (scale - 1.0)), m1 + scale)
}

/// Computes ln x of a positive normal number: with x = 2ᵉ m and m about 1, e ln 2 + 2 artanh((m − 1)/(m + 1)).
#[inline(always)]
pub(crate) fn ln<const FMA: bool>(x: f64) -> f64 {
    const HALF_ROOT: u64 = 0x3fe6_a09e_667f_3bcd;
    const ONE: u64 = 0x3ff0_0000_0000_0000;
    // Bits of 2⁵²; with an integer below 2⁵² in the last bits they are 2⁵² + that integer.
    const TWO_52: u64 = 0x4330_0000_0000_0000;
    let shifted = x.to_bits().wrapping_add(ONE - HALF_ROOT);
    let e = f64::from_bits((shifted >> 52) | TWO_52) - (4_503_599_627_370_496.0 + 1023.0);
    let m = f64::from_bits((shifted & 0x000f_ffff_ffff_ffff) + HALF_ROOT);
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    // The first term left out is below 1e-17 at |s| = (√2 − 1)/(√2 + 1).
    const FACTORS: [f64; 10] = {
        let mut factors = [0.0; 10];
        let mut k = 0;
        while k < 10 {
            factors[9 - k] = 2.0 / (2 * k + 3) as f64;
            k += 1;
        }
        factors
    };
    let series = horner::<FMA, 10>(z, FACTORS);
    fma::<FMA>(e, LN2_HIGH, fma::<FMA>(e, LN2_LOW, fma::<FMA>(s * z, series, 2.0 * s)))
}

/// Computes e^−|x| in `f32`, at least e^−87.
#[inline(always)]
fn exp_neg_abs(x: f32) -> f32 {
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    const ROUND: f32 = 12_582_912.0 + 127.0;
    const MIN_EXPONENT: f32 = -87.0;
    let x = -x.abs();
    let x = if x < MIN_EXPONENT { MIN_EXPONENT } else { x };
    let rounded = x * std::f32::consts::LOG2_E + ROUND;
    let k = rounded - ROUND;
    let r = (x - k * LN2_HIGH) - k * LN2_LOW;
    // Taylor: the first term left out is 5e-9 at |r| = ln 2 / 2.
    let series = [1.0 / 5040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0];
    f32::from_bits(rounded.to_bits() << 23) * series.into_iter().fold(0.0, |sum, factor| sum * r + factor)
}

/// Replaces each x by 1/(1 + e^−x).
#[inline(always)]
pub(crate) fn sigmoid(values: &mut [f32]) {
    for x in values {
        let e = exp_neg_abs(*x);
        *x = if *x < 0.0 { e } else { 1.0 } / (1.0 + e);
    }
}

/// Replaces each x by ln(1 + e^x): max(x, 0) + ln(1 + e) with e = e^−|x| and ln(1 + e) = 2 artanh(e/(2 + e)).
#[inline(always)]
pub(crate) fn softplus(values: &mut [f32]) {
    for x in values {
        let e = exp_neg_abs(*x);
        let z = e / (2.0 + e);
        // The first term left out is 1e-9 at e = 1.
        let series = [15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0, 1.0];
        let series = series.into_iter().fold(0.0, |sum, n| sum * (z * z) + 2.0 / n);
        *x = if *x < 0.0 { 0.0 } else { *x } + z * series;
    }
}

/// Opacity and transmittance of each sample.
pub(crate) struct SampleOpacity {
    /// α = 1 − e^−τ.
    pub(crate) alpha: Vec<f64>,
    /// 1 − α = e^−τ.
    pub(crate) transmittance: Vec<f64>,
}

impl SampleOpacity {
    #[inline(always)]
    pub(crate) fn new<const FMA: bool>(tau: &[f32]) -> Self {
        let mut opacity = Self { alpha: vec![0.0; tau.len()], transmittance: vec![0.0; tau.len()] };
        for ((alpha, transmittance), &tau) in opacity.alpha.iter_mut().zip(&mut opacity.transmittance).zip(tau) {
            (*alpha, *transmittance) = self::opacity::<FMA>(tau);
        }
        opacity
    }
}

/// Computes ln((p + ε)/(q + ε)) of each pair, to all digits also where p and q are nearly equal.
#[inline(always)]
pub(crate) fn log_ratio<const FMA: bool>(p: &[f64], q: &[f64], epsilon: f64) -> Vec<f64> {
    let mut out = vec![0.0; p.len()];
    for ((out, &p), &q) in out.iter_mut().zip(p).zip(q) {
        let (a, b) = (p + epsilon, q + epsilon);
        let r = (p - q) / b;
        // For |r| < 0.5, ln(1 + r) with a correction for the digits that 1 + r loses; else ln(a/b).
        let sum = 1.0 + r;
        let near = r.abs() < 0.5;
        let ratio = if near { sum } else { a / b };
        let lost = if near { (r - (sum - 1.0)) / sum } else { 0.0 };
        *out = ln::<FMA>(ratio) + lost;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(got: f64, want: f64, what: f64) {
        assert!((got - want).abs() <= 1e-15 * want.abs(), "{got:e} for {want:e}, of {what:e}");
    }

    fn exponents(range: std::ops::Range<i32>) -> impl Iterator<Item = f64> {
        range.flat_map(|k| [1.0, 1.1, 1.37, 1.41, 1.42, 1.9, 1.999].map(|m| m * 2f64.powi(k)))
    }

    #[test]
    fn opacity_is_exact_at_every_depth() {
        for tau in exponents(-126..9).map(|tau| tau as f32) {
            for (alpha, transmittance) in [opacity::<false>(tau), opacity::<true>(tau)] {
                close(alpha, -(-f64::from(tau)).exp_m1(), f64::from(tau));
                close(transmittance, (-f64::from(tau)).exp(), f64::from(tau));
            }
        }
        assert_eq!(opacity::<true>(0.0), (0.0, 1.0));
        for tau in [1e3, f32::MAX, f32::INFINITY] {
            let (alpha, transmittance) = opacity::<false>(tau);
            assert!(alpha == 1.0 && (0.0..1e-300).contains(&transmittance), "{tau}: {alpha}, {transmittance}");
        }
        for (alpha, transmittance) in [opacity::<false>(f32::NAN), opacity::<true>(f32::NAN)] {
            assert!(alpha.is_nan() && transmittance.is_nan(), "{alpha}, {transmittance}");
        }
    }

    #[test]
    fn softplus_and_sigmoid_keep_their_digits() {
        for x in exponents(-30..9).chain([0.0]).flat_map(|x| [x as f32, -x as f32]) {
            let (mut densities, mut shares) = ([x], [x]);
            softplus(&mut densities);
            sigmoid(&mut shares);
            let exp_neg_abs = (-f64::from(x).abs()).exp();
            let density = f64::from(x).max(0.0) + exp_neg_abs.ln_1p();
            let share = if x < 0.0 { exp_neg_abs } else { 1.0 } / (1.0 + exp_neg_abs);
            for (got, want) in [(densities[0], density), (shares[0], share)] {
                assert!((f64::from(got) - want).abs() <= 3e-7 * want + 2e-38, "{got:e} for {want:e}, of {x}");
            }
        }
        let [mut limits, mut shares] = [[f32::INFINITY, f32::NEG_INFINITY, f32::NAN]; 2];
        softplus(&mut limits);
        sigmoid(&mut shares);
        assert!(limits[0] == f32::INFINITY && limits[1] < 2e-38 && limits[2].is_nan(), "{limits:?}");
        assert!(shares[0] == 1.0 && shares[1] < 2e-38 && shares[2].is_nan(), "{shares:?}");
    }

    #[test]
    fn logarithms_are_exact() {
        for x in exponents(-1000..1000) {
            close(ln::<true>(x), x.ln(), x);
            assert!(ln::<false>(x).is_finite(), "{x:e}");
        }
        assert_eq!(ln::<true>(1.0), 0.0);
    }

    #[test]
    fn ratios_of_nearly_equal_values_keep_their_digits() {
        for step in exponents(-60..-1).map(|step| step / 2.0) {
            for step in [step, -step] {
                let (p, q) = (0.3 * (1.0 + step), 0.3);
                close(log_ratio::<true>(&[p], &[q], 0.0)[0], ((p - q) / q).ln_1p(), step);
            }
        }
        close(log_ratio::<false>(&[1e-12], &[0.5], 1e-10)[0], (1.01e-10f64 / (0.5 + 1e-10)).ln(), 0.0);
    }
}
