//! Lens models: from directions to the image plane, and back.

mod model;

pub use model::LensModel;

use std::f64::consts::PI;
use std::fmt;

use glam::{DMat2, DVec2, DVec3};

use model::last_where;

/// Max tangent of the angle to the axis at which a radial-tangential lens is evaluated (88.9°).
const MAX_TANGENT: f64 = 50.0;
/// Max number of Newton steps for the tangential part; four suffice for any real lens.
const NEWTON: usize = 32;
/// Max residual of a solution, in focal lengths.
const SOLVED: f64 = 1e-13;

/// A lens, in units of the focal length: x right, y down, z forward.
///
/// It is used only where it can be inverted: from the axis outward until the image radius stops growing with the angle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    model: LensModel,
    /// End of the invertible domain: an angle in radians for fisheyes, a tangent for other lenses.
    reach: f64,
}

impl Default for Lens {
    fn default() -> Self {
        Self::PERSPECTIVE
    }
}

impl Lens {
    /// A lens without distortion.
    pub const PERSPECTIVE: Self = Self { model: LensModel::Perspective, reach: f64::INFINITY };

    /// Returns the lens of a model. A radial-tangential model whose coefficients are all 0 is [`Lens::PERSPECTIVE`].
    pub fn new(model: LensModel) -> Self {
        let zero = LensModel::RadialTangential { k: [0.0; 4], q: [0.0; 3], p: [0.0; 2] };
        if [zero, LensModel::Perspective].contains(&model) {
            return Self::PERSPECTIVE;
        }
        let end = if let LensModel::Fisheye { .. } = model { PI } else { MAX_TANGENT };
        Self { model, reach: model.reach(end) }
    }

    /// Returns a lens with the coefficients of nerfstudio's and OpenCV's polynomial model.
    pub fn radial_tangential(k: [f64; 4], p: [f64; 2]) -> Self {
        Self::new(LensModel::RadialTangential { k, q: [0.0; 3], p })
    }

    /// Returns a lens with COLMAP's FULL_OPENCV coefficients: `k₁` to `k₃` of the numerator, `k₄` to `k₆` of the denominator.
    pub fn rational(k: [f64; 6], p: [f64; 2]) -> Self {
        let [k1, k2, k3, k4, k5, k6] = k;
        Self::new(LensModel::RadialTangential { k: [k1, k2, k3, 0.0], q: [k4, k5, k6], p })
    }

    /// Returns a fisheye with the coefficients of OPENCV_FISHEYE.
    pub fn fisheye(k: [f64; 4]) -> Self {
        Self::new(LensModel::Fisheye { k })
    }

    /// Returns a lens of the field-of-view model with the angle `omega`, radians.
    pub fn fov(omega: f64) -> Self {
        Self::new(LensModel::Fov { omega })
    }

    /// Returns the lens for the image turned clockwise by 90°, `(x, y) ↦ (−y, x)`, which changes the tangential part.
    pub(crate) fn turned(&self) -> Self {
        let mut turned = *self;
        if let LensModel::RadialTangential { p, .. } = &mut turned.model {
            *p = [p[1], -p[0]];
        }
        turned
    }

    /// Returns the lens's distortion model.
    pub fn model(&self) -> LensModel {
        self.model
    }

    /// Whether straight lines stay straight.
    pub fn is_perspective(&self) -> bool {
        self.model == LensModel::Perspective
    }

    /// Returns the image point of `(x, y)` in the plane at depth 1, or `None` outside the invertible domain.
    pub fn distort(&self, point: DVec2) -> Option<DVec2> {
        self.project(point.extend(1.0))
    }

    /// Returns the point of the plane at depth 1 that falls at `image`: the inverse of [`Lens::distort`], to 1e-9 and
    /// better. `None` where there is none, as beyond 90°.
    pub fn undistort(&self, image: DVec2) -> Option<DVec2> {
        if self.is_perspective() {
            return image.is_finite().then_some(image);
        }
        let direction = self.unproject(image)?;
        (direction.z > 1e-9).then(|| direction.truncate() / direction.z)
    }

