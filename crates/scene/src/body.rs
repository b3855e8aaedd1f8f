use glam::{Mat3, Vec3};

/// A body whose surface is known: for fields that hang on its vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Points on its surface, in the world, scene units.
    pub vertices: Vec<Vec3>,
    /// Axes of the frame that it is posed in: columns, in the world.
    pub axes: Mat3,
    /// Origin of that frame, in the world.
    pub origin: Vec3,
}

impl Body {
    /// A body in a frame that is the world's.
    pub fn unposed(vertices: Vec<Vec3>) -> Self {
        Self { vertices, axes: Mat3::IDENTITY, origin: Vec3::ZERO }
    }
}
