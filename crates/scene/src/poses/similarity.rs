//! Two sets of poses of the same cameras: how one frame maps to the other, and how far the poses are apart.

use glam::{DMat3, DMat4, DVec3, Vec3};

use super::outer;
use crate::camera::Camera;

/// A similarity of the world: `x ↦ s R x + t`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity {
    /// Rotation R.
    pub rotation: DMat3,
    /// Scale s > 0.
    pub scale: f64,
    /// Translation t.
    pub translation: DVec3,
}

impl Similarity {
    /// Returns the similarity that takes the poses `from` to the poses `to` of the same cameras (Procrustes):
    /// R is the rotation nearest to `Σ (c′ᵢ − c̄′)(cᵢ − c̄)ᵀ σ/(σ′d²) + Σ R′ᵢRᵢᵀ`, with the cameras' positions cᵢ, their mean c̄
    /// and root-mean-square distances σ from it and d from the scene's `centre` (in the world of `from`); then s and t are the
    /// least-squares fit of the positions (Umeyama 1991).
    ///
    /// With this weight, a rotation by an angle counts as much as a move by that angle seen from the centre: positions of
    /// cameras close together in front of a distant scene hardly determine a rotation. Orientations determine what one, two
    /// or collinear positions leave open. Cameras in one place have scale 1, and no cameras the identity.
    pub fn between(from: &[Camera], to: &[Camera], centre: DVec3) -> Self {
        if from.is_empty() {
            return Self { rotation: DMat3::IDENTITY, scale: 1.0, translation: DVec3::ZERO };
        }
        let [(mean, spread), (mean_to, spread_to)] = [from, to].map(|cameras| {
            let count = cameras.len() as f64;
            let mean = cameras.iter().map(Camera::position_f64).sum::<DVec3>() / count;
            let squares: f64 = cameras.iter().map(|camera| camera.position_f64().distance_squared(mean)).sum();
            (mean, (squares / count).sqrt())
        });
        let pairs = || from.iter().zip(to).map(|(a, b)| (a.position_f64() - mean, b.position_f64() - mean_to));
        let mut correlation: DMat3 = from.iter().zip(to).map(|(a, b)| b.rotation() * a.rotation().transpose()).sum();
        let scatter = spread * spread_to;
        if scatter > 0.0 {
            let distance2 = spread * spread + mean.distance_squared(centre);
            correlation += pairs().map(|(a, b)| outer(b, a)).sum::<DMat3>() * (spread / (spread_to * distance2));
        }
        let rotation = nearest_rotation(correlation);
        let along: f64 = pairs().map(|(a, b)| b.dot(rotation * a)).sum();
        let scale = if scatter > 0.0 && along > 0.0 { along / (spread * spread * from.len() as f64) } else { 1.0 };
        Self { rotation, scale, translation: mean_to - scale * (rotation * mean) }
    }

    /// Returns the inverse similarity.
    pub fn inverse(&self) -> Self {
        let (rotation, scale) = (self.rotation.transpose(), self.scale.recip());
        Self { rotation, scale, translation: -scale * (rotation * self.translation) }
    }

    /// Maps a point: `s R p + t`.
    pub fn point(&self, p: Vec3) -> Vec3 {
        (self.scale * (self.rotation * p.as_dvec3()) + self.translation).as_vec3()
    }

    /// Rotates a direction: `R d`.
    pub fn direction(&self, d: Vec3) -> Vec3 {
        (self.rotation * d.as_dvec3()).as_vec3()
    }

    /// Returns the mapped camera: its image of the mapped world is that of `camera` of the world.
    pub fn camera(&self, camera: &Camera) -> Camera {
        let rotation = self.rotation * camera.rotation();
        let position = self.scale * (self.rotation * camera.position_f64()) + self.translation;
        camera.with_pose(DMat4::from_translation(position) * DMat4::from_mat3(rotation))
    }
}

/// Errors of poses against the true ones, means over the cameras.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// Angle between the orientations, degrees.
    pub rotation_deg: f64,
    /// Distance between the positions, percent of the true camera's distance from the scene's centre.
    pub translation_percent: f64,
}