    /// Returns the image point of a direction of any length, or `None` outside the invertible domain.
    pub fn project(&self, direction: DVec3) -> Option<DVec2> {
        let across = direction.truncate();
        let point = across / direction.z;
        match self.model {
            LensModel::Perspective => (direction.z > 0.0 && point.is_finite()).then_some(point),
            LensModel::RadialTangential { .. } | LensModel::Fov { .. } => {
                (direction.z > 0.0 && point.length() <= self.reach).then(|| self.bend(point))
            }
            LensModel::Fisheye { .. } => {
                let r = across.length();
                let angle = r.atan2(direction.z);
                let seen = direction.is_finite() && direction != DVec3::ZERO && angle <= self.reach;
                seen.then(|| if r > 0.0 { across * (self.model.profile(angle).0 / r) } else { DVec2::ZERO })
            }
        }
    }

    /// Returns the unit direction whose image point is `image`, or `None` outside the invertible domain.
    pub fn unproject(&self, image: DVec2) -> Option<DVec3> {
        if !image.is_finite() {
            return None;
        }
        let radius = image.length();
        match &self.model {
            LensModel::Perspective => Some(image.extend(1.0).normalize()),
            LensModel::Fisheye { .. } => {
                let (sin, cos) = self.unprofile(radius)?.sin_cos();
                Some((if radius > 0.0 { image * (sin / radius) } else { DVec2::ZERO }).extend(cos))
            }
            _ => Some(self.unbend(image)?.extend(1.0).normalize()),
        }
    }

    /// Returns [`Lens::unproject`] or, outside the invertible domain, the direction at its edge on the same side.
    pub(crate) fn nearest_direction(&self, image: DVec2) -> DVec3 {
        if let Some(direction) = self.unproject(image) {
            return direction;
        }
        let inside = last_where((0.0, 1.0), 48, |share| self.unproject(image * share).is_some());
        self.unproject(image * inside).unwrap_or(DVec3::Z)
    }

    /// Returns the magnification in `direction` (unit length) relative to the axis: the square root of the change in
    /// area. 1 for a perspective lens, measured in the plane at depth 1; for a fisheye measured on the sphere and
    /// divided by the cosine, so that `cos θ / magnification` is the width of an image point at distance 1.
    pub(crate) fn magnification(&self, direction: DVec3) -> f64 {
        let scale = match &self.model {
            LensModel::Perspective => return 1.0,
            LensModel::RadialTangential { .. } | LensModel::Fov { .. } => {
                self.jacobian(direction.truncate() / direction.z.max(1e-9)).determinant().abs().sqrt()
            }
            LensModel::Fisheye { .. } => {
                let r = direction.truncate().length();
                let (value, derivative) = self.model.profile(r.atan2(direction.z));
                let along = if r > 1e-9 { value / r } else { 1.0 };
                (along * derivative.max(0.0)).sqrt() * direction.z.abs().max(1e-6)
            }
        };
        scale.max(1e-6)
    }

    /// Returns the inverse of the radial part: bracketed Newton steps.
    fn unprofile(&self, value: f64) -> Option<f64> {
        let (mut low, mut high) = (0.0, self.reach);
        let end = self.model.profile(high).0;
        if value.is_nan() || end.is_nan() || value > end {
            return None;
        }
        let mut r = value.min(high);
        for _ in 0..100 {
            let (found, derivative) = self.model.profile(r);
            let rest = found - value;
            (low, high) = if rest > 0.0 { (low, r) } else { (r, high) };
            let next = r - rest / derivative;
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            if (next - r).abs() <= 1e-16 * r.max(1e-3) || rest == 0.0 {
                break;
            }
            r = next;
        }
        Some(r)
    }

    /// Returns the whole map of the plane at depth 1: its radial and its tangential part.
    fn bend(&self, point: DVec2) -> DVec2 {
        let [p1, p2] = self.model.tangential();
        let (x, y) = (point.x, point.y);
        let r2 = x * x + y * y;
        let (d, _) = self.model.factor(r2);
        DVec2::new(
            x * d + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * d + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
        )
    }

