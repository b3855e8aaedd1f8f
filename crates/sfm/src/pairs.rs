//! Matches between images, and the relative poses and homographies that explain them.

use glam::DVec2;
use infonerf_scene::image::GreyImage;
use rayon::prelude::*;

use crate::camera::{Pose, SimpleRadial};
use crate::essential::sampson;
use crate::matching::{Matches, matches_of_pairs};
use crate::reconstruction::TOLERANCE;
use crate::sift::{Features, features};
use crate::triangulate::triangulate;
use crate::two_view::{cross, two_view};

/// Focal lengths over the longer side with which matches are verified if the given ones do not suffice.
const FOCAL_LENGTHS: [f64; 3] = [0.7, 1.1, 1.8];
/// Pairs of images are compared if this share of their matches agrees on a relative pose.
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

/// Matches all pairs of `images`, and keeps of each pair the matches that agree with one relative pose, estimated from
/// the matches alone. `focal` holds the focal lengths, in pixels, that the cameras are thought to have; an image has at most
/// `most` features.
pub fn verified_matches(images: &[GreyImage], focal: &[f64], most: usize) -> Vec<ImageMatches> {
    let found: Vec<Features> = images.par_iter().map(|image| features(image, most)).collect();
    let verify = |Matches { a, b, pairs }: &Matches| {
        let (width, height) = (images[*a].width as f64, images[*a].height as f64);
        let longer = width.max(height);
        let pixels: Vec<_> = pairs.iter().map(|(i, j)| (found[*a].pixels[*i], found[*b].pixels[*j])).collect();
        let inliers = |focal: f64| {
            let lens = SimpleRadial { focal, k1: 0.0, centre: 0.5 * DVec2::new(width, height) };
            two_view(&pixels, &lens, TOLERANCE * longer, 0).map_or(Vec::new(), |view| view.inliers)
        };
        let guesses = FOCAL_LENGTHS.map(|times| times * longer);
        let best = [focal[*a]].into_iter().chain(guesses).map(inliers).max_by_key(Vec::len)?;
        let agree = best.len() as f64 >= AGREEING * pixels.len() as f64;
        agree.then(|| ImageMatches { a: *a, b: *b, pixels: best.iter().map(|&i| pixels[i]).collect() })
    };
    matches_of_pairs(&found).par_iter().filter_map(verify).collect()
}

/// Whether two cameras see one point in front of them along `rays`, `(x, y, 1)` in their axes, up to `tolerance` (Sampson's
/// distance in the plane at depth 1).
pub fn explains([a, b]: [&Pose; 2], rays: (DVec2, DVec2), tolerance: f64) -> bool {
    let rotation = b.rotation * a.rotation.transpose();
    let relative = Pose { rotation, translation: b.translation - rotation * a.translation };
    let essential = cross(relative.translation) * relative.rotation;
    sampson(&essential, rays) < tolerance.powi(2)
        && triangulate(&[(Pose::IDENTITY, rays.0), (relative, rays.1)]).is_some()
}
