//! Errors of computed values against the oracle.

use serde::Serialize;

/// Magnitude of an expected value below which relative errors are not measured.
const FLOOR: f64 = 1e-20;

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub(super) struct Errors {
    pub(super) numbers: u64,
    /// Number of NaN and ±∞ among the numbers.
    pub(super) non_finite: u64,
    /// Maximum of |got − want|/|want|.
    pub(super) value: f64,
    /// Maximum of |got − want| over max |want| of the same ray or table.
    pub(super) gradient: f64,
}

impl Errors {
    pub(super) fn value(&mut self, got: f32, want: f64) {
        self.numbers += 1;
        if !got.is_finite() {
            self.non_finite += 1;
        } else if want.abs() > FLOOR {
            self.value = self.value.max((f64::from(got) - want).abs() / want.abs());
        }
    }

    /// Counts gradients that should be `want`; where `undefined` holds, they only have to be finite.
    pub(super) fn gradient(&mut self, got: &[f32], want: &[f64], undefined: impl Fn(usize) -> bool) {
        self.gradient = self.gradient.max(self.relative(got, want, undefined));
    }

    /// Counts values that should be `want`, with errors relative to max |want|, since some are differences of large terms.
    pub(super) fn values(&mut self, got: &[f32], want: &[f64]) {
        self.value = self.value.max(self.relative(got, want, |_| false));
    }

    /// Counts numbers that should be `want`, and returns max |got − want| / max |want| of the defined ones.
    fn relative(&mut self, got: &[f32], want: &[f64], undefined: impl Fn(usize) -> bool) -> f64 {
        self.numbers += got.len() as u64;
        self.non_finite += got.iter().filter(|got| !got.is_finite()).count() as u64;
        let defined = || got.iter().zip(want).enumerate().filter(|(i, (got, _))| got.is_finite() && !undefined(*i));
        let largest = defined().map(|(_, (_, want))| want.abs()).fold(0.0, f64::max);
        let error = |(_, (got, want)): (usize, (&f32, &f64))| (f64::from(*got) - want).abs() / largest;
        if largest > FLOOR { defined().map(error).fold(0.0, f64::max) } else { 0.0 }
    }

    pub(super) fn merged(self, other: Self) -> Self {
        Self {
            numbers: self.numbers + other.numbers,
            non_finite: self.non_finite + other.non_finite,
            value: self.value.max(other.value),
            gradient: self.gradient.max(other.gradient),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_and_leave_out_undefined_gradients() {
        let mut errors = Errors::default();
        errors.value(1.5, 1.0);
        errors.value(7.0, 1e-21);
        errors.value(f32::NAN, 1.0);
        errors.gradient(&[2.0, 0.5, 9.0, f32::INFINITY], &[1.0, 4.0, 1.0, 1.0], |i| i == 2);
        assert_eq!(errors, Errors { numbers: 7, non_finite: 2, value: 0.5, gradient: 3.5 / 4.0 });
    }
}
