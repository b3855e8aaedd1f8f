use std::sync::OnceLock;

use burn::tensor::{Device, Tensor};
use infonerf_ops::{composite, upload};
use infonerf_scene::{PixelAt, Scene};
use infonerf_schedule::{Fault, Schedule};
use infonerf_stereo::{DepthMap, StereoSettings, depth_maps};
use serde::{Deserialize, Serialize};

use crate::renders::Renders;
use crate::term::{Term, TermSpec};

const MAX_VIEWS: usize = 100;
/// Number of pairs of views to compare, at least one per view.
const PAIRS: usize = 24;
/// Number of views compared at full size; images of more views are reduced.
const FULL_SIZE_VIEWS: usize = 12;
/// Max number of views whose depths are refined in larger images: of more views the search takes too much of a short budget.
const REFINED_VIEWS: usize = 3;
/// Standard deviation of a disparity, in steps between planes; two views that agree differ by at most 1.5 steps.
const WIDTH: f32 = 2.0;
/// Share π of outliers: depths on which two views agree are seldom wrong.
const OUTLIERS: f32 = 0.01;

/// Depth supervision by plane-sweep stereo of the training images (DS-NeRF, Deng et al. 2022, uses points of structure from
/// motion): a robust negative log-likelihood, mean over the rays of training images,
///
/// `−log(π + (1 − π) P)`, divided by `−log π`
///
/// - with a match at distance d, `P = Σᵢ wᵢ exp(−(1/tᵢ − 1/d)² / 2(2·step)²)`, with `step` between the planes of the search;
/// - without one, `P` is the probability that the ray passes the nearest surface matched in its view, which keeps matter away
///   from cameras in textureless regions.
///
/// The share π of outliers bounds the loss of a depth that colours contradict.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StereoConfig {
    /// Scheduled weight of the term.
    pub weight: Schedule,
}

impl TermSpec for StereoConfig {
    fn skip_reason(&self, scene: &Scene) -> Option<&'static str> {
        match scene.train.len() {
            0..2 => Some("left out: one view has no depth"),
            2..=MAX_VIEWS => None,
            _ => Some("left out: more than 100 views show depth by themselves"),
        }
    }

    fn build(&self, scene: &Scene, _device: &Device) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(Stereo { scene: scene.clone(), maps: OnceLock::new() }))
    }
}

struct Stereo {
    scene: Scene,
    /// Nearest disparity and depth map of each view, made in the first step, so that the search counts as training time.
    maps: OnceLock<Vec<(Option<f32>, DepthMap)>>,
}

/// The end of a ray as far as stereo determines it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum RayEnd {
    /// Matched: disparity and its standard deviation.
    At(f32, f32),
    /// Not matched: at most this disparity, that of the view's nearest surface; infinite in a view without one.
    Beyond(f32),
}

impl RayEnd {
    /// Computes vᵢ of a sample at distance `t`; the probability of this end is Σᵢ wᵢ vᵢ, plus 1 unless it is matched.
    fn value(self, t: f32) -> f32 {
        let disparity = 1.0 / t.max(f32::MIN_POSITIVE);
        match self {
            Self::At(surface, width) => (-0.5 * ((disparity - surface) / width).powi(2)).exp(),
            Self::Beyond(nearest) if disparity > nearest => -1.0,
            Self::Beyond(_) => 0.0,
        }
    }
}

/// Settings of the search for a number of views. Its cost grows with pixels times planes, and so with the cube of the
/// image size: sizes that shrink with the cube root of the number of views keep it constant.
fn search(views: usize) -> StereoSettings {
    let settings = StereoSettings::default();
    let scaled = |scale: f32| (settings.size as f32 * scale).round() as u32;
    let scale = (FULL_SIZE_VIEWS as f32 / views as f32).cbrt();
    StereoSettings {
        size: scaled(scale.min(1.0)),
        refined_size: (views <= REFINED_VIEWS).then(|| scaled(scale)),
        neighbours: (PAIRS / views).clamp(1, settings.neighbours),
    }
}

impl Stereo {
    fn end(&self, PixelAt { view, x, y }: PixelAt) -> RayEnd {
        let maps = self.maps.get_or_init(|| {
            let maps = depth_maps(&self.scene, &search(self.scene.train.len()));
            maps.into_iter().map(|map| (map.nearest(), map)).collect()
        });
        let (nearest, map) = &maps[view];
        match map.at(&self.scene.train[view].camera, x, y) {
            Some((disparity, step)) => RayEnd::At(disparity, WIDTH * step),
            None => RayEnd::Beyond(nearest.unwrap_or(f32::INFINITY)),
        }
    }
}

