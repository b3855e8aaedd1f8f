//! Incremental mapping (Snavely et al. 2006, Schönberger and Frahm 2016): from a pair of photographs to all that can be placed.

use glam::{DVec2, DVec3};

use crate::bundle::{Adjustment, Bundle, Point, PosePrior, Prior};
use crate::camera::{Pose, SimpleRadial, angle, triangulate};
use crate::matching::Track;
use crate::p3p::p3p;
use crate::ransac::Ransac;
use crate::reconstruction::SparseModel;

/// Min number of points that a photograph must see to be placed.
const MIN_POINTS: usize = 15;
/// Min number of points that a photograph whose pose was unknown must see in the end. Repeated structures explained 25 points of
/// a photograph from a pose that was off by 130°, while photographs with right poses saw 60 or more.
const CERTAIN_POINTS: usize = 30;
/// Min share of a photograph's matches with points that must agree on its pose.
const AGREEING: f64 = 0.25;
const SAMPLES: usize = 5000;
/// Min angle, in radians, between two rays to a point.
const MIN_ANGLE: f64 = 1.5 * std::f64::consts::PI / 180.0;
/// Max number of pairs of views from which a point is triangulated.
const TRIED: usize = 30;
/// Factors of the tolerance in successive adjustments of roughly known cameras.
const WIDENED: [f64; 6] = [32.0, 16.0, 8.0, 4.0, 2.0, 1.0];
const FOR_LENS: usize = 3;
/// Factor by which the number of placed photographs grows from one bundle adjustment to the next.
const GROWTH: f64 = 1.1;

pub(crate) struct Mapper<'a> {
    tracks: &'a [Track],
    /// Position of each track's point, if it has one.
    positions: Vec<Option<DVec3>>,
    poses: Vec<Result<Pose, String>>,
    lens: SimpleRadial,
    prior: Prior,
    expected: Option<PosePrior>,
    /// Max reprojection error in pixels.
    tolerance: f64,
}

impl<'a> Mapper<'a> {
    /// Makes a map from the photographs that have one of `poses`; `expected` is the prior of roughly known poses.
    pub(crate) fn new(
        tracks: &'a [Track],
        poses: Vec<Result<Pose, String>>,
        (lens, prior): (SimpleRadial, Prior),
        tolerance: f64,
        expected: Option<PosePrior>,
    ) -> Self {
        Self { tracks, positions: vec![None; tracks.len()], poses, lens, prior, expected, tolerance }
    }

    pub(crate) fn run(mut self) -> SparseModel {
        self.adjust_rounds(2);
        let mut placed_before = self.placed();
        loop {
            let is_growing = self.place_next();
            let placed = self.placed();
            if is_growing && (placed as f64) < GROWTH * placed_before as f64 {
                self.triangulate();
            } else if is_growing || placed_before < placed {
                self.adjust_rounds(1);
                placed_before = placed;
            } else {
                break;
            }
        }
        self.adjust_rounds(5);
        self.without_uncertain_poses(CERTAIN_POINTS)
    }

    /// Adjusts roughly known cameras; the tolerance of reprojection errors shrinks from wide to its normal value.
    pub(crate) fn refine(mut self) -> SparseModel {
        let tolerance = self.tolerance;
        for times in WIDENED {
            self.tolerance = times * tolerance;
            self.adjust_rounds(2);
        }
        self.adjust_rounds(5);
        self.without_uncertain_poses(MIN_POINTS)
    }

    /// Returns the map. Before, it removes the pose of the photograph that sees fewest points until each sees at least
    /// `needed`. Each removal also removes the points that only one placed photograph still sees.
    fn without_uncertain_poses(mut self, needed: usize) -> SparseModel {
        loop {
            let points: Vec<Point> = self.found().into_iter().map(|(_, point)| point).collect();
            let seen = || points.iter().flat_map(|point| &point.seen);
            let count = |photograph: usize| seen().filter(|(i, _)| *i == photograph).count();
            let placed = (0..self.poses.len()).filter(|&i| self.poses[i].is_ok());
            let fewest = placed.map(|i| (count(i), i)).min();
            let Some((count, photograph)) = fewest.filter(|(count, _)| *count < needed) else {
                return SparseModel { lens: self.lens, poses: self.poses, points };
            };
            self.poses[photograph] = Err(format!("{count} points seen, {needed} needed"));
        }
    }

