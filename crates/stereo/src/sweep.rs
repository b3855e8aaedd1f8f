//! Candidate depths of pixels, and the cost of each.

use glam::{Mat4, Vec2, Vec3};
use infonerf_scene::image::GreyImage;
use infonerf_scene::{Camera, Ray, Scene};
use rayon::prelude::*;

use crate::correlation::Windows;
use crate::{DepthMap, DisparityRange};

/// Min and max number of candidate depths per ray.
const MIN_PLANES: usize = 16;
const MAX_PLANES: usize = 192;
/// Half the side of the windows that are compared, in pixels.
const HALF_WINDOW: usize = 3;

/// Cost of a plane at which no other view can be compared.
const UNSEEN_COST: f32 = 0.5;

/// Candidate depths of each pixel of a view: equally many on each ray, evenly spaced in the disparity that it can show.
pub(crate) struct PlaneSweep {
    width: usize,
    height: usize,
    pub(crate) planes: usize,
    /// `None` for pixels that show nothing.
    rays: Vec<Option<RayPlanes>>,
}

/// Planes along the ray of a pixel.
#[derive(Clone, Copy)]
struct RayPlanes {
    ray: Ray,
    /// Disparity of the first plane, which is the farthest.
    far: f32,
    /// Difference in disparity between planes.
    step: f32,
}

impl PlaneSweep {
    pub(crate) fn new(scene: &Scene, camera: &Camera, others: &[(&GreyImage, &Camera)], range: DisparityRange) -> Self {
        let (width, height) = (camera.width as usize, camera.height as usize);
        let ends = |i: usize| {
            let ray = camera.ray((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            range.along(scene, &ray).map(|(far, near)| (ray, far, near))
        };
        let ends: Vec<_> = (0..width * height).map(ends).collect();
        // One plane for each pixel that a point moves in another view, extrapolated from the farthest of the max number
        // of steps: nearer points may lie outside of that view or behind it.
        let moves = |&(ray, far, near): &(Ray, f32, f32), other: &Camera| {
            let step = (near - far) / (MAX_PLANES - 1) as f32;
            let [a, b] = [far, far + step].map(|disparity| other.project(ray.at(1.0 / disparity)));
            a.zip(b).map_or(0.0, |(a, b)| a.distance(b))
        };
        let some = ends.iter().step_by((width * height / 64).max(1)).flatten();
        let longest = some.flat_map(|ends| others.iter().map(move |(_, other)| moves(ends, other))).fold(0.0, f32::max);
        let planes = (longest.min(1.0) * MAX_PLANES as f32).ceil().max(MIN_PLANES as f32) as usize;
        let spread = |(ray, far, near)| RayPlanes { ray, far, step: (near - far) / (planes - 1) as f32 };
        Self { width, height, planes, rays: ends.into_iter().map(|ends| ends.map(spread)).collect() }
    }

    /// Returns the cost of each plane at each pixel, `[pixels × planes]`, 0 to 1: `(1 − NCC)/2`, mean over the better half of the
    /// views, since others may not see the surface.
    pub(crate) fn costs(&self, picture: &GreyImage, others: &[(&GreyImage, &Camera)]) -> Vec<f32> {
        let windows = Windows::new(picture, HALF_WINDOW);
        let projections: Vec<PointProjection> = others.iter().map(|(_, camera)| PointProjection::new(camera)).collect();
        let of_plane = |plane: usize| {
            let correlation = |(projection, (image, _)): (&PointProjection<'_>, &(&GreyImage, &Camera))| {
                windows.correlation(&self.warped(plane, image, projection))
            };
            let correlations: Vec<Vec<f32>> = projections.iter().zip(others).map(correlation).collect();
            let mut found = Vec::with_capacity(others.len());
            let cost = |i: usize| {
                found.clear();
                found.extend(correlations.iter().map(|values| values[i]).filter(|value| !value.is_nan()));
                if found.is_empty() {
                    return UNSEEN_COST;
                }
                found.sort_by(|a, b| b.total_cmp(a));
                let best = &found[..found.len().div_ceil(2)];
                0.5 * (1.0 - best.iter().sum::<f32>() / best.len() as f32).clamp(0.0, 2.0)
            };
            (0..self.rays.len()).map(cost).collect::<Vec<f32>>()
        };
        let planes: Vec<Vec<f32>> = (0..self.planes).into_par_iter().map(of_plane).collect();
        (0..self.rays.len()).flat_map(|i| planes.iter().map(move |plane| plane[i])).collect()
    }

    /// Samples `image` where the pixels' rays meet a plane; NaN outside of it.
    fn warped(&self, plane: usize, image: &GreyImage, camera: &PointProjection<'_>) -> Vec<f32> {
        let value = |planes: &Option<RayPlanes>| {
            let meets = |RayPlanes { ray, far, step }: RayPlanes| ray.at(1.0 / (far + plane as f32 * step));
            let place = planes.and_then(|planes| camera.place(meets(planes)));
            place.map_or(f32::NAN, |place| image.sample(place.x, place.y))
        };
        self.rays.iter().map(value).collect()
    }

    /// Converts labels, which are planes and fractions between them, to a depth map.
    pub(crate) fn depths(&self, labels: &[f32]) -> DepthMap {
        let of_ray = |(planes, label): (&Option<RayPlanes>, &f32)| {
            planes.map_or((f32::NAN, f32::NAN), |RayPlanes { far, step, .. }| (far + label * step, step))
        };
        let (disparity, step) = self.rays.iter().zip(labels).map(of_ray).unzip();
        DepthMap { width: self.width, height: self.height, disparity, step }
    }
}

/// Projection of many points by one camera, as [`Camera::project`] computes it.
struct PointProjection<'a> {
    camera: &'a Camera,
    to_camera: Mat4,
}

impl<'a> PointProjection<'a> {
    fn new(camera: &'a Camera) -> Self {
        Self { camera, to_camera: camera.to_world.inverse().as_mat4() }
    }

    fn place(&self, p: Vec3) -> Option<Vec2> {
        let camera = self.camera;
        if !camera.lens.is_perspective() {
            return camera.project(p);
        }
        let p = self.to_camera.transform_point3(p);
        let place = Vec2::new(camera.fx as f32 * p.x, -camera.fy as f32 * p.y) / -p.z;
        (p.z < 0.0).then_some(place + Vec2::new(camera.cx as f32, camera.cy as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat4, DQuat, DVec3};

    #[test]
    fn projections_are_those_of_the_camera() {
        let pose = DMat4::from_rotation_translation(DQuat::from_rotation_y(0.7), DVec3::new(1.0, 2.0, 3.0));
        let camera = Camera::from_fov(40, 30, 1.0, pose);
        let projection = PointProjection::new(&camera);
        for p in [Vec3::new(-1.0, 1.5, -2.0), Vec3::new(-4.0, 2.5, 0.0), Vec3::new(3.0, 1.0, 6.0)] {
            let (found, want) = (projection.place(p), camera.project(p));
            assert_eq!(found.is_some(), want.is_some());
            assert!(found.zip(want).is_none_or(|(found, want)| found.distance(want) < 1e-3), "{found:?} {want:?}");
        }
    }
}
