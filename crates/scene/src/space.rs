//! Where the content of a scene lies, and how the cameras stand to it.

use glam::Vec3;

use crate::poses::up_direction;
use crate::{Aabb, Body, Camera, Layout, Range};

/// Where the content of a scene lies, and how its cameras stand to it.
#[derive(Clone, Debug, PartialEq)]
pub struct Space {
    /// Distance along any ray before which there is nothing, scene units, ≥ 0.
    pub near: f32,
    /// Distance along any ray beyond which there is nothing, scene units, > `near`.
    pub far: f32,
    /// Where along each ray the content lies; within `near` and `far`.
    pub range: Range,
    /// A box that holds what is to be reconstructed.
    pub bounds: Aabb,
    /// Whether all content lies in `bounds`, so that nothing or the background is beyond.
    pub bounded: bool,
    /// How the cameras stand to the content.
    pub layout: Layout,
    /// The unit direction that is up, as the cameras were held.
    pub up: Vec3,
    /// The point that the cameras look at, or stand about where they look outward.
    pub centre: Vec3,
    /// The greatest distance of a camera from `centre`, scene units, > 0.
    pub radius: f32,
    /// Points on surfaces, where the format has them.
    pub points: Vec<Vec3>,
    /// The body that the scene is of, where the format has one.
    pub body: Option<Body>,
}

impl Default for Space {
    /// That of NeRF's synthetic scenes.
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
    /// The space of cameras about content with known near and far distance and bounds.
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

    /// The same with `centre`, and the radius of `cameras` about it, at least a thousandth.
    pub fn centred(mut self, centre: Vec3, cameras: &[Camera]) -> Self {
        self.centre = centre;
        self.radius = cameras.iter().map(|c| c.position().distance(centre)).fold(1e-3, f32::max);
        self
    }

    /// The same with the near and far distances and the bounds of the file, where it has them.
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