    /// Returns the derivative of [`Lens::bend`].
    fn jacobian(&self, point: DVec2) -> DMat2 {
        let [p1, p2] = self.model.tangential();
        let (x, y) = (point.x, point.y);
        let (d, derivative) = self.model.factor(x * x + y * y);
        let cross = 2.0 * x * y * derivative + 2.0 * p1 * x + 2.0 * p2 * y;
        DMat2::from_cols(
            DVec2::new(d + 2.0 * x * x * derivative + 2.0 * p1 * y + 6.0 * p2 * x, cross),
            DVec2::new(cross, d + 2.0 * y * y * derivative + 2.0 * p2 * x + 6.0 * p1 * y),
        )
    }

    /// Returns the inverse of [`Lens::bend`]: the radial part by itself, then Newton steps in the plane.
    fn unbend(&self, image: DVec2) -> Option<DVec2> {
        let radius = image.length();
        if radius == 0.0 {
            return Some(image);
        }
        if self.model.tangential() == [0.0; 2] {
            return Some(image * (self.unprofile(radius)? / radius));
        }
        // A tangential part may shift a point at the edge of the domain a little beyond the radial part's range.
        let start = self.unprofile(radius.min(self.model.profile(self.reach).0))?;
        let mut point = image * (start / radius);
        for _ in 0..NEWTON {
            let rest = self.bend(point) - image;
            if rest.length() <= SOLVED * radius.max(1.0) {
                break;
            }
            let jacobian = self.jacobian(point);
            if jacobian.determinant().abs() < 1e-9 {
                return None;
            }
            point -= jacobian.inverse() * rest;
        }
        let solved = (self.bend(point) - image).length() <= 1e-11 * radius.max(1.0);
        let inside = point.length() <= self.reach && self.jacobian(point).determinant() > 0.0;
        (solved && inside).then_some(point)
    }
}

