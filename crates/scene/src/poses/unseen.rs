use glam::{DMat4, DVec3};
use rand::Rng;

use super::cap::{Cap, angle};
use super::centre::{FORWARD_FACING, Focus, scene_focus, up_direction};
use crate::camera::{Camera, look_along};

/// Directions closer than this, in radians, count as one.
const SAME: f64 = 1e-6;
/// Number of draws from the cap before a sample falls back to an arc.
const TRIES: usize = 64;

/// The part of the sphere about a scene's centre that a set of cameras spans.
///
/// The centre is the point nearest to all optical axes. A camera's direction is from the centre back
/// along its optical axis (along the view, where the cameras look outwards from within). From these
/// directions `uᵢ` and the distances `rᵢ` of the cameras from the centre:
///
/// - three or more distinct directions span the smallest *cap* that holds them, less what lies
///   lower than the lowest of them: cameras above a table do not look up through it;
/// - two span the *arc* between them;
/// - one camera, or identical ones, span that one direction.
///
/// A sample is uniform by area on the cap (by angle on the arc), its radius uniform in `[min rᵢ, max rᵢ]`, and it looks
/// at the centre (away from it, for outward cameras), level with the up direction that the cameras share.
#[derive(Clone, Debug)]
pub struct ViewRegion {
    pub(super) focus: Focus,
    /// The up direction that the cameras share, unit length.
    pub(super) up: DVec3,
    /// Whether there is more than one camera.
    several: bool,
    /// The distinct directions of the cameras from the centre, unit vectors.
    pub(super) directions: Vec<DVec3>,
    /// The smallest cap that holds the directions.
    pub(super) cap: Cap,
    radii: (f64, f64),
    lowest: f64,
}

impl ViewRegion {
    /// Returns the region that `cameras` span. Without cameras: the unit sphere's top, looking down.
    pub fn new(cameras: &[Camera]) -> Self {
        let focus = scene_focus(cameras);
        let up = up_direction(cameras);
        let mut directions: Vec<DVec3> = Vec::new();
        for direction in cameras.iter().map(|c| focus.direction(c)) {
            if directions.iter().all(|&d| angle(d, direction) > SAME) {
                directions.push(direction);
            }
        }
        if directions.is_empty() {
            directions.push(up);
        }
        let distances = cameras.iter().map(|c| c.position_f64().distance(focus.centre));
        let radii = distances.map(|r| (r, r)).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or((1.0, 1.0));
        let lowest = directions.iter().map(|d| d.dot(up)).fold(f64::INFINITY, f64::min);
        let cap = Cap::enclosing(&directions, up);
        Self { focus, up, several: cameras.len() > 1, directions, cap, radii, lowest }
    }

    /// Returns the point nearest to all optical axes.
    pub fn centre(&self) -> DVec3 {
        self.focus.centre
    }

    /// Whether there are several cameras that all face one way, as in a forward-facing capture.
    pub(crate) fn faces_forward(&self) -> bool {
        self.several && self.cap.half_angle < FORWARD_FACING
    }

    /// Returns the min and max distance of a camera from the centre.
    pub fn radii(&self) -> (f64, f64) {
        self.radii
    }

    /// Returns a random camera-to-world pose in the region. Regions of cameras that span nothing (one camera, identical or
    /// parallel ones, or that look away from each other) still give a proper pose.
    pub fn sample(&self, rng: &mut impl Rng) -> DMat4 {
        let direction = self.sample_direction(rng);
        let radius = self.radii.0 + rng.random::<f64>() * (self.radii.1 - self.radii.0);
        self.pose(direction, radius)
    }

    /// Returns the pose in `direction` (unit length) from the centre at distance `radius`.
    pub(crate) fn pose(&self, direction: DVec3, radius: f64) -> DMat4 {
        let forward = if self.focus.inward { -direction } else { direction };
        look_along(self.focus.centre + radius * direction, forward, self.up)
    }

    fn sample_direction(&self, rng: &mut impl Rng) -> DVec3 {
        let tries = if self.directions.len() > 2 { TRIES } else { 0 };
        let mut drawn = (0..tries).map(|_| self.cap.sample(rng));
        if let Some(direction) = drawn.find(|direction| direction.dot(self.up) >= self.lowest) {
            return direction;
        }
        let i = rng.random_range(0..self.directions.len());
        let j = if self.directions.len() == 2 { 1 - i } else { rng.random_range(0..self.directions.len()) };
        slerp(self.directions[i], self.directions[j], rng.random())
    }
}

