//! Alignment of two reconstructions (Umeyama 1991).

use glam::{DMat3, DVec3};
use nalgebra::Matrix3;

/// `x ↦ scale · rotation · x + translation`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Positive.
    pub scale: f64,
    /// Proper.
    pub rotation: DMat3,
    /// In the target's units.
    pub translation: DVec3,
}

impl Similarity {
    /// The one that takes each of `from` closest to its pair in `to`, by least squares. `None` for fewer than two places, or
    /// where all are one.
    pub fn between(from: &[DVec3], to: &[DVec3]) -> Option<Self> {
        let count = from.len().min(to.len()) as f64;
        let mean = |points: &[DVec3]| points.iter().sum::<DVec3>() / count;
        let (mean_from, mean_to) = (mean(from), mean(to));
        let (mut covariance, mut variance) = (DMat3::ZERO, 0.0);
        for (a, b) in from.iter().zip(to) {
            let (a, b) = (*a - mean_from, *b - mean_to);
            covariance += DMat3::from_cols(b * a.x, b * a.y, b * a.z);
            variance += a.length_squared();
        }
        let svd = Matrix3::from_column_slice(&covariance.to_cols_array()).svd(true, true);
        let (u, v) = (DMat3::from_cols_slice(svd.u?.as_slice()), DMat3::from_cols_slice(svd.v_t?.as_slice()));
        let sign = DVec3::new(1.0, 1.0, (u.determinant() * v.determinant()).signum());
        let rotation = u * DMat3::from_diagonal(sign) * v;
        let values = svd.singular_values;
        let scale = sign.dot(DVec3::new(values[0], values[1], values[2])) / variance;
        let found = Self { scale, rotation, translation: mean_to - scale * (rotation * mean_from) };
        (found.translation.is_finite() && scale > 0.0).then_some(found)
    }

    /// The image of a point.
    pub fn apply(&self, point: DVec3) -> DVec3 {
        self.scale * (self.rotation * point) + self.translation
    }
}