impl PoseError {
    /// Returns the error of the poses `found` against those of `truth`, after `found` are aligned with them
    /// ([`Similarity::between`]); `centre` is the scene's, in the world of `truth`.
    pub fn of(found: &[Camera], truth: &[Camera], centre: DVec3) -> Self {
        let similarity = Similarity::between(truth, found, centre).inverse();
        let errors = found.iter().zip(truth).map(|(found, truth)| {
            let aligned = similarity.camera(found);
            let moved = aligned.position_f64().distance(truth.position_f64());
            let turn = rotation_angle_deg(&aligned.rotation(), &truth.rotation());
            (turn, moved / truth.position_f64().distance(centre).max(1e-9))
        });
        let (rotation, translation) = errors.fold((0.0, 0.0), |sum, error| (sum.0 + error.0, sum.1 + error.1));
        let count = truth.len().max(1) as f64;
        Self { rotation_deg: rotation / count, translation_percent: 100.0 * translation / count }
    }
}

/// Returns the angle between two rotations, in degrees.
pub fn rotation_angle_deg(a: &DMat3, b: &DMat3) -> f64 {
    let turn = *a * b.transpose();
    (0.5 * (turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0)).clamp(-1.0, 1.0).acos().to_degrees()
}

/// Returns the orthogonal factor of the polar decomposition of a matrix of positive determinant, by Newton's iteration
/// `M ← (M + M⁻ᵀ)/2` (Higham 1986); the identity for any other matrix.
fn nearest_rotation(matrix: DMat3) -> DMat3 {
    if matrix.determinant() <= 1e-12 {
        return DMat3::IDENTITY;
    }
    (0..40).fold(matrix, |m, _| (m + m.inverse().transpose()) * 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::train_cameras;

    fn similarity() -> Similarity {
        let rotation = DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 1.1);
        Similarity { rotation, scale: 1.7, translation: DVec3::new(3.0, -0.2, 40.0) }
    }

    /// Includes few cameras, whose positions alone do not determine a rotation.
    #[test]
    fn a_similarity_of_cameras_is_found() {
        let cameras = train_cameras();
        for count in [8, 3, 2] {
            let from = &cameras[..count];
            let to: Vec<Camera> = from.iter().map(|camera| similarity().camera(camera)).collect();
            let found = Similarity::between(from, &to, DVec3::ZERO);
            let ahead = cameras[7].position_f64();
            let map = |s: Similarity| s.scale * (s.rotation * ahead) + s.translation;
            assert!(map(found).distance(map(similarity())) < 1e-9, "{count}: {found:?}");
            assert!(found.inverse().camera(&to[1]).position_f64().distance(from[1].position_f64()) < 1e-9);
            let error = PoseError::of(&to, from, DVec3::ZERO);
            assert!(error.rotation_deg < 1e-5 && error.translation_percent < 1e-9, "{error:?}");
        }
        let moved = [similarity().camera(&cameras[0])];
        assert_eq!(Similarity::between(&cameras[..1], &moved, DVec3::ZERO).scale, 1.0);
    }

    #[test]
    fn an_error_is_measured_by_hand() {
        let truth = train_cameras()[..8].to_vec();
        let mut found = truth.clone();
        // Opposite turns of two of eight cameras about their own axes move no frame: 4° · 2/8.
        for (camera, angle) in found.iter_mut().zip([4f64, -4.0]) {
            let turn = DMat3::from_axis_angle(truth[0].forward_f64(), angle.to_radians());
            let pose = DMat4::from_mat3(turn * camera.rotation());
            camera.to_world = DMat4::from_translation(camera.position_f64()) * pose;
        }
        let error = PoseError::of(&found, &truth, DVec3::ZERO);
        assert!((error.rotation_deg - 1.0).abs() < 0.05 && error.translation_percent < 0.1, "{error:?}");
    }

    /// Two cameras at `±e_x`, at `√2` from the centre, turn about z by 60° without turning themselves, and move apart:
    /// orientations add 2 to the correlation's diagonal, positions `(cos 60°, sin 60°) e_xᵀ`.
    #[test]
    fn positions_count_by_their_angle_seen_from_the_centre() {
        let camera = |position| Camera::from_fov(8, 8, 0.7, DMat4::from_translation(position));
        let (from, turned) =
            ([DVec3::X, DVec3::NEG_X], DVec3::new(60f64.to_radians().cos(), 60f64.to_radians().sin(), 0.0));
        let found = Similarity::between(&from.map(camera), &[turned, -turned].map(|p| camera(3.0 * p)), DVec3::NEG_Z);
        let angle = turned.y.atan2(4.0 + turned.x).to_degrees();
        let degrees = rotation_angle_deg(&found.rotation, &DMat3::IDENTITY);
        assert!((degrees - angle).abs() < 1e-6, "{degrees} {angle}");
    }
}
