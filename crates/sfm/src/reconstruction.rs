//! Structure from motion: from photographs to cameras and points.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};

use glam::DVec2;
use rayon::prelude::*;

use crate::bundle::{Point, Prior};
use crate::camera::{Pose, SimpleRadial};
use crate::contradictions::map_without_false_pairs;
use crate::matching::{MIN_MATCHES, Matches, matches_of_pairs};
use crate::sift::{Features, features};
use crate::two_view::{TwoView, verified};
use infonerf_scene::image::GreyImage;

pub(crate) const FEATURES: usize = 6000;
/// Max reprojection error, divided by the longer side of a photograph.
pub(crate) const TOLERANCE: f64 = 2.5e-3;
/// Focal lengths, divided by the longer side, that are tried if none is known: wide angle to short telephoto.
const GUESSES: [f64; 4] = [0.65, 0.85, 1.15, 1.6];
/// Deviations of the logarithm of a focal length: of a guessed one, and of a known one.
const GUESS_DEVIATION: f64 = 0.3;
const KNOWN_DEVIATION: f64 = 0.05;
const K1_DEVIATION: f64 = 0.03;
/// Max ratio between the EXIF focal lengths of one zoom.
const SAME_ZOOM: f64 = 1.1;
/// Usual focal length divided by the longer side, and the deviation of its logarithm among cameras.
const USUAL_FOCAL: f64 = 0.85;
const USUAL_DEVIATION: f64 = 0.5;
/// Min ratio of a reconstruction's score to the best one's at which its focal length shows how uncertain that is.
const MIN_RIVAL_RATIO: f64 = 0.9;
/// Max difference between the logarithms of two focal lengths that place all photographs at which the search ends.
const SAME_FOCAL: f64 = 0.02;
/// Ratio between rival focal lengths above which the focal length is reported as uncertain.
const UNCERTAIN: f64 = 1.2;
/// Min share of a pair's matches explained by one homography at which the pair shows no depth.
const FLAT: f64 = 0.9;
/// Number of photographs from which an unknown focal length is found.
const FEW: usize = 9;
/// Number of pairs of photographs from which reconstructions start; the best one is kept.
const STARTS: usize = 3;
/// Max angle between rays, in radians, that counts in the choice of a starting pair.
const MAX_COUNTED_ANGLE: f64 = 0.2;

/// Reason why photographs have no reconstruction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoReconstruction {
    /// One homography explains the matches of each pair.
    NoDepth,
    /// No two of this number of photographs have enough matches that agree on a relative pose.
    NoPair(usize),
}

impl Display for NoReconstruction {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoDepth => f.write_str(
                "they show no depth: one homography explains the matches of each pair, as of a camera that was only \
                 turned, crops of one photograph, or a flat scene; take each from another place",
            ),
            Self::NoPair(count) => {
                write!(f, "no two of {count} photographs have {MIN_MATCHES} matches that agree on a relative pose")
            }
        }
    }
}

/// A photograph. All share one lens with the principal point in the middle; images of several sizes have one scale.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// The image, reduced to any size.
    pub image: GreyImage,
    /// Pixels whose features count, row-major; `None` if all do.
    pub mask: Option<Vec<bool>>,
    /// Focal length divided by the longer side of the image, if it is known.
    pub focal: Option<f64>,
}

/// Cameras and points in a world of arbitrary position and scale. Pixels are those of a canvas with the max width and
/// max height of all photographs, on which each photograph is centred.
#[derive(Clone, Debug, PartialEq)]
pub struct SparseModel {
    /// Lens of all photographs, in pixels of the canvas.
    pub lens: SimpleRadial,
    /// Pose of each photograph, or the reason why it has none.
    pub poses: Vec<Result<Pose, String>>,
    /// Points that two or more photographs see.
    pub points: Vec<Point>,
}

impl SparseModel {
    pub(crate) fn placed(&self) -> usize {
        self.poses.iter().flatten().count()
    }

    pub(crate) fn observations(&self) -> usize {
        self.points.iter().map(|point| point.seen.len()).sum()
    }
}

