use std::fmt;

use serde::Serialize;

use crate::camera::Camera;
use crate::poses::{FORWARD_FACING, cone, scene_focus};

/// Min mean cosine of the angle between viewing axes and directions to the centre at which cameras look at an object.
const INWARD: f64 = 0.5;

/// Arrangement of the cameras around the content.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// Cameras that surround an object and look at it.
    #[default]
    Object,
    /// Cameras side by side that look one way.
    Forward,
    /// Cameras that look outward, as from within a room.
    Inside,
}

impl fmt::Display for Layout {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Object => "around an object",
            Self::Forward => "forward facing",
            Self::Inside => "looking outward",
        })
    }
}

impl Layout {
    /// Returns the layout of `cameras`, from their poses alone. A single camera is forward facing.
    pub fn of(cameras: &[Camera]) -> Self {
        if cameras.is_empty() {
            return Self::Object;
        }
        if cone(cameras) < FORWARD_FACING {
            return Self::Forward;
        }
        let centre = scene_focus(cameras).centre;
        let towards: f64 =
            cameras.iter().map(|c| c.forward_f64().dot((centre - c.position_f64()).normalize_or_zero())).sum();
        if towards >= INWARD * cameras.len() as f64 { Self::Object } else { Self::Inside }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::bounds::Aabb;
    use crate::space::Space;
    use crate::testing::level_camera;

    #[test]
    fn layouts() {
        let around = |i: u32| DVec3::new(f64::from(i).cos(), f64::from(i).sin(), 0.2).normalize();
        let ring = |outward: f64| -> Vec<Camera> {
            (0..6).map(|i| level_camera(3.0 * around(i), outward * around(i))).collect()
        };
        assert_eq!(Layout::of(&ring(-1.0)), Layout::Object);
        assert_eq!(Layout::of(&ring(1.0)), Layout::Inside);
        let bounds = Aabb::cube(Vec3::ZERO, 1.0);
        assert_eq!(Space::known(&ring(1.0), (0.1, 2.0), bounds).layout, Layout::Inside);
        let row: Vec<_> = (0..4).map(|i| level_camera(DVec3::X * f64::from(i), DVec3::Y)).collect();
        assert_eq!(Layout::of(&row), Layout::Forward);
        assert_eq!(Layout::of(&row[..1]), Layout::Forward);
    }
}
