//! Choice of the views that a view is compared with.

use glam::Vec3;
use infonerf_scene::{Camera, Layout, Scene};

use crate::Disparities;

/// The angle between two lines of sight that shows depth best: less shows little, more shows different sides (MVSNet,
/// Yao et al. 2018, Sec. 4.1).
const BEST_ANGLE_DEG: f32 = 5.0;
/// Largest angle at which windows look alike.
const MAX_ANGLE_DEG: f32 = 45.0;

/// Returns at most `count` cameras other than `view`, the best first.
pub(crate) fn of(scene: &Scene, cameras: &[Camera], view: usize, count: usize, within: Disparities) -> Vec<usize> {
    let camera = &cameras[view];
    let Some(point) = middle(scene, camera, within) else { return Vec::new() };
    let sight = |camera: &Camera| (point - camera.position()).normalize_or_zero();
    let mut scored: Vec<(f32, usize)> = (0..cameras.len())
        .filter(|&other| other != view && cameras[other].project(point).is_some())
        .map(|other| (sight(camera).angle_between(sight(&cameras[other])).to_degrees(), other))
        .filter(|(angle, _)| *angle <= MAX_ANGLE_DEG)
        .map(|(angle, other)| (score(angle), other))
        .collect();
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    scored.truncate(count);
    scored.into_iter().map(|(_, other)| other).collect()
}

/// Returns the point that `camera` looks at: on its middle ray, as far away as the scene's centre if the cameras surround an
/// object, else at the geometric mean of the disparities within range.
fn middle(scene: &Scene, camera: &Camera, within: Disparities) -> Option<Vec3> {
    let ray = camera.ray(camera.width as f32 / 2.0, camera.height as f32 / 2.0);
    let (far, near) = within.along(scene, &ray)?;
    let distance = match scene.space.layout {
        Layout::Object => scene.space.centre.distance(ray.origin).clamp(1.0 / near, 1.0 / far),
        Layout::Forward | Layout::Inside => 1.0 / (near * far).sqrt(),
    };
    Some(ray.at(distance))
}

fn score(angle: f32) -> f32 {
    let spread = if angle < BEST_ANGLE_DEG { 1.0 } else { 10.0 };
    (-0.5 * ((angle - BEST_ANGLE_DEG) / spread).powi(2)).exp()
}
