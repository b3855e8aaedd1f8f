//! Half-lines through the scene, and the cones of pixels around them.

use glam::Vec3;

/// A half-line `origin + t · direction`, `t ≥ 0`.
///
/// `direction` has unit length wherever this crate makes a ray, so `t` is a distance in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Origin of the ray in world coordinates.
    pub origin: Vec3,
    /// Direction, unit length.
    pub direction: Vec3,
    /// Radius of the pixel's cone at distance 1 (mip-NeRF, Sec. 3.1): at distance `t` it is `t · radius`. 0 for a line.
    pub radius: f32,
    /// Cosine of the angle to the camera's viewing axis, along which depth is `t · cosine`. 1 for a ray without a camera.
    pub cosine: f32,
}

impl Ray {
    /// Returns a ray from `origin` along `direction` that belongs to no camera: its cone has radius 0, its cosine is 1.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, radius: 0.0, cosine: 1.0 }
    }

    /// Returns the ray of a pixel `factor` times as wide.
    pub fn widened(self, factor: f32) -> Self {
        Self { radius: self.radius * factor, ..self }
    }

    /// Returns the point `origin + t · direction`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }
}

/// A point in the image of one of several views.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelAt {
    /// Index of the view.
    pub view: usize,
    /// Column in pixels of the view's camera; the first pixel's centre is at 0.5.
    pub x: f32,
    /// Row, from the top.
    pub y: f32,
}
