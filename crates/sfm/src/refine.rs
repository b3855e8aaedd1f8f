//! Refinement of roughly known cameras by points that their photographs share.

use std::f64::consts::SQRT_2;

use glam::{DQuat, DVec2};
use infonerf_scene::View;
use infonerf_scene::image::GreyImage;
use rayon::prelude::*;

use crate::bundle::{Point, PosePrior, Prior};
use crate::camera::{Pose, SimpleRadial, ray, triangulate};
use crate::mapper::Mapper;
use crate::matching::{matches_of_pairs, tracks};
use crate::reconstruction::{FEATURES, SparseModel, TOLERANCE};
use crate::sift::{Features, LENGTH, features};
use crate::two_view::{relative, verified};

/// Min tolerance of reprojection errors in pixels.
const MIN_TOLERANCE: f64 = 1.0;

/// Uncertainty of cameras: deviations of normal distributions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uncertainty {
    /// Deviation of orientations, in radians.
    pub turn: f64,
    /// Deviation of positions, in units of the world.
    pub shift: f64,
    /// Deviation of the logarithm of one factor by which all focal lengths are off; 0 if they are exact.
    pub focal: f64,
}

/// Max difference of a relative pose from the given one, in deviations: repetitive textures agree on wrong poses.
const MAX_DEVIATIONS: f64 = 4.0;

impl Uncertainty {
    /// Returns whether the relative pose `found` is within [`MAX_DEVIATIONS`] of the relative pose of `given`, in
    /// rotation and in direction of the translation. The length of its translation is unknown.
    fn allows(&self, found: &Pose, given: [Pose; 2]) -> bool {
        let Pose { rotation, translation } = relative([&given[0], &given[1]]);
        let turned = DQuat::from_mat3(&found.rotation).angle_between(DQuat::from_mat3(&rotation));
        let [turn, shift] = [self.turn, self.shift].map(|of_one| SQRT_2 * of_one);
        turned <= MAX_DEVIATIONS * turn
            && found.translation.angle_between(translation) <= MAX_DEVIATIONS * (turn + shift / translation.length())
    }
}

/// Refined cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// Pose of each photograph, or the reason why it keeps the given one.
    pub poses: Vec<Result<Pose, String>>,
    /// Ratio of refined to given focal lengths.
    pub focal: f64,
    /// Points that two or more photographs see.
    pub points: Vec<Point>,
    /// Median reprojection errors in pixels of the given and the refined cameras, which triangulate the points anew.
    pub errors: [f64; 2],
}

/// Adjusts the cameras of `views` and the points that they share, starting at the given poses. A prior with
/// `uncertainty` keeps what matches leave open. Errors are in pixels of a camera with about the focal length `focal`.
pub fn refine(views: &[View], focal: f64, uncertainty: Uncertainty) -> Refined {
    let features: Vec<Features> = views.par_iter().map(|view| seen(view, focal)).collect();
    let longer = views.iter().map(|view| view.image.width.max(view.image.height)).max().unwrap_or(0);
    let tolerance = (TOLERANCE * f64::from(longer)).max(MIN_TOLERANCE);
    let lens = SimpleRadial { focal, k1: 0.0, centre: DVec2::ZERO };
    let poses: Vec<Pose> = views.iter().map(|view| Pose::of(&view.camera.to_world)).collect();
    let mut agreed = verified(&features, &matches_of_pairs(&features), &lens, tolerance);
    agreed.retain(|(matches, found)| uncertainty.allows(&found.pose, [poses[matches.a], poses[matches.b]]));
    let tracks = tracks(&features, agreed.iter().map(|(matches, _)| matches));
    let prior = Prior { focal, focal_deviation: uncertainty.focal, k1_deviation: 0.0 };
    let given: Vec<Result<Pose, String>> = poses.iter().copied().map(Ok).collect();
    let expected = PosePrior { poses, turn_deviation: uncertainty.turn, shift_deviation: uncertainty.shift };
    let SparseModel { lens: adjusted, poses, points } =
        Mapper::new(&tracks, given.clone(), (lens, prior), tolerance, Some(expected)).refine();
    let errors = [(lens, &given), (adjusted, &poses)].map(|(lens, poses)| median_error(&lens, poses, &points));
    Refined { focal: adjusted.focal / focal, poses, points, errors }
}

/// Returns the median reprojection error of `points`, triangulated by these cameras, in pixels. Points that they cannot
/// triangulate have an infinite error; without points it is 0.
fn median_error(lens: &SimpleRadial, poses: &[Result<Pose, String>], points: &[Point]) -> f64 {
    let errors_of = |point: &Point| -> Vec<f64> {
        let view = |&(i, pixel): &(usize, DVec2)| Some((*poses[i].as_ref().ok()?, pixel));
        let seen: Vec<(Pose, DVec2)> = point.seen.iter().filter_map(view).collect();
        let rays: Vec<(Pose, DVec2)> = seen.iter().map(|(pose, pixel)| (*pose, lens.unproject(*pixel))).collect();
        let place = triangulate(&rays);
        let falls = |pose: &Pose| place.and_then(|place| lens.project(pose.transform(place)));
        seen.iter().map(|(pose, pixel)| falls(pose).map_or(f64::INFINITY, |p| p.distance(*pixel))).collect()
    };
    let mut errors: Vec<f64> = points.iter().flat_map(errors_of).collect();
    errors.sort_unstable_by(f64::total_cmp);
    errors.get(errors.len() / 2).copied().unwrap_or(0.0)
}

/// Finds the features of a view at valid pixels, and converts them to a lens of focal length `focal` without distortion.
fn seen(view: &View, focal: f64) -> Features {
    let (width, height) = (view.image.width as usize, view.image.height as usize);
    let image = GreyImage::luma(width, height, view.image.rgb.iter().copied());
    let found = features(&image, view.valid.as_deref(), FEATURES);
    let mut seen = Features::default();
    for (pixel, descriptor) in found.pixels.iter().zip(found.descriptors.chunks_exact(LENGTH)) {
        if let Some(p) = ray(&view.camera, *pixel) {
            seen.pixels.push(focal * p);
            seen.descriptors.extend(descriptor);
        }
    }
    seen
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec3};

    use super::*;

    #[test]
    fn relative_poses_far_from_the_given_ones_are_refused() {
        let uncertainty = Uncertainty { turn: 0.035, shift: 0.1, focal: 0.0 };
        let turn = DMat3::from_rotation_y;
        let at = |turned, x| Pose { rotation: turn(turned), translation: DVec3::new(x, 0.2, 0.0) };
        let given = [at(0.3, 1.0), at(0.5, 3.0)];
        let exact = given[1].translation - turn(0.2) * given[0].translation;
        for (turned, direction, allowed) in
            [(0.0, 0.0, true), (0.15, 0.0, true), (-0.25, 0.0, false), (0.0, 0.3, true), (0.0, -0.8, false)]
        {
            let translation = (DMat3::from_rotation_z(direction) * exact).normalize();
            let found = Pose { rotation: turn(0.2 + turned), translation };
            assert_eq!(uncertainty.allows(&found, given), allowed, "{turned} {direction}");
        }
    }
}