/// Finds cameras and points, and reports each step to `progress` in a line. `focal`, divided by the longer side,
/// replaces the focal lengths of the photographs.
///
/// # Errors
/// No pair of photographs can start a reconstruction.
pub fn reconstruct(
    photographs: &[Photograph],
    focal: Option<f64>,
    mut progress: impl FnMut(&str),
) -> Result<SparseModel, NoReconstruction> {
    let count = photographs.len();
    let size_of = |p: &Photograph| DVec2::new(p.image.width as f64, p.image.height as f64);
    let size = photographs.iter().map(size_of).fold(DVec2::ONE, DVec2::max);
    let found = |p: &Photograph| {
        let mut found = features(&p.image, p.mask.as_deref(), FEATURES);
        found.pixels.iter_mut().for_each(|pixel| *pixel += 0.5 * (size - size_of(p)));
        found
    };
    let features: Vec<Features> = photographs.par_iter().map(found).collect();
    let found = features.iter().map(|f| f.pixels.len());
    progress(&format!("{} to {} features per photograph", found.clone().min().unwrap_or(0), found.max().unwrap_or(0)));
    let matched = matches_of_pairs(&features);
    let most = matched.iter().map(|matches| matches.pairs.len()).max().unwrap_or(0);
    progress(&format!("pairs of photographs with {MIN_MATCHES} matches or more: {}, at most {most}", matched.len()));
    let longer = size.max_element();
    let tolerance = TOLERANCE * longer;
    let mut known: Vec<f64> = photographs.iter().filter_map(|p| p.focal).collect();
    known.sort_by(f64::total_cmp);
    if let (None, Some(warning)) = (focal, zoom_warning(&known)) {
        progress(&warning);
    }
    let (guesses, focal_deviation) = match focal.or(known.get(known.len() / 2).copied()) {
        Some(known) => (vec![known], KNOWN_DEVIATION),
        None => (GUESSES.to_vec(), GUESS_DEVIATION),
    };
    let prior = |focal: f64| Prior { focal, focal_deviation, k1_deviation: K1_DEVIATION };
    let mapped = |guess: f64, matched: &[Matches]| {
        let lens = SimpleRadial { focal: guess * longer, k1: 0.0, centre: 0.5 * size };
        map(&features, matched, (lens, prior(lens.focal)), tolerance)
    };
    if guesses.len() > 1 && count > FEW {
        let (few, within) = most_matched(&matched, FEW);
        progress(&format!("finding the focal length from {few} of the photographs"));
        if let Ok(start) = best_guess(&guesses, longer, few, |guess| mapped(guess, &within), &mut progress) {
            let lens = (start.lens, prior(start.lens.focal));
            let agreed = verified(&features, &matched, &start.lens, tolerance).into_iter().map(|(pairs, _)| pairs);
            let found = map_without_false_pairs(&features, agreed.collect(), start.poses, lens, tolerance);
            let (placed, points) = (found.placed(), found.points.len());
            progress(&format!("{placed} of {count} photographs placed by {points} points"));
            return Ok(found);
        }
    }
    best_guess(&guesses, longer, count, |guess| mapped(guess, &matched), &mut progress)
}

/// Returns a warning if sorted focal lengths, divided by the longer side, are those of several zooms.
fn zoom_warning(known: &[f64]) -> Option<String> {
    let (shortest, longest) = (known.first()?, known.last()?);
    (*longest > SAME_ZOOM * shortest).then(|| {
        format!(
            "EXIF focal lengths differ: {shortest:.2} to {longest:.2} of the longer side; all photographs are given one, so \
             leave out those of another zoom"
        )
    })
}

/// Chooses up to `most` photographs with many matches among them; returns their number and these matches.
fn most_matched(matched: &[Matches], most: usize) -> (usize, Vec<Matches>) {
    let mut chosen: Vec<usize> = Vec::new();
    let mut gains: BTreeMap<usize, usize> = BTreeMap::new();
    let mut next = matched.iter().max_by_key(|pair| pair.pairs.len()).map(|pair| pair.a);
    while let Some(photograph) = next.filter(|_| chosen.len() < most) {
        chosen.push(photograph);
        for pair in matched.iter().filter(|pair| pair.a == photograph || pair.b == photograph) {
            *gains.entry(pair.a + pair.b - photograph).or_default() += pair.pairs.len();
        }
        let left = gains.iter().filter(|(other, _)| !chosen.contains(other));
        next = left.max_by_key(|(_, gain)| **gain).map(|(other, _)| *other);
    }
    let is_within = |pair: &&Matches| chosen.contains(&pair.a) && chosen.contains(&pair.b);
    (chosen.len(), matched.iter().filter(is_within).cloned().collect())
}

/// Maps `count` photographs with each of the focal lengths `guesses` (divided by the `longer` side). Returns the map
/// with most placed photographs, or among several the one that explains most.
///
/// # Errors
/// Errors of [`reconstruct`].
fn best_guess(
    guesses: &[f64],
    longer: f64,
    count: usize,
    map: impl Fn(f64) -> Result<SparseModel, bool>,
    progress: &mut impl FnMut(&str),
) -> Result<SparseModel, NoReconstruction> {
    let mut best: Option<((usize, f64), SparseModel)> = None;
    let mut tried = Vec::new();
    let mut flat = false;
    for &guess in guesses {
        let found = match map(guess) {
            Ok(found) => found,
            Err(is_flat) => {
                flat |= is_flat;
                continue;
            }
        };
        let (placed, points) = (found.placed(), found.points.len());
        let (to, k1) = (found.lens.focal / longer, found.lens.k1);
        let placing = format!("{placed} of {count} photographs placed by {points} points");
        progress(&format!(
            "focal length {guess:.2} of the longer side: {placing}, adjusted to {to:.2} and k1 = {k1:.3}"
        ));
        let score = (placed, found.observations() as f64 * plausibility(to));
        let is_same = |&(all, _, other): &(usize, f64, f64)| all == count && (to / other).ln().abs() < SAME_FOCAL;
        let is_known = placed == count && tried.iter().any(is_same);
        tried.push((placed, score.1, to));
        if best.as_ref().is_none_or(|(most, _)| score > *most) {
            best = Some((score, found));
        }
        if is_known {
            break;
        }
    }
    let Some((score, found)) = best else {
        return Err(if flat { NoReconstruction::NoDepth } else { NoReconstruction::NoPair(count) });
    };
    let rivals = tried.iter().filter(|(placed, value, _)| *placed == score.0 && *value >= MIN_RIVAL_RATIO * score.1);
    let rivals: Vec<f64> = rivals.map(|(_, _, to)| *to).collect();
    let (least, most) = rivals.iter().fold((f64::INFINITY, 0f64), |(a, b), &v| (a.min(v), b.max(v)));
    if most > UNCERTAIN * least {
        progress(&format!(
            "the focal length is uncertain: {least:.2} to {most:.2} of the longer side explain the matches nearly as well; \
             --focal sets it"
        ));
    }
    Ok(found)
}

