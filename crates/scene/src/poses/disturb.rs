use glam::{DMat3, DMat4, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::scene::Scene;

impl Scene {
    /// Returns the scene with disturbed training cameras: each is rotated by `degrees` about a random axis through its
    /// centre, and moved in a random direction by `distance` times its distance from the scene's centre. The exact
    /// cameras are kept in [`Scene::exact_cameras`]. Test views and the space do not change.
    #[must_use]
    pub fn disturbed(mut self, degrees: f64, distance: f64, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let centre = self.space.centre.as_dvec3();
        self.exact_cameras = Some(self.training_cameras());
        for view in &mut self.train {
            let position = view.camera.position_f64();
            let turn = DMat3::from_axis_angle(direction(&mut rng), degrees.to_radians());
            let moved = position + distance * position.distance(centre) * direction(&mut rng);
            let pose = DMat4::from_translation(moved) * DMat4::from_mat3(turn * view.camera.rotation());
            view.camera = view.camera.with_pose(pose);
        }
        self
    }
}

/// Returns a unit vector, uniform over the sphere.
fn direction(rng: &mut impl Rng) -> DVec3 {
    let z = rng.random_range(-1.0..=1.0f64);
    let (sine, cosine) = rng.random_range(0.0..std::f64::consts::TAU).sin_cos();
    let radius = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(radius * cosine, radius * sine, z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::image::Image;
    use crate::poses::rotation_angle_deg;
    use crate::scene::View;
    use crate::testing::train_cameras;

    #[test]
    fn each_training_camera_is_turned_and_moved_by_as_much() {
        let exact = train_cameras();
        let view = |camera: &Camera| View::new(0, "a", camera.clone(), Image::filled(1, 1, [0.0; 3]));
        let scene = Scene { train: exact.iter().map(view).collect(), ..Scene::default() };
        let disturbed = scene.clone().disturbed(2.0, 0.03, 7);
        assert_eq!(disturbed, scene.disturbed(2.0, 0.03, 7));
        assert_eq!(disturbed.exact_cameras.as_ref(), Some(&exact));
        for (view, exact) in disturbed.train.iter().zip(&exact) {
            let turn = rotation_angle_deg(&view.camera.rotation(), &exact.rotation());
            assert!((turn - 2.0).abs() < 1e-6);
            let moved = view.camera.position_f64().distance(exact.position_f64());
            assert!((moved / exact.position_f64().length() - 0.03).abs() < 1e-9);
        }
    }
}