    fn placed(&self) -> usize {
        self.poses.iter().flatten().count()
    }

    /// Returns points that two or more placed photographs see, with their tracks.
    fn found(&self) -> Vec<(usize, Point)> {
        let point = |i: usize| {
            let position = self.positions[i]?;
            let seen: Vec<_> = self.agreeing(i, position).map(|(i, _, pixel)| (i, pixel)).collect();
            (seen.len() > 1).then_some((i, Point { position, seen }))
        };
        (0..self.tracks.len()).filter_map(point).collect()
    }

    /// Returns the placed photographs in a track, with their poses and pixels.
    fn seen(&self, track: usize) -> Vec<(usize, Pose, DVec2)> {
        let view = |&(i, pixel): &(usize, DVec2)| Some((i, *self.poses[i].as_ref().ok()?, pixel));
        self.tracks[track].iter().filter_map(view).collect()
    }

    /// Returns whether the reprojection error of a point is below the tolerance.
    fn agrees(&self, pose: &Pose, position: DVec3, pixel: DVec2) -> bool {
        self.lens.project(pose.transform(position)).is_some_and(|p| p.distance(pixel) < self.tolerance)
    }

    /// Returns the placed photographs of a track with a small reprojection error of `position`, with their poses and pixels.
    fn agreeing(&self, track: usize, position: DVec3) -> impl Iterator<Item = (usize, Pose, DVec2)> {
        self.seen(track).into_iter().filter(move |(_, pose, pixel)| self.agrees(pose, position, *pixel))
    }

    fn triangulate(&mut self) {
        for track in 0..self.tracks.len() {
            self.positions[track] = self.positions[track].or_else(|| self.triangulated(track));
        }
    }

    /// Triangulates, adjusts, and removes points that then fit too few views, `rounds` times.
    fn adjust_rounds(&mut self, rounds: usize) {
        for _ in 0..rounds {
            self.triangulate();
            let (indices, points): (Vec<usize>, Vec<Point>) = self.found().into_iter().unzip();
            let poses = self.poses.iter().map(|pose| *pose.as_ref().unwrap_or(&Pose::IDENTITY)).collect();
            let prior = if self.placed() < FOR_LENS { Prior::fixed(&self.lens) } else { self.prior };
            let mut bundle = Bundle { lens: self.lens, poses, points };
            let (poses, scale) = (self.expected.as_ref(), 0.5 * self.tolerance);
            bundle.adjust(&Adjustment { prior, poses, points: true, scale, steps: 30 });
            self.lens = bundle.lens;
            let placed = self.poses.iter_mut().zip(bundle.poses).filter(|(pose, _)| pose.is_ok());
            placed.for_each(|(pose, adjusted)| *pose = Ok(adjusted));
            self.positions.fill(None);
            for (track, point) in indices.into_iter().zip(bundle.points) {
                self.positions[track] = self.kept(track, point.position);
            }
        }
    }

    /// Returns `position` if two views that agree on it see it under an angle of at least [`MIN_ANGLE`].
    fn kept(&self, track: usize, position: DVec3) -> Option<DVec3> {
        let centres: Vec<DVec3> = self.agreeing(track, position).map(|(_, pose, _)| pose.centre()).collect();
        (angle(position, &centres) >= MIN_ANGLE).then_some(position)
    }

    /// Triangulates a track from the pair of views whose point most views agree with, then anew from all of these.
    fn triangulated(&self, track: usize) -> Option<DVec3> {
        let seen: Vec<(Pose, DVec2, DVec2)> =
            self.seen(track).into_iter().map(|(_, pose, pixel)| (pose, pixel, self.lens.unproject(pixel))).collect();
        let pairs = (0..seen.len()).flat_map(|i| (0..i).map(move |j| (j, i)));
        let agreeing = |position: DVec3| -> Vec<(Pose, DVec2)> {
            seen.iter().filter(|s| self.agrees(&s.0, position, s.1)).map(|s| (s.0, s.2)).collect()
        };
        let best = pairs
            .take(TRIED)
            .filter_map(|(j, i)| triangulate(&[(seen[j].0, seen[j].2), (seen[i].0, seen[i].2)]).map(agreeing))
            .reduce(|best, other| if other.len() > best.len() { other } else { best })?;
        self.kept(track, triangulate(&best)?)
    }

