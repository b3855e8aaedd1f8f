//! Cameras that are known roughly, refined by what their photographs share.

use glam::DVec2;
use rayon::prelude::*;

use crate::bundle::{Point, PosePrior, Prior};
use crate::camera::{Lens, Pose};
use crate::grey::Grey;
use crate::mapper::Mapper;
use crate::matching::matches_of_pairs;
use crate::reconstruction::Settings;
use crate::sift::{Features, LENGTH, features};
use crate::tracks::tracks;
use crate::two_view::verified;

/// Points may always fall this many pixels from where they are seen.
const LEAST_TOLERANCE: f64 = 1.0;

/// A photograph and roughly where it was taken.
pub struct Posed<'a> {
    /// The picture.
    pub image: Grey,
    /// Roughly.
    pub pose: Pose,
    /// Through whatever lens: `(x, y) / z`, in the camera's axes, of what is seen at a pixel. `None` where that is unknown, or
    /// not to be looked at.
    pub unproject: &'a (dyn Fn(DVec2) -> Option<DVec2> + Sync),
}

/// How well cameras are known: deviations of normal distributions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uncertainty {
    /// Of orientations, in radians.
    pub turn: f64,
    /// Of places, in units of the world.
    pub shift: f64,
    /// Of the logarithm of the focal lengths, which all are off by the same factor; 0 where they are right.
    pub focal: f64,
}

/// Refined cameras.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// The pose of each photograph, or why its own has to do.
    pub poses: Vec<Result<Pose, String>>,
    /// By how much focal lengths are longer than they were given.
    pub focal: f64,
    /// What two or more photographs see.
    pub points: Vec<Point>,
}

/// Bundle adjustment of `photographs` and the points that they share, which begins at the poses given and is drawn to them by
/// their `uncertainty`: what matches leave open stays. `focal` is about the focal length in pixels, in which errors count.
pub fn refine(photographs: &[Posed<'_>], focal: f64, uncertainty: Uncertainty, settings: &Settings) -> Refined {
    let features: Vec<Features> =
        photographs.par_iter().map(|photograph| seen(photograph, focal, settings.features)).collect();
    let longer = photographs.iter().map(|p| p.image.width.max(p.image.height)).max().unwrap_or(0);
    let tolerance = (settings.tolerance * longer as f64).max(LEAST_TOLERANCE);
    let lens = Lens { focal, k1: 0.0, centre: DVec2::ZERO };
    let agreed = verified(&features, &matches_of_pairs(&features), &lens, tolerance, settings.seed);
    let tracks = tracks(&features, &agreed.into_iter().map(|(matches, _)| matches).collect::<Vec<_>>());
    let prior = Prior { focal, focal_deviation: uncertainty.focal, k1_deviation: 0.0 };
    let expected = PosePrior {
        poses: photographs.iter().map(|photograph| photograph.pose).collect(),
        turn_deviation: uncertainty.turn,
        shift_deviation: uncertainty.shift,
    };
    let found = Mapper::at(&tracks, (lens, prior), tolerance, expected, settings.seed).refine();
    let points = found.points();
    Refined { focal: found.lens.focal / focal, poses: found.poses, points }
}

/// The features of a photograph, as a lens of that focal length without distortion sees them.
fn seen(photograph: &Posed<'_>, focal: f64, most: usize) -> Features {
    let found = features(&photograph.image, most);
    let mut seen = Features::default();
    for (pixel, descriptor) in found.pixels.iter().zip(found.descriptors.chunks_exact(LENGTH)) {
        if let Some(p) = (photograph.unproject)(*pixel) {
            seen.pixels.push(focal * p);
            seen.descriptors.extend(descriptor);
        }
    }
    seen
}
