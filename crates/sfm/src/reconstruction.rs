//! From photographs to cameras and points.

use glam::DVec2;
use rayon::prelude::*;

use crate::bundle::{Point, Prior};
use crate::camera::{Lens, Pose};
use crate::grey::Grey;
use crate::mapper::Mapper;
use crate::matching::{FEWEST, Matches, matches_of_pairs};
use crate::sift::{Features, features};
use crate::tracks::tracks;
use crate::two_view::{TwoView, verified};

/// Focal lengths that are tried where none is known, over the longer side: wide angle to short telephoto.
const GUESSES: [f64; 4] = [0.65, 0.85, 1.15, 1.6];
/// How far off a guess, or what EXIF says, may be: deviation of its logarithm.
const GUESS_DEVIATION: f64 = 0.3;
const KNOWN_DEVIATION: f64 = 0.05;
const K1_DEVIATION: f64 = 0.03;
/// The usual focal length, over the longer side, and the deviation of its logarithm among cameras.
const USUAL: (f64, f64) = (0.85, 0.5);
/// Pairs that are tried to start from.
const STARTS: usize = 3;
/// Angles above this, in radians, make a pair no better to start from.
const WIDE: f64 = 0.2;

/// A photograph; all have one size and one lens. Pixels below are those of `image`.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// The picture, reduced as one likes.
    pub image: Grey,
    /// Its focal length over its longer side, where it is known.
    pub focal: Option<f64>,
}

/// What cameras and points are found with.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Features per photograph, at most.
    pub features: usize,
    /// How far a point may be seen from where it falls, over the longer side of a photograph.
    pub tolerance: f64,
    /// Of the samples that are drawn.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { features: 6000, tolerance: 2.5e-3, seed: 0 }
    }
}

/// Cameras and points, in a world of arbitrary place and scale.
#[derive(Clone, Debug, PartialEq)]
pub struct Reconstruction {
    /// The lens of all photographs, in their pixels.
    pub lens: Lens,
    /// The pose of each photograph, or why it has none.
    pub poses: Vec<Result<Pose, String>>,
    /// What two or more photographs see.
    pub points: Vec<Point>,
}

/// Finds cameras and points. `progress` is told of each step in a line.
///
/// # Errors
/// No two photographs have enough matches that agree on how the cameras stand to each other; in one line.
pub fn reconstruct(
    photographs: &[Photograph],
    settings: &Settings,
    mut progress: impl FnMut(&str),
) -> Result<Reconstruction, String> {
    let count = photographs.len();
    let features: Vec<Features> = photographs.par_iter().map(|p| features(&p.image, settings.features)).collect();
    let found = features.iter().map(|f| f.pixels.len());
    progress(&format!("{} to {} features per photograph", found.clone().min().unwrap_or(0), found.max().unwrap_or(0)));
    let matched = matches_of_pairs(&features);
    let most = matched.iter().map(|matches| matches.pairs.len()).max().unwrap_or(0);
    progress(&format!("{} pairs of photographs have {FEWEST} matches or more, {most} at most", matched.len()));
    let size = photographs.first().map_or(DVec2::ONE, |p| DVec2::new(p.image.width as f64, p.image.height as f64));
    let longer = size.max_element();
    let mut known: Vec<f64> = photographs.iter().filter_map(|p| p.focal).collect();
    known.sort_by(f64::total_cmp);
    let (guesses, focal_deviation) = match known.get(known.len() / 2) {
        Some(&median) => (vec![median], KNOWN_DEVIATION),
        None => (GUESSES.to_vec(), GUESS_DEVIATION),
    };
    let mut best: Option<((usize, f64), Reconstruction)> = None;
    for guess in guesses {
        let lens = Lens { focal: guess * longer, k1: 0.0, centre: 0.5 * size };
        let prior = Prior { focal: lens.focal, focal_deviation, k1_deviation: K1_DEVIATION };
        let found = map(&features, &matched, (lens, prior), settings.tolerance * longer, settings.seed);
        let Some(found) = found else { continue };
        let (placed, points) = (found.poses.iter().flatten().count(), found.points.len());
        let (from, to, k1) = (guess, found.lens.focal / longer, found.lens.k1);
        progress(&format!(
            "focal length {from:.2} of the longer side: {placed} of {count} photographs placed by {points} points, adjusted to {to:.2} and k1 = {k1:.3}",
        ));
        let score = (placed, found.points.iter().map(|p| p.seen.len()).sum::<usize>() as f64 * plausibility(to));
        if best.as_ref().is_none_or(|(most, _)| score > *most) {
            best = Some((score, found));
        }
    }
    let none = || format!("no two of {count} photographs have {FEWEST} matches that agree on a relative pose");
    best.map(|(_, found)| found).ok_or_else(none)
}

/// How likely a focal length is, 1 at most. A very long one explains more matches than the true one where the cameras stand in a row: seen
/// from so far, a point's depth is free, which makes true what is not.
fn plausibility(focal: f64) -> f64 {
    1.0 / (1.0 + ((focal / USUAL.0).ln() / USUAL.1).powi(2))
}

/// The best of the reconstructions with one guess of the lens; `None` where no pair can start one.
fn map(
    features: &[Features],
    matched: &[Matches],
    lens: (Lens, Prior),
    tolerance: f64,
    seed: u64,
) -> Option<Reconstruction> {
    let (agreed, views): (Vec<Matches>, Vec<TwoView>) =
        verified(features, matched, &lens.0, tolerance, seed).into_iter().unzip();
    let tracks = tracks(features, &agreed);
    let worth = |view: &TwoView| view.angles.iter().map(|a| a.min(WIDE)).sum::<f64>();
    let mut pairs: Vec<(&Matches, &TwoView)> = agreed.iter().zip(&views).collect();
    pairs.sort_by(|a, b| worth(b.1).total_cmp(&worth(a.1)));
    let start = |(matches, view): &(&Matches, &TwoView)| {
        let start = (matches.a, matches.b, view.pose);
        let mapper = Mapper::new(&tracks, features.len(), lens, tolerance, start, seed).run();
        let points = mapper.points();
        ((mapper.placed(), points.iter().map(|p| p.seen.len()).sum::<usize>()), mapper, points)
    };
    let starts: Vec<_> = pairs.par_iter().take(STARTS).map(start).collect();
    let (_, mapper, points) = starts.into_iter().reduce(|best, other| if other.0 > best.0 { other } else { best })?;
    Some(Reconstruction { lens: mapper.lens, poses: mapper.poses, points })
}
