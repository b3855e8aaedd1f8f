use glam::{Mat3, Vec3};

/// A body with a known surface, for fields that are attached to its vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Points on its surface, in the world, scene units.
    pub vertices: Vec<Vec3>,
    /// Axes of the body's own frame in world coordinates, as columns.
    pub axes: Mat3,
    /// Origin of the body's own frame in world coordinates.
    pub origin: Vec3,
}

impl Body {
    /// Returns a body whose own frame is the world frame.
    pub fn unposed(vertices: Vec<Vec3>) -> Self {
        Self { vertices, axes: Mat3::IDENTITY, origin: Vec3::ZERO }
    }
}
