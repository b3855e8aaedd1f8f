//! What the cameras of a real capture say about where its content is, and which views to hold out.

use glam::Vec3;

use crate::poses::ViewRegion;
use crate::{Aabb, Camera};

/// Every this many views one is held out for test, starting with the first.
const HOLD_OUT: usize = 8;

/// Splits views into a training and a test pool: views 0, 8, 16, … are for test. A single view
/// stays in both pools' place of training.
pub(super) fn hold_out<T>(views: Vec<T>) -> (Vec<T>, Vec<T>) {
    let alone = views.len() == 1;
    let (test, train): (Vec<_>, Vec<_>) = views.into_iter().enumerate().partition(|(i, _)| !alone && i % HOLD_OUT == 0);
    let strip = |pool: Vec<(usize, T)>| pool.into_iter().map(|(_, view)| view).collect();
    (strip(train), strip(test))
}

/// `(near, far)` and bounds for a capture without any of its own.
///
/// With `c` the point nearest to all optical axes and `r` the greatest distance of a camera from it,
/// the bounds are the cube `c ± r`; near is `r / 20`, far reaches its farthest corner from any
/// camera, `r (1 + √3)`.
pub(super) fn capture_extent(cameras: &[Camera]) -> ((f32, f32), Aabb) {
    let region = ViewRegion::new(cameras);
    let radius = (region.radii().1 as f32).max(1e-3);
    let centre = region.centre().as_vec3();
    ((0.05 * radius, (1.0 + 3f32.sqrt()) * radius), Aabb::cube(centre, radius))
}

/// The smallest box around what the cameras see between the distances `near` and `far` along their
/// optical axes.
pub(super) fn frusta_bounds(cameras: &[Camera], near: f32, far: f32) -> Option<Aabb> {
    let corners = cameras.iter().flat_map(|camera| {
        let (w, h) = (camera.width as f32, camera.height as f32);
        [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h)].into_iter().flat_map(move |(x, y)| {
            let ray = camera.ray(x, y);
            let along = ray.direction.dot(camera.forward());
            [ray.at(near / along), ray.at(far / along)]
        })
    });
    Aabb::containing(corners.filter(|p: &Vec3| p.is_finite()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_eighth_is_held_out() {
        let (train, test) = hold_out((0..20).collect());
        assert_eq!(test, [0, 8, 16]);
        assert_eq!(train.len(), 17);
        assert_eq!(hold_out(vec![7]), (vec![7], vec![]));
    }

    #[test]
    fn frusta_of_one_camera() {
        let camera = Camera::from_fov(2, 2, std::f64::consts::FRAC_PI_2, glam::DMat4::IDENTITY);
        let bounds = frusta_bounds(&[camera], 1.0, 2.0).unwrap();
        assert!((bounds.min - Vec3::new(-2.0, -2.0, -2.0)).length() < 1e-5);
        assert!((bounds.max - Vec3::new(2.0, 2.0, -1.0)).length() < 1e-5);
    }
}