impl fmt::Display for Lens {
    /// Writes the model's name and its coefficients to four digits, such as `fisheye, k 0.1 0 0 0`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |values: &[f64]| {
            // Adding 0 removes the sign of −0.
            let rounded = values.iter().map(|value| (value * 1e4).round() / 1e4 + 0.0);
            rounded.map(|value| value.to_string()).collect::<Vec<_>>().join(" ")
        };
        match &self.model {
            LensModel::Perspective => write!(f, "perspective"),
            LensModel::Fisheye { k } => write!(f, "fisheye, k {}", list(k)),
            LensModel::Fov { omega } => write!(f, "field of view, omega {}", list(&[*omega])),
            LensModel::RadialTangential { k, q, p } => {
                write!(f, "radial-tangential, k {}", list(k))?;
                if *q != [0.0; 3] {
                    write!(f, " over {}", list(q))?;
                }
                write!(f, ", p {}", list(p))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns lenses of phones, an action camera, a pincushion and a wide lens that turns back.
    fn lenses() -> Vec<Lens> {
        vec![
            Lens::PERSPECTIVE,
            Lens::radial_tangential([0.08, -0.12, 0.0, 0.0], [1e-3, -5e-4]),
            Lens::radial_tangential([-0.28, 0.07, 0.0, 0.0], [2e-4, 1e-5]),
            Lens::radial_tangential([0.2, 0.05, 0.01, 0.001], [0.0, 0.0]),
            Lens::rational([0.5, 0.1, 0.01, 0.4, 0.12, 0.002], [-1e-3, 2e-3]),
            Lens::fisheye([0.0; 4]),
            Lens::fisheye([-0.02, 0.01, -0.004, 0.0005]),
            Lens::fov(0.9),
            Lens::fov(1e-2),
        ]
    }

    #[test]
    fn the_inverse_is_exact_over_the_image() {
        for lens in lenses() {
            for i in -20..=20 {
                for j in -15..=15 {
                    let image = DVec2::new(f64::from(i), f64::from(j)) * 0.04;
                    let point = lens.undistort(image).unwrap_or_else(|| panic!("{lens}: {image}"));
                    let back = lens.distort(point).unwrap();
                    assert!((back - image).length() < 1e-12, "{lens}: {image} {back}");
                    let again = lens.undistort(back).unwrap();
                    assert!((again - point).length() < 1e-9, "{lens}: {point} {again}");
                    let direction = lens.unproject(image).unwrap();
                    assert!((direction.length() - 1.0).abs() < 1e-12);
                    assert!((lens.project(direction * 3.0).unwrap() - image).length() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn nothing_outside_the_invertible_domain() {
        // r − 0.28 r³ turns back at r = 1.09, where it is 0.727.
        let lens = Lens::radial_tangential([-0.28, 0.0, 0.0, 0.0], [0.0; 2]);
        assert!(lens.undistort(DVec2::new(0.72, 0.0)).is_some());
        assert_eq!(lens.undistort(DVec2::new(0.73, 0.0)), None);
        assert_eq!(lens.distort(DVec2::new(1.2, 0.0)), None);
        let edge = lens.nearest_direction(DVec2::new(0.9, 0.0));
        assert!((edge.x / edge.z - 1.0910895).abs() < 1e-4, "{edge}");
        for bad in [f64::NAN, f64::INFINITY].map(|x| DVec2::new(x, 0.0)) {
            assert_eq!((lens.undistort(bad), lens.distort(bad)), (None, None));
        }
        // A fisheye sees beyond 90°.
        let fisheye = Lens::fisheye([0.0; 4]);
        let image = DVec2::new(1.8, 0.0);
        let direction = fisheye.unproject(image).unwrap();
        assert!(direction.z < 0.0 && (fisheye.project(direction).unwrap() - image).length() < 1e-12);
        assert_eq!((fisheye.undistort(image), fisheye.unproject(DVec2::new(3.2, 0.0))), (None, None));
        // A model with NaN can be inverted only at the centre.
        let broken = Lens::radial_tangential([f64::NAN, 0.0, 0.0, 0.0], [0.0; 2]);
        assert_eq!(broken.undistort(DVec2::new(0.1, 0.0)), None);
    }

    /// Checks the formulas against values by hand.
    #[test]
    fn the_formulas() {
        for (omega, r) in [(0.9, 0.5), (1.8, 2.0), (0.9, 1e-4), (1e-3, 0.7)] {
            let (lens, r): (Lens, f64) = (Lens::fov(omega), r);
            let image = (2.0 * r * (omega / 2.0).tan()).atan() / omega;
            let found = lens.distort(DVec2::new(0.6, -0.8) * r).unwrap();
            assert!((found - DVec2::new(0.6, -0.8) * image).length() < 1e-12, "{lens}: {found}");
            let back = lens.undistort(DVec2::new(0.0, image)).unwrap().y;
            assert!((back - (image * omega).tan() / (2.0 * (omega / 2.0).tan())).abs() < 1e-12, "{lens}: {back}");
        }
        let lens = Lens::radial_tangential([0.1, 0.0, 0.0, 0.0], [0.01, 0.02]);
        let found = lens.distort(DVec2::new(0.5, 0.25)).unwrap();
        let r2: f64 = 0.3125;
        let d = 1.0 + 0.1 * r2;
        let expected = DVec2::new(
            0.5 * d + 2.0 * 0.01 * 0.125 + 0.02 * (r2 + 0.5),
            0.25 * d + 2.0 * 0.02 * 0.125 + 0.01 * (r2 + 0.125),
        );
        assert!((found - expected).length() < 1e-15);
        assert!(Lens::radial_tangential([0.0; 4], [0.0; 2]).is_perspective());
    }

    #[test]
    fn magnification_is_the_change_in_size() {
        for lens in lenses() {
            let direction = DVec3::new(0.3, -0.2, 1.0).normalize();
            let step = 1e-5;
            let plane = direction.truncate() / direction.z;
            let at = |d: DVec2| lens.distort(plane + d).unwrap();
            let (a, b) = (at(DVec2::X * step) - at(DVec2::ZERO), at(DVec2::Y * step) - at(DVec2::ZERO));
            let area = a.perp_dot(b).abs().sqrt() / step;
            let found = lens.magnification(direction);
            // A fisheye's magnification is measured across the ray; the area in the plane is 1 / cos θ times as large.
            let ratio = if matches!(lens.model(), LensModel::Fisheye { .. }) { direction.z.sqrt() } else { 1.0 };
            assert!((found / area * ratio - 1.0).abs() < 1e-4, "{lens}: {found} {area}");
        }
    }
}
