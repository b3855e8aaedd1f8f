//! Relative poses of two photographs, and matches that agree with them.

use glam::{DMat3, DVec2, DVec3};
use infonerf_scene::image::GreyImage;
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use crate::bundle::{Adjustment, Bundle, Point, Prior};
use crate::camera::{Pose, SimpleRadial, angle, triangulate};
use crate::essential::{five_point, poses, sampson};
use crate::matching::{MIN_MATCHES, Matches, matches_of_pairs};
use crate::ransac::Ransac;
use crate::reconstruction::TOLERANCE;
use crate::sift::{Features, features};

const SAMPLES: usize = 2000;
/// Max number of samples of four matches for a homography.
const HOMOGRAPHIES: usize = 300;

pub(crate) struct TwoView {
    /// Pose of the second camera; the first is at the origin, the distance between them 1.
    pub(crate) pose: Pose,
    /// Indices of the matches that agree.
    pub(crate) inliers: Vec<usize>,
    /// Angles between both cameras' rays to each inlier's point, in radians.
    pub(crate) angles: Vec<f64>,
    /// Share of the inliers that one homography explains as well; high if the camera was only turned or the scene is flat.
    pub(crate) homography_share: f64,
}

/// Pairs of photographs with only those matches that agree on a relative pose.
type Verified = Vec<(Matches, TwoView)>;

/// Returns the pairs of photographs of which [`MIN_MATCHES`] matches or more agree on a relative pose.
pub(crate) fn verified(features: &[Features], matched: &[Matches], lens: &SimpleRadial, tolerance: f64) -> Verified {
    let verified = |matches: &Matches| {
        let &Matches { a, b, ref pairs } = matches;
        let view = two_view(&pixels(features, matches), lens, tolerance, (a as u64) << 32 | b as u64)?;
        let pairs: Vec<(usize, usize)> = view.inliers.iter().map(|&i| pairs[i]).collect();
        (pairs.len() >= MIN_MATCHES).then_some((Matches { a, b, pairs }, view))
    };
    matched.par_iter().filter_map(verified).collect()
}

fn pixels(features: &[Features], Matches { a, b, pairs }: &Matches) -> Vec<(DVec2, DVec2)> {
    pairs.iter().map(|(i, j)| (features[*a].pixels[*i], features[*b].pixels[*j])).collect()
}

/// Returns the relative pose on which most `matches` (pixels in both photographs) agree within `tolerance` pixels.
/// `None` if no five of them give one.
pub(crate) fn two_view(matches: &[(DVec2, DVec2)], lens: &SimpleRadial, tolerance: f64, seed: u64) -> Option<TwoView> {
    let rays: Vec<(DVec2, DVec2)> = matches.iter().map(|(a, b)| (lens.unproject(*a), lens.unproject(*b))).collect();
    let threshold = (tolerance / lens.focal).powi(2);
    let ransac = Ransac { threshold, max_samples: SAMPLES, seed };
    let solve = |sample: [usize; 5]| five_point(sample.map(|i| rays[i]));
    let (essential, inliers) = ransac.run(rays.len(), solve, |e, i| sampson(e, rays[i]))?;
    let in_front = |pose: &Pose| inliers.iter().filter(|&&i| point(pose, rays[i]).is_some()).count();
    let pose = poses(&essential).into_iter().max_by_key(in_front)?;
    let points = inliers.iter().filter_map(|&i| {
        let seen = vec![(0, matches[i].0), (1, matches[i].1)];
        Some(Point { position: point(&pose, rays[i])?, seen })
    });
    let mut bundle = Bundle { lens: *lens, poses: vec![Pose::IDENTITY, pose], points: points.collect() };
    let (prior, scale) = (Prior::fixed(lens), 0.5 * tolerance);
    bundle.adjust(&Adjustment { prior, poses: None, points: true, scale, steps: 10 });
    let adjusted = relative([&bundle.poses[0], &bundle.poses[1]]);
    let translation = adjusted.translation.try_normalize().unwrap_or(pose.translation);
    let pose = Pose { translation, ..adjusted };
    let essential = cross(pose.translation) * pose.rotation;
    let centres = [DVec3::ZERO, pose.centre()];
    let agreeing = |i: usize| {
        let near = sampson(&essential, rays[i]) < threshold;
        near.then(|| point(&pose, rays[i])).flatten().map(|p| (i, angle(p, &centres)))
    };
    let (inliers, angles): (Vec<usize>, Vec<f64>) = (0..rays.len()).filter_map(agreeing).unzip();
    let agreed: Vec<(DVec2, DVec2)> = inliers.iter().map(|&i| rays[i]).collect();
    Some(TwoView { pose, inliers, angles, homography_share: homography_share(&agreed, threshold, seed) })
}

