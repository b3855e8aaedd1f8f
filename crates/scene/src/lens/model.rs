//! Distortion models of lenses, and their radial part.

/// Number of steps of the search for the end of the invertible domain.
const STEPS: usize = 4096;

/// The distortion model of a lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LensModel {
    /// Pinhole without distortion: straight lines stay straight.
    Perspective,
    /// Radial-tangential (OpenCV): with `r² = x² + y²` and `d = (1 + k₁r² + k₂r⁴ + k₃r⁶ + k₄r⁸) / (1 + q₁r² + q₂r⁴ +
    /// q₃r⁶)`: `x ↦ x·d + 2p₁xy + p₂(r² + 2x²)`, `y ↦ y·d + 2p₂xy + p₁(r² + 2y²)`. COLMAP's FULL_OPENCV has q = its k₄
    /// to k₆ and `k₄ = 0`; nerfstudio's OPENCV has `q = 0`.
    RadialTangential {
        /// Coefficients of the numerator.
        k: [f64; 4],
        /// Coefficients of the denominator.
        q: [f64; 3],
        /// Tangential coefficients.
        p: [f64; 2],
    },
    /// Fisheye: a direction at the angle θ to the axis falls at `θ(1 + k₁θ² + k₂θ⁴ + k₃θ⁶ + k₄θ⁸)` from the centre.
    Fisheye {
        /// Coefficients of the angle's polynomial.
        k: [f64; 4],
    },
    /// Field of view (Devernay and Faugeras 2001; COLMAP's FOV): a point at the distance `r` in the plane at depth 1 falls
    /// at `atan(2 r tan(ω / 2)) / ω` from the centre.
    Fov {
        /// Angle ω in radians, between −π and π and not 0.
        omega: f64,
    },
}

impl LensModel {
    /// Returns the tangential coefficients.
    pub(super) fn tangential(&self) -> [f64; 2] {
        if let Self::RadialTangential { p, .. } = self { *p } else { [0.0; 2] }
    }

    /// Returns the radial factor `d` and its derivative by `r²`.
    pub(super) fn factor(&self, r2: f64) -> (f64, f64) {
        let ([k1, k2, k3, k4], [q1, q2, q3]) = match self {
            Self::RadialTangential { k, q, .. } => (k, q),
            Self::Fov { omega } => return fov_factor(*omega, r2),
            _ => return (1.0, 0.0),
        };
        let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
        let above_derivative = k1 + r2 * (2.0 * k2 + r2 * (3.0 * k3 + r2 * 4.0 * k4));
        let below = 1.0 + r2 * (q1 + r2 * (q2 + r2 * q3));
        let below_derivative = q1 + r2 * (2.0 * q2 + r2 * 3.0 * q3);
        (above / below, (above_derivative * below - above * below_derivative) / (below * below))
    }

    /// Returns the radial part, the distance in the image by the angle's tangent or for fisheyes the angle, and its derivative.
    pub(super) fn profile(&self, r: f64) -> (f64, f64) {
        match self {
            Self::Perspective => (r, 1.0),
            Self::RadialTangential { .. } | Self::Fov { .. } => {
                let (d, derivative) = self.factor(r * r);
                (r * d, d + 2.0 * r * r * derivative)
            }
            Self::Fisheye { k: [k1, k2, k3, k4] } => {
                let s = r * r;
                let value = r * (1.0 + s * (k1 + s * (k2 + s * (k3 + s * k4))));
                let derivative = 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)));
                (value, derivative)
            }
        }
    }

    /// Returns the first `r` up to `end` from which the radial part no longer grows.
    pub(super) fn reach(&self, end: f64) -> f64 {
        let grows = |r: f64| {
            let (value, derivative) = self.profile(r);
            value.is_finite() && derivative > 1e-9 && value >= 0.0
        };
        // Finer near the axis: quadratic steps.
        let at = |i: usize| end * (i as f64 / STEPS as f64).powi(2);
        let Some(first) = (0..=STEPS).find(|&i| !grows(at(i))) else { return end };
        if first == 0 { 0.0 } else { last_where((at(first - 1), at(first)), 60, grows) }
    }
}

/// Returns `atan(2 r tan(ω / 2)) / (ω r)` and its derivative by `r²`.
fn fov_factor(omega: f64, r2: f64) -> (f64, f64) {
    let scale = 2.0 * (0.5 * omega).tan();
    let s = scale * scale * r2;
    if s < 1e-6 {
        // Series about the axis.
        let derivative = scale * scale * (2.0 * s / 5.0 - 1.0 / 3.0);
        return (scale / omega * (1.0 - s / 3.0 + s * s / 5.0), scale / omega * derivative);
    }
    let r = r2.sqrt();
    let angle = (scale * r).atan();
    (angle / (omega * r), (scale * r / (1.0 + s) - angle) / (2.0 * omega * r2 * r))
}

/// Bisects `steps` times between `low`, where `holds` is true, and `high`, where it is false; returns the last `low`.
pub(super) fn last_where((mut low, mut high): (f64, f64), steps: usize, holds: impl Fn(f64) -> bool) -> f64 {
    for _ in 0..steps {
        let middle = 0.5 * (low + high);
        if holds(middle) { low = middle } else { high = middle }
    }
    low
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn series_about_the_axis_meets_the_closed_form() {
        for omega in [0.3, 0.9, -1.2f64] {
            let r2 = 1e-6 / (2.0 * (0.5 * omega).tan()).powi(2);
            let [(a, da), (b, db)] = [-1e-9, 1e-9].map(|off| fov_factor(omega, r2 * (1.0 + off)));
            assert!((a / b - 1.0).abs() < 1e-14 && (da / db - 1.0).abs() < 1e-8, "{omega}: {a} {b} {da} {db}");
        }
    }

    #[test]
    fn derivatives_agree_with_differences() {
        let check = |(_, derivative): (f64, f64), above: (f64, f64), below: (f64, f64)| {
            let expected = (above.0 - below.0) / 2e-6;
            assert!((derivative - expected).abs() < 1e-8, "{derivative} {expected}");
        };
        for model in [
            LensModel::RadialTangential { k: [0.1, -0.05, 0.02, 0.01], q: [0.2, 0.1, 0.05], p: [0.0; 2] },
            LensModel::Fov { omega: 0.9 },
            LensModel::Fisheye { k: [0.1, -0.05, 0.02, 0.01] },
        ] {
            for r in [0.1, 0.5, 0.9] {
                check(model.factor(r), model.factor(r + 1e-6), model.factor(r - 1e-6));
                check(model.profile(r), model.profile(r + 1e-6), model.profile(r - 1e-6));
            }
        }
    }
}
