//! Half-lines through the scene.

use glam::Vec3;

/// A half-line `origin + t · direction`, `t ≥ 0`.
///
/// `direction` has unit length wherever this crate makes a ray, so `t` is a distance in scene units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where the ray starts, in world coordinates.
    pub origin: Vec3,
    /// Where it goes, unit length.
    pub direction: Vec3,
}

impl Ray {
    /// The point `origin + t · direction`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + t * self.direction
    }
}
