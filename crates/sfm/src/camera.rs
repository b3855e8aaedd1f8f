//! Poses and the lens.

use glam::{DMat3, DQuat, DVec2, DVec3};

/// Pose of a camera, world to camera: `x ↦ rotation · x + translation`; the camera looks along +z, y is down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// World to camera.
    pub rotation: DMat3,
    /// The world's origin in the camera's axes.
    pub translation: DVec3,
}

impl Pose {
    /// The world's axes.
    pub const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO };

    /// Returns a point of the world in the camera's axes.
    pub fn transform(&self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Returns the position of the camera in the world.
    pub fn centre(&self) -> DVec3 {
        -(self.rotation.transpose() * self.translation)
    }

    /// Turns the pose by the rotation vector `turn` about the camera, then moves it by `shift`, both in the camera's axes.
    pub(crate) fn moved(&self, turn: DVec3, shift: DVec3) -> Self {
        let rotation = DMat3::from_quat((DQuat::from_scaled_axis(turn) * DQuat::from_mat3(&self.rotation)).normalize());
        Self { rotation, translation: self.translation + shift }
    }
}

/// Lens with square pixels, the centre of the image, and one coefficient of radial distortion (COLMAP's SIMPLE_RADIAL):
/// `p = focal · (1 + k1 r²) · (x, y) / z + centre` with `r² = (x² + y²) / z²`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SimpleRadial {
    /// Pixels.
    pub focal: f64,
    /// Radial distortion.
    pub k1: f64,
    /// Pixels.
    pub centre: DVec2,
}

impl SimpleRadial {
    /// Returns the pixel at which a point in the camera's axes is seen; `None` behind the camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let p = point.truncate() / point.z;
        (point.z > 0.0).then(|| self.focal * (1.0 + self.k1 * p.length_squared()) * p + self.centre)
    }

    /// Returns `(x, y) / z` of what is seen at `pixel`: the inverse of [`SimpleRadial::project`], by fixed-point
    /// iteration.
    pub fn unproject(&self, pixel: DVec2) -> DVec2 {
        let distorted = (pixel - self.centre) / self.focal;
        (0..20).fold(distorted, |p, _| distorted / (1.0 + self.k1 * p.length_squared()).max(0.1))
    }
}