/// Returns the plausibility of a focal length, at most 1. If cameras stand in a row, a very long focal length explains
/// more matches than the true one: from far away a point's depth is free, so that any match agrees.
fn plausibility(focal: f64) -> f64 {
    1.0 / (1.0 + ((focal / USUAL_FOCAL).ln() / USUAL_DEVIATION).powi(2))
}

/// Maps with one guess of the lens, and returns the best of the reconstructions from several pairs.
///
/// # Errors
/// No pair can start a reconstruction; the error is whether one homography explains the matches of each pair.
fn map(
    features: &[Features],
    matched: &[Matches],
    lens: (SimpleRadial, Prior),
    tolerance: f64,
) -> Result<SparseModel, bool> {
    let mut agreed = verified(features, matched, &lens.0, tolerance);
    let pairs: Vec<Matches> = agreed.iter().map(|(matches, _)| matches.clone()).collect();
    if !agreed.is_empty() && agreed.iter().all(|(_, view)| view.homography_share >= FLAT) {
        return Err(true);
    }
    let worth = |view: &TwoView| {
        let angles = view.angles.iter().map(|a| a.min(MAX_COUNTED_ANGLE)).sum::<f64>();
        if view.homography_share >= FLAT { 1e-3 * angles } else { angles }
    };
    agreed.sort_by(|(_, a), (_, b)| worth(b).total_cmp(&worth(a)));
    let start = |(matches, view): &(Matches, TwoView)| {
        let mut poses = vec![Err(String::new()); features.len()];
        (poses[matches.a], poses[matches.b]) = (Ok(Pose::IDENTITY), Ok(view.pose));
        map_without_false_pairs(features, pairs.clone(), poses, lens, tolerance)
    };
    let starts: Vec<SparseModel> = agreed.par_iter().take(STARTS).map(start).collect();
    let score = |model: &SparseModel| (model.placed(), model.observations());
    starts.into_iter().reduce(|best, other| if score(&other) > score(&best) { other } else { best }).ok_or(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn usual_focal_lengths_are_likelier() {
        let found = [0.85, 0.5, 1.4, 0.2, 5.0].map(plausibility);
        assert_eq!(found[0], 1.0);
        assert!((found[1] - found[2]).abs() < 0.1 && found[1] < 0.6 && found[3] < 0.2 && found[4] < 0.3, "{found:?}");
        assert!(found.iter().all(|value| *value > 0.0));
    }

    #[test]
    fn several_zooms_are_named() {
        assert_eq!((zoom_warning(&[]), zoom_warning(&[0.7, 0.72, 0.75])), (None, None));
        let warning = zoom_warning(&[0.7, 0.7, 1.4]).unwrap();
        assert!(warning.starts_with("EXIF focal lengths differ: 0.70 to 1.40 of the longer"), "{warning}");
        assert!(warning.ends_with("are given one, so leave out those of another zoom"), "{warning}");
    }

    /// Photographs 0, 1, 2 and 5 have most matches in common; 3 and 4 have some with each other.
    #[test]
    fn photographs_with_most_matches_are_chosen() {
        let pair = |a: usize, b: usize, count: usize| Matches { a, b, pairs: vec![(0, 0); count] };
        let all = [pair(0, 1, 30), pair(0, 5, 50), pair(1, 2, 45), pair(3, 4, 60), pair(2, 5, 40), pair(0, 3, 21)];
        let chosen = |most: usize| {
            let (count, within) = most_matched(&all[..3], most);
            (count, within.iter().map(|pair| (pair.a, pair.b)).collect::<Vec<_>>())
        };
        assert_eq!(chosen(2), (2, vec![(0, 5)]));
        assert_eq!(chosen(3), (3, vec![(0, 1), (0, 5)]));
        assert_eq!(chosen(9), (4, vec![(0, 1), (0, 5), (1, 2)]));
        let (count, within) = most_matched(&all, 3);
        assert_eq!((count, within.len()), (3, 2), "from the pair with most on");
        assert_eq!(most_matched(&[], 9).0, 0);
    }
}