    /// Places the photograph that sees most points, or else the next one; returns `false` if none can be placed.
    fn place_next(&mut self) -> bool {
        let seen = |photograph: usize| -> Vec<(DVec2, DVec3)> {
            let point = |(track, position): (&Track, &Option<DVec3>)| {
                let (_, pixel) = track.iter().find(|(i, _)| *i == photograph)?;
                Some((*pixel, (*position)?))
            };
            self.tracks.iter().zip(&self.positions).filter_map(point).collect()
        };
        let waiting = (0..self.poses.len()).filter(|&i| self.poses[i].is_err());
        let mut waiting: Vec<_> = waiting.map(|i| (i, seen(i))).collect();
        waiting.sort_by_key(|(i, seen)| (std::cmp::Reverse(seen.len()), *i));
        waiting.into_iter().any(|(i, seen)| {
            self.poses[i] = self.pose(&seen);
            self.poses[i].is_ok()
        })
    }

    fn pose(&self, seen: &[(DVec2, DVec3)]) -> Result<Pose, String> {
        if seen.len() < MIN_POINTS {
            return Err(format!("{} matches with placed photographs, {MIN_POINTS} needed", seen.len()));
        }
        let error = |pose: &Pose, i: usize| {
            let projected = self.lens.project(pose.transform(seen[i].1));
            projected.map_or(f64::INFINITY, |p| p.distance_squared(seen[i].0))
        };
        let solve = |sample: [usize; 3]| p3p(sample.map(|i| (self.lens.unproject(seen[i].0), seen[i].1)));
        let ransac = Ransac { threshold: (2.0 * self.tolerance).powi(2), max_samples: SAMPLES, seed: 0 };
        let needed = MIN_POINTS.max((AGREEING * seen.len() as f64).ceil() as usize);
        let (pose, inliers) = ransac.run(seen.len(), solve, error).unwrap_or((Pose::IDENTITY, Vec::new()));
        if inliers.len() < needed {
            let (some, all) = (inliers.len(), seen.len());
            return Err(format!("{some} of {all} matches with placed photographs agree on a pose, {needed} needed"));
        }
        let point = |&i: &usize| Point { position: seen[i].1, seen: vec![(0, seen[i].0)] };
        let mut bundle = Bundle { lens: self.lens, poses: vec![pose], points: inliers.iter().map(point).collect() };
        let (prior, scale) = (Prior::fixed(&self.lens), 0.5 * self.tolerance);
        bundle.adjust(&Adjustment { prior, poses: None, points: false, scale, steps: 20 });
        Ok(bundle.poses[0])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{disturb, turn, world};
    use crate::two_view::{relative, two_view};

    /// Refines the `expected` poses by `tracks`.
    fn refined(tracks: &[Track], lens: SimpleRadial, expected: &PosePrior) -> SparseModel {
        let poses = expected.poses.iter().copied().map(Ok).collect();
        Mapper::new(tracks, poses, (lens, Prior::fixed(&lens)), 2.5, Some(expected.clone())).refine()
    }

    /// Shares ten points between photographs 0 and 1, too few to place 0, and 16 or 10 others between photographs 1 and 2.
    #[test]
    fn photographs_that_only_uncertain_ones_confirm_are_not_placed() {
        let all = world(7, 3, 40);
        let expected = PosePrior { poses: all.poses.clone(), turn_deviation: 0.01, shift_deviation: 0.01 };
        let seen = |range: std::ops::Range<usize>, by: [usize; 2]| -> Vec<Track> {
            all.points[range].iter().map(|p| by.map(|i| p.seen[i]).to_vec()).collect()
        };
        let tracks = [seen(0..10, [0, 1]), seen(10..26, [1, 2])].concat();
        let found = refined(&tracks, all.lens, &expected);
        assert_eq!(found.poses[0], Err("10 points seen, 15 needed".into()));
        assert_eq!(found.placed(), 2);
        // A point that only one placed photograph sees does not count.
        assert_eq!((found.points.len(), found.observations()), (16, 32));
        let fewer = [seen(0..10, [0, 1]), seen(10..20, [1, 2])].concat();
        let left = refined(&fewer, all.lens, &expected).placed();
        assert_eq!(left, 0, "20 points of the second are 10 without the first");
    }

    /// Gives the last photograph no matches.
    #[test]
    fn all_photographs_with_matches_are_placed() {
        let mut all = world(11, 5, 120);
        disturb(&mut all.points, 0.5, 9);
        let tracks: Vec<Track> = all.points.iter().map(|p| p.seen[..4].to_vec()).collect();
        let lens = SimpleRadial { focal: 960.0, k1: 0.0, ..all.lens };
        let prior = Prior { focal: 960.0, focal_deviation: 0.3, k1_deviation: 0.1 };
        let matches: Vec<_> = tracks.iter().map(|t| (t[0].1, t[3].1)).collect();
        let mut poses = vec![Err(String::new()); 5];
        (poses[0], poses[3]) = (Ok(Pose::IDENTITY), Ok(two_view(&matches, &lens, 2.5, 0).unwrap().pose));
        let found = Mapper::new(&tracks, poses, (lens, prior), 2.5, None).run();
        assert_eq!(found.placed(), 4);
        assert_eq!(found.poses[4], Err("0 matches with placed photographs, 15 needed".into()));
        assert!((found.lens.focal / 900.0 - 1.0).abs() < 0.03, "{:?}", found.lens);
        for i in 1..4 {
            let [first, other] = [0, i].map(|i| found.poses[i].as_ref().unwrap());
            let exact = relative([&all.poses[0], &all.poses[i]]);
            assert!(turn(&relative([first, other]).rotation, &exact.rotation) < 0.3);
        }
        assert!((380..=430).contains(&found.observations()), "{}", found.observations());
    }

    /// Refines cameras that are off by 3° and 4 %, with one wrong match in nine and none in the last. Exact cameras stay.
    #[test]
    fn rough_cameras_are_refined_and_certain_ones_stay() {
        let truth = world(11, 5, 120);
        let sway = |i: usize| DVec3::new((i as f64).sin(), (2.0 * i as f64).cos(), (3.0 * i as f64).sin());
        for (size, wrong) in [(1.0, 9), (0.0, usize::MAX)] {
            let mut points = world(11, 5, 120).points;
            disturb(&mut points, 0.5 * size, wrong);
            let tracks: Vec<Track> = points.iter().map(|p| p.seen[..4].to_vec()).collect();
            let rough = |(i, pose): (usize, &Pose)| pose.moved(size * 0.045 * sway(i), size * 0.15 * sway(i + 9));
            let poses: Vec<Pose> = truth.poses.iter().enumerate().map(rough).collect();
            let expected = PosePrior { poses, turn_deviation: 0.035, shift_deviation: 0.12 };
            let found = refined(&tracks, truth.lens, &expected);
            assert_eq!(found.poses[4], Err("0 points seen, 15 needed".into()));
            for i in 0..4 {
                let (ours, exact) = (found.poses[i].as_ref().unwrap(), &truth.poses[i]);
                let apart = |first: &Pose, other: &Pose| {
                    turn(&relative([first, other]).rotation, &relative([&truth.poses[0], exact]).rotation)
                };
                let off = apart(found.poses[0].as_ref().unwrap(), ours);
                let rough = apart(&expected.poses[0], &expected.poses[i]);
                assert!(off < 0.2 * size + 1e-4 && (i == 0 || size == 0.0 || rough > 1.0), "{i}: {rough} {off}");
                // The frame is that of the given cameras, whose mean error is almost 0.
                assert!(turn(&ours.rotation, &exact.rotation) < 2.0 * size + 1e-4);
                let shift = ours.centre().distance(exact.centre());
                assert!(shift < 0.3 * size + 1e-6, "{size} {i}: {shift}");
            }
        }
    }
}
