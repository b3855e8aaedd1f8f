use glam::{Mat3, Vec3};
use serde::Serialize;

use crate::bounds::Aabb;
use crate::camera::Camera;
use crate::layout::Layout;
use crate::poses::up_direction;
use crate::range::Range;

/// The region that a scene's content occupies, and how its cameras are arranged.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Space {
    /// Min distance of content along any ray, scene units, ≥ 0.
    pub near: f32,
    /// Max distance of content along any ray, scene units, > `near`.
    pub far: f32,
    /// The interval of each ray in which the content lies; within `near` and `far`.
    pub range: Range,
    /// The box around the content to be reconstructed.
    pub bounds: Aabb,
    /// Whether all content lies in `bounds`, with nothing but the background beyond.
    pub bounded: bool,
    /// Arrangement of the cameras.
    pub layout: Layout,
    /// The up direction shared by the cameras, unit length.
    pub up: Vec3,
    /// The point that the cameras look at; where they look outward, the mean of their positions.
    pub centre: Vec3,
    /// Max distance of a camera from `centre`, scene units, > 0.
    pub radius: f32,
    /// Surface points, where the format provides them.
    #[serde(skip)]
    pub points: Vec<Vec3>,
    /// The body in the scene, where the format provides one.
    #[serde(skip)]
    pub body: Option<Body>,
}

impl Default for Space {
    /// Returns the space of NeRF's synthetic scenes.
    fn default() -> Self {
        Self {
            near: 2.0,
            far: 6.0,
            range: Range::default(),
            bounds: Aabb::cube(Vec3::ZERO, 1.5),
            bounded: true,
            layout: Layout::default(),
            up: Vec3::Z,
            centre: Vec3::ZERO,
            radius: 4.0,
            points: Vec::new(),
            body: None,
        }
    }
}

impl Space {
    /// Returns the space of `cameras` whose content has known near and far distances and bounds.
    pub fn known(cameras: &[Camera], (near, far): (f32, f32), bounds: Aabb) -> Self {
        Self {
            near,
            far,
            range: Range::Distance { near, far },
            bounds,
            layout: Layout::of(cameras),
            up: up_direction(cameras).as_vec3(),
            ..Self::default()
        }
        .centred(bounds.centre(), cameras)
    }

    /// Replaces the centre, and the radius by the largest distance of `cameras` from it (at least 0.001).
    pub fn centred(mut self, centre: Vec3, cameras: &[Camera]) -> Self {
        self.centre = centre;
        self.radius = cameras.iter().map(|c| c.position().distance(centre)).fold(1e-3, f32::max);
        self
    }

    /// Replaces near and far, and the bounds, by those of a file where it states them.
    pub fn with(mut self, range: Option<(f32, f32)>, bounds: Option<Aabb>) -> Self {
        if let Some((near, far)) = range {
            (self.near, self.far, self.range) = (near, far, Range::Distance { near, far });
        }
        if let Some(bounds) = bounds {
            self.bounds = bounds;
        }
        self
    }
}

/// A body with a known surface, for fields that are attached to its vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Points on the body's surface, in the world, scene units.
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
