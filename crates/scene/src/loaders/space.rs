//! Where a scene's content lies, as a loader has found it out.

use glam::Vec3;

use crate::poses::{FORWARD_FACING, cone, scene_focus, up_direction};
use crate::{Aabb, Body, Camera, Layout, Range};

/// Cameras look at an object if the cosine of the angle between their axes and the way to the object is at least this in
/// the mean.
const INWARD: f64 = 0.5;

/// What is known of the space between the views.
#[derive(Clone, Debug)]
pub(crate) struct Space {
    /// Where along each ray the content lies.
    pub range: Range,
    /// The least distance of content from any camera along any ray.
    pub near: f32,
    /// The greatest.
    pub far: f32,
    /// What is to be reconstructed.
    pub bounds: Aabb,
    /// Whether nothing lies outside the bounds.
    pub bounded: bool,
    /// How the cameras stand.
    pub layout: Layout,
    /// The unit direction that is up.
    pub up: Vec3,
    /// What the cameras look at, or stand about.
    pub centre: Vec3,
    /// The greatest distance of a camera from the centre.
    pub radius: f32,
    /// Points on surfaces.
    pub points: Vec<Vec3>,
    /// The body that it is of.
    pub body: Option<Body>,
}

impl Space {
    /// The space of cameras about content with known near and far distance and bounds.
    pub fn known(cameras: &[Camera], (near, far): (f32, f32), bounds: Aabb) -> Self {
        let centre = bounds.centre();
        Self {
            range: Range::Distance { near, far },
            near,
            far,
            bounds,
            bounded: true,
            layout: camera_layout(cameras),
            up: up_direction(cameras).as_vec3(),
            centre,
            radius: farthest(cameras, centre),
            points: Vec::new(),
            body: None,
        }
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

/// How the cameras stand, from their poses alone. A single camera faces forward.
pub(super) fn camera_layout(cameras: &[Camera]) -> Layout {
    if cameras.is_empty() {
        return Layout::Object;
    }
    if cone(cameras) < FORWARD_FACING {
        return Layout::Forward;
    }
    let centre = scene_focus(cameras).centre;
    let towards: f64 =
        cameras.iter().map(|c| c.forward_f64().dot((centre - c.position_f64()).normalize_or_zero())).sum();
    if towards >= INWARD * cameras.len() as f64 { Layout::Object } else { Layout::Inside }
}

/// The greatest distance of a camera from `centre`, at least a thousandth.
pub(super) fn farthest(cameras: &[Camera], centre: Vec3) -> f32 {
    cameras.iter().map(|c| c.position().distance(centre)).fold(1e-3, f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::look_along;
    use glam::DVec3;

    #[test]
    fn layouts() {
        let ring = |outward: f64| -> Vec<Camera> {
            (0..6)
                .map(|i| {
                    let d = DVec3::new(f64::from(i).cos(), f64::from(i).sin(), 0.2).normalize();
                    Camera::from_fov(8, 8, 0.8, look_along(3.0 * d, outward * d, DVec3::Z))
                })
                .collect()
        };
        assert_eq!(camera_layout(&ring(-1.0)), Layout::Object);
        assert_eq!(camera_layout(&ring(1.0)), Layout::Inside);
        let row: Vec<_> = (0..4)
            .map(|i| Camera::from_fov(8, 8, 0.8, look_along(DVec3::X * f64::from(i), DVec3::Y, DVec3::Z)))
            .collect();
        assert_eq!(camera_layout(&row), Layout::Forward);
        assert_eq!(camera_layout(&row[..1]), Layout::Forward);
    }
}