impl Term for Stereo {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let output = &renders.seen.fine;
        let device = output.tau.device();
        let segments = output.segments();
        let ends: Vec<RayEnd> = renders.target.pixels.iter().map(|&pixel| self.end(pixel)).collect();
        let t = output.samples.t();
        let rays = segments.ranges().zip(&ends);
        let values = rays.flat_map(|(range, end)| t[range].iter().map(|&t| end.value(t))).collect();
        let values = upload(values, [segments.samples(), 1], &device);
        let offsets = ends.iter().map(|end| if matches!(end, RayEnd::At(..)) { 0.0 } else { 1.0 }).collect();
        let offsets = upload(offsets, [ends.len()], &device);
        let probability = composite(output.tau.clone(), values, segments).values.squeeze_dim(1) + offsets;
        let robust = probability.clamp_min(0.0) * (1.0 - OUTLIERS) + OUTLIERS;
        robust.log().mean() / OUTLIERS.ln()
    }
}

#[cfg(test)]
mod tests {
    use infonerf_oracle::weights;
    use infonerf_scene::{Camera, Image, View};

    use super::*;
    use crate::testing::{SEEN, check, config, mean};

    fn term(disparity: f32, nearest: Option<f32>) -> Stereo {
        let camera = Camera::from_fov(8, 8, 1.0, glam::DMat4::IDENTITY);
        let view = View::new(0, "", camera, Image::filled(8, 8, [0.5; 3]));
        let map = DepthMap { width: 1, height: 1, disparity: vec![disparity], step: vec![0.1] };
        Stereo { scene: Scene { train: vec![view], ..Scene::default() }, maps: vec![(nearest, map)].into() }
    }

    #[test]
    fn many_views_are_searched_in_smaller_images_and_few_in_larger_ones() {
        let settings = |views: usize| (search(views).size, search(views).refined_size, search(views).neighbours);
        let expected =
            [(252, Some(458), 4), (252, Some(400), 4), (252, None, 4), (252, None, 3), (252, None, 2), (200, None, 1)];
        assert_eq!([2, 3, 4, 7, 12, 24].map(settings), expected);
    }

    /// A match at a distance, none in a view with a nearest surface, and none in a view without any.
    #[test]
    fn likelihood_of_the_matched_end() {
        for (disparity, nearest) in [(1.0 / 1.6, None), (f32::NAN, Some(1.0)), (f32::NAN, None)] {
            let probability = |ray: &[f64]| -> f64 {
                let (w, t) = (weights(ray), |i: usize| i as f64 + 0.5);
                match nearest {
                    _ if !disparity.is_nan() => {
                        let error = |i: usize| (1.0 / t(i) - f64::from(disparity)) / f64::from(WIDTH * 0.1f32);
                        (0..w.len()).map(|i| w[i] * (-0.5 * error(i).powi(2)).exp()).sum()
                    }
                    // The first sample alone is nearer than disparity 1.
                    Some(_) => 1.0 - w.first().unwrap_or(&0.0),
                    None => 1.0,
                }
            };
            let pi = f64::from(OUTLIERS);
            let loss = |ray: &[f64]| (pi + (1.0 - pi) * probability(ray)).ln() / pi.ln();
            check(&term(disparity, nearest), |d| mean(d[SEEN].iter(), loss));
        }
    }

    #[test]
    fn one_view_and_many_views_are_left_out() {
        let view = &term(1.0, None).scene.train[0];
        let reason = |views: usize| {
            let scene = Scene { train: vec![view.clone(); views], ..Scene::default() };
            config("").stereo.skip_reason(&scene)
        };
        let [one, many] = ["one view has no depth", "more than 100 views show depth by themselves"];
        let found = [1, 2, 100, 101].map(reason).map(|reason| reason.map(|reason| &reason["left out: ".len()..]));
        assert_eq!(found, [Some(one), None, None, Some(many)]);
    }

    #[test]
    fn samples_at_the_nearest_surface_are_not_penalised() {
        assert_eq!([1.01, 1.0, 0.99].map(|t| RayEnd::Beyond(1.0).value(t)), [0.0, 0.0, -1.0]);
    }
}