/// Returns the share of `rays` that the best homography maps to the second camera with squared errors below `threshold`. The best
/// one from four matches is fitted to all matches that agree with it, as errors of four matches grow away from them.
fn homography_share(rays: &[(DVec2, DVec2)], threshold: f64, seed: u64) -> f64 {
    let ransac = Ransac { threshold, max_samples: HOMOGRAPHIES, seed };
    let solve = |sample: [usize; 4]| homography(&sample.map(|i| rays[i])).into_iter().collect();
    let error = |h: &DMat3, i: usize| {
        let (from, to) = rays[i];
        let at = *h * from.extend(1.0);
        if at.z.abs() < 1e-12 { f64::INFINITY } else { (at.truncate() / at.z).distance_squared(to) }
    };
    let Some((_, inliers)) = ransac.run(rays.len(), solve, error) else { return 0.0 };
    let agreed: Vec<(DVec2, DVec2)> = inliers.iter().map(|&i| rays[i]).collect();
    let fitted = homography(&agreed).map_or(0, |h| (0..rays.len()).filter(|&i| error(&h, i) < threshold).count());
    fitted.max(inliers.len()) as f64 / rays.len() as f64
}

/// Solves for the homography that takes first points to their second ones, `h₃₃ = 1`, by least squares; `None` if degenerate.
fn homography(pairs: &[(DVec2, DVec2)]) -> Option<DMat3> {
    let (mut a, mut b) = (SMatrix::<f64, 8, 8>::zeros(), SVector::<f64, 8>::zeros());
    for &(from, to) in pairs {
        let (x, y) = (from.x, from.y);
        for (row, value) in [
            ([x, y, 1.0, 0.0, 0.0, 0.0, -x * to.x, -y * to.x], to.x),
            ([0.0, 0.0, 0.0, x, y, 1.0, -x * to.y, -y * to.y], to.y),
        ] {
            let row = SVector::<f64, 8>::from(row);
            a += row * row.transpose();
            b += row * value;
        }
    }
    let h = a.cholesky()?.solve(&b);
    let matrix = DMat3::from_cols_array(&[h[0], h[1], h[2], h[3], h[4], h[5], h[6], h[7], 1.0]).transpose();
    matrix.is_finite().then_some(matrix)
}

/// Triangulates the point that both cameras see, if it is in front of them.
fn point(pose: &Pose, (a, b): (DVec2, DVec2)) -> Option<DVec3> {
    triangulate(&[(Pose::IDENTITY, a), (*pose, b)])
}

/// Returns the pose of the second camera in the axes of the first.
pub(crate) fn relative([a, b]: [&Pose; 2]) -> Pose {
    let rotation = b.rotation * a.rotation.transpose();
    Pose { rotation, translation: b.translation - rotation * a.translation }
}

/// Returns the matrix of `x ↦ v × x`.
pub(crate) fn cross(v: DVec3) -> DMat3 {
    DMat3::from_cols(v.cross(DVec3::X), v.cross(DVec3::Y), v.cross(DVec3::Z))
}

/// Focal lengths, divided by the longer side, with which matches are verified in addition to the given ones.
const FOCAL_LENGTHS: [f64; 3] = [0.7, 1.1, 1.8];
/// Min share of a pair's matches that agree on a relative pose; pairs with fewer are left out.
const AGREEING: f64 = 0.5;

/// Pixels of two images that show the same points.
#[derive(Clone, Debug)]
pub struct ImageMatches {
    /// Index of the first image.
    pub a: usize,
    /// Index of the second image.
    pub b: usize,
    /// Positions in the first and the second image.
    pub pixels: Vec<(DVec2, DVec2)>,
}

/// Matches all pairs of `images`, with at most `max_features` features each, and keeps the matches of a pair that agree with
/// one relative pose, estimated from them alone. `focal` has the assumed focal lengths of the cameras in pixels.
pub fn verified_matches(images: &[GreyImage], focal: &[f64], max_features: usize) -> Vec<ImageMatches> {
    let found: Vec<Features> = images.par_iter().map(|image| features(image, None, max_features)).collect();
    let verify = |matches: &Matches| {
        let &Matches { a, b, .. } = matches;
        let size = DVec2::new(images[a].width as f64, images[a].height as f64);
        let (longer, pixels) = (size.max_element(), pixels(&found, matches));
        let inliers = |focal: f64| {
            let lens = SimpleRadial { focal, k1: 0.0, centre: 0.5 * size };
            two_view(&pixels, &lens, TOLERANCE * longer, 0).map_or(Vec::new(), |view| view.inliers)
        };
        let guesses = FOCAL_LENGTHS.map(|times| times * longer);
        let best = [focal[a]].into_iter().chain(guesses).map(inliers).max_by_key(Vec::len)?;
        let agree = best.len() as f64 >= AGREEING * pixels.len() as f64;
        agree.then(|| ImageMatches { a, b, pixels: best.iter().map(|&i| pixels[i]).collect() })
    };
    matches_of_pairs(&found).par_iter().filter_map(verify).collect()
}