/// Returns the direction a share `s` of the way along the arc from `a` to `b`, an arbitrary one if they are opposite.
fn slerp(a: DVec3, b: DVec3, s: f64) -> DVec3 {
    let side = (b - a * a.dot(b)).normalize_or(a.any_orthonormal_vector());
    let part = s * angle(a, b);
    (part.cos() * a + part.sin() * side).normalize_or(a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{level_camera as camera, train_cameras};
    use glam::DMat3;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn assert_rigid(pose: DMat4) {
        let r = DMat3::from_mat4(pose);
        assert!(pose.is_finite() && (r.determinant() - 1.0).abs() < 1e-9, "{pose}");
        assert!((r * r.transpose() - DMat3::IDENTITY).abs_diff_eq(DMat3::ZERO, 1e-9));
    }

    #[test]
    fn stays_in_the_cap_above_the_lowest_and_looks_at_the_centre() {
        let all = train_cameras();
        for ids in [vec![26, 86, 2, 55], vec![80, 84, 33, 81], (0..100).collect()] {
            let train: Vec<_> = ids.iter().map(|&i: &usize| all[i].clone()).collect();
            let region = ViewRegion::new(&train);
            let lowest = train.iter().map(|c| c.position().z).fold(f32::INFINITY, f32::min);
            let mut rng = ChaCha8Rng::seed_from_u64(7);
            for _ in 0..500 {
                let pose = region.sample(&mut rng);
                assert_rigid(pose);
                let camera = all[0].with_pose(pose);
                let to_centre = (region.centre() - camera.position_f64()).normalize();
                assert!(angle(to_centre, camera.forward_f64()) < 1e-6);
                assert!(angle(region.cap.axis, -to_centre) <= region.cap.half_angle + 1e-9);
                assert!(camera.position().z >= lowest - 1e-3);
                assert!((camera.position_f64().length() - 4.0311).abs() < 1e-3);
                assert!(pose.y_axis.z >= -1e-3, "upright");
            }
        }
    }

    #[test]
    fn two_cameras_span_an_arc() {
        let train = [camera(DVec3::X * 2.0, DVec3::NEG_X), camera(DVec3::Y * 4.0, DVec3::NEG_Y)];
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        for _ in 0..100 {
            let p = ViewRegion::new(&train).sample(&mut rng).w_axis;
            assert!(p.z.abs() < 1e-9 && p.x >= -1e-9 && p.y >= -1e-9);
            assert!((2.0 - 1e-6..=4.0 + 1e-6).contains(&p.truncate().length()));
        }
    }

    #[test]
    fn one_camera_gives_its_own_position() {
        let train = vec![camera(DVec3::new(0.0, -4.0, 1.0), DVec3::new(0.0, 4.0, -1.0)); 3];
        for n in [1, 3] {
            let pose = ViewRegion::new(&train[..n]).sample(&mut ChaCha8Rng::seed_from_u64(0));
            assert!((pose.w_axis - train[0].to_world.w_axis).length() < 1e-6);
            assert!((pose - train[0].to_world).abs_diff_eq(DMat4::ZERO, 1e-6));
        }
        assert_rigid(ViewRegion::new(&[]).sample(&mut ChaCha8Rng::seed_from_u64(0)));
        // Straight down, and two cameras that face each other or look away from each other.
        let pair = |sign: f64| vec![camera(DVec3::X, DVec3::X * sign), camera(DVec3::NEG_X, DVec3::X * -sign)];
        for cameras in [vec![camera(DVec3::Z, DVec3::NEG_Z)], pair(-1.0), pair(1.0)] {
            assert_rigid(ViewRegion::new(&cameras).sample(&mut ChaCha8Rng::seed_from_u64(0)));
        }
    }

    proptest! {
        #[test]
        fn any_cameras_give_a_proper_pose(
            seeds in prop::collection::vec((prop::array::uniform3(-3.0f64..3.0),
                prop::array::uniform3(-1.0f64..1.0)), 0..6),
            seed: u64,
        ) {
            let train: Vec<_> = seeds.iter().map(|(p, d)| camera((*p).into(), (*d).into())).collect();
            assert_rigid(ViewRegion::new(&train).sample(&mut ChaCha8Rng::seed_from_u64(seed)));
        }
    }
}
