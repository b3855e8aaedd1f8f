use glam::Vec3;
use serde::Serialize;

use crate::ray::Ray;

/// The interval of a ray in which a scene's content lies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case", tag = "kind")]
pub enum Range {
    /// Between two distances along the ray.
    Distance {
        /// Near end of the interval, scene units, ≥ 0.
        near: f32,
        /// Far end of the interval, > `near`.
        far: f32,
    },
    /// Between two depths along the camera's viewing axis, as LLFF gives them.
    Depth {
        /// Near end of the interval, scene units, ≥ 0.
        near: f32,
        /// Far end of the interval, > `near`.
        far: f32,
    },
    /// Within `radius` of the point of the ray that is nearest to `centre`, as IDR and NeuS sample it.
    Sphere {
        /// The sphere's centre.
        centre: Vec3,
        /// The sphere's radius, scene units.
        radius: f32,
    },
}

impl Default for Range {
    /// Returns the range of NeRF's synthetic scenes.
    fn default() -> Self {
        Self::Distance { near: 2.0, far: 6.0 }
    }
}

impl Range {
    /// Returns the distances `(near, far)` along `ray`, `0 ≤ near < far`, or `None` where no content lies in front of it.
    pub fn along(&self, ray: &Ray) -> Option<(f32, f32)> {
        let (near, far) = match *self {
            Self::Distance { near, far } => (near, far),
            Self::Depth { near, far } if ray.cosine > 1e-3 => (near / ray.cosine, far / ray.cosine),
            Self::Depth { .. } => return None,
            Self::Sphere { centre, radius } => {
                let middle = (centre - ray.origin).dot(ray.direction);
                (middle - radius, middle + radius)
            }
        };
        let near = near.max(0.0);
        (far.is_finite() && near < far).then_some((near, far))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_along_rays() {
        let ahead = Ray::new(Vec3::new(0.0, 0.0, 3.0), Vec3::NEG_Z);
        let slanted = Ray { cosine: 0.5, ..ahead };
        assert_eq!(Range::Distance { near: 1.0, far: 4.0 }.along(&slanted), Some((1.0, 4.0)));
        let depth = Range::Depth { near: 1.0, far: 4.0 };
        assert_eq!((depth.along(&ahead), depth.along(&slanted)), (Some((1.0, 4.0)), Some((2.0, 8.0))));
        assert_eq!(depth.along(&Ray { cosine: -0.1, ..ahead }), None);
        let sphere = Range::Sphere { centre: Vec3::ZERO, radius: 1.0 };
        assert_eq!(sphere.along(&ahead), Some((2.0, 4.0)));
        assert_eq!(sphere.along(&Ray::new(Vec3::ZERO, Vec3::X)), Some((0.0, 1.0)));
        assert_eq!(sphere.along(&Ray::new(Vec3::X * 3.0, Vec3::X)), None);
    }
}