/// Whether two cameras see one point in front of them along `rays`, `(x, y, 1)`, up to Sampson's distance of `tolerance`.
pub fn explains(poses: [&Pose; 2], rays: (DVec2, DVec2), tolerance: f64) -> bool {
    let pose = relative(poses);
    sampson(&(cross(pose.translation) * pose.rotation), rays) < tolerance.powi(2) && point(&pose, rays).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{disturb, turn, world};

    /// Moves one end of two in five matches to a random pixel.
    #[test]
    fn outliers_do_not_turn_the_pose() {
        let mut all = world(2, 3, 200);
        let exact = relative([&all.poses[0], &all.poses[2]]);
        let shift = exact.translation.normalize();
        all.points.iter_mut().for_each(|p| p.seen = vec![p.seen[0], p.seen[2]]);
        disturb(&mut all.points, 0.5, 5);
        let matches: Vec<_> = all.points.iter().map(|p| (p.seen[0].1, p.seen[1].1)).collect();
        let found = two_view(&matches, &all.lens, 2.0, 0).unwrap();
        assert!(turn(&found.pose.rotation, &exact.rotation) < 0.2 && found.pose.translation.distance(shift) < 0.02);
        let right = found.inliers.iter().filter(|&&i| (2 * i + 1) % 5 != 0 && (2 * i + 2) % 5 != 0).count();
        assert!(right >= 115 && found.inliers.len() - right < 15, "{right}");
        let again = two_view(&matches, &all.lens, 2.0, 0).unwrap();
        assert_eq!((again.pose, &again.inliers), (found.pose, &found.inliers));
        assert!(two_view(&matches[..4], &all.lens, 2.0, 0).is_none());
        assert!(found.homography_share < 0.5, "{}", found.homography_share);
        let seen = |of: fn(&(DVec2, DVec2)) -> DVec2| matches.iter().map(of).collect();
        let photographs: [Vec<DVec2>; 2] = [seen(|ends| ends.0), seen(|ends| ends.1)];
        let features = photographs.map(|pixels| Features { pixels, ..Features::default() });
        let matched = Matches { a: 0, b: 1, pairs: (0..matches.len()).map(|i| (i, i)).collect() };
        let kept = verified(&features, &[matched], &all.lens, 2.0);
        let [(kept, _)] = &kept[..] else { panic!("{} pairs", kept.len()) };
        assert!(kept.pairs.len().abs_diff(found.inliers.len()) < 5, "{}", kept.pairs.len());
    }

    #[test]
    fn a_camera_that_only_turns_shows_no_depth() {
        let all = world(2, 1, 100);
        let turned = all.poses[0].moved(DVec3::new(0.02, 0.15, 0.01), DVec3::ZERO);
        let turned = Pose { translation: turned.rotation * -all.poses[0].centre(), ..turned };
        let ray = |pose: &Pose, point: DVec3| all.lens.unproject(all.lens.project(pose.transform(point)).unwrap());
        let rays = |second: &Pose| -> Vec<(DVec2, DVec2)> {
            all.points.iter().map(|p| (ray(&all.poses[0], p.position), ray(second, p.position))).collect()
        };
        let moved = turned.moved(DVec3::ZERO, DVec3::X);
        let threshold = (2.0 / all.lens.focal).powi(2);
        let [flat, deep] = [turned, moved].map(|second| homography_share(&rays(&second), threshold, 0));
        assert!(flat > 0.99 && deep < 0.5, "{flat} {deep}");
        // Errors of features, 0.4 thresholds each.
        let off = |(i, rays): (u16, (DVec2, DVec2))| (rays.0, rays.1 + 9e-4 * DVec2::from_angle(f64::from(7 * i)));
        let noisy: Vec<(DVec2, DVec2)> = (0..).zip(rays(&turned)).map(off).collect();
        assert!((0..20).all(|seed| homography_share(&noisy, threshold, seed) > 0.99));
    }

    #[test]
    fn true_poses_explain_what_is_seen_and_others_do_not() {
        let all = world(3, 2, 60);
        let ray = |point: &Point, k: usize| all.lens.unproject(point.seen[k].1);
        let share = |poses: [&Pose; 2]| {
            all.points.iter().filter(|point| explains(poses, (ray(point, 0), ray(point, 1)), 1e-3)).count()
        };
        let [a, b] = [&all.poses[0], &all.poses[1]];
        assert_eq!(share([a, b]), 60);
        let flip = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let flipped = [a, b].map(|pose| Pose { rotation: flip * pose.rotation, translation: flip * pose.translation });
        assert!(share([&flipped[0], &flipped[1]]) < 15 && share([b, a]) < 15);
    }
}
