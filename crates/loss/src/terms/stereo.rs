use std::sync::OnceLock;

use burn::tensor::{Tensor, TensorData};
use infonerf_ops::composite;
use infonerf_scene::Scene;
use infonerf_schedule::Schedule;
use infonerf_stereo::{DepthMap, Settings, depth_maps};
use serde::{Deserialize, Serialize};

use crate::term::in_range;
use crate::{LossError, Need, Renders, Term, TermSetup, TermSpec};

/// Scenes with more training views are learned without.
const MOST_VIEWS: usize = 24;
/// Pairs of views that are compared, if all views are to have one.
const PAIRS: usize = 24;

/// Rays end where plane-sweep stereo of the training images has found a surface (as DS-NeRF, Deng et al. 2022, has them end
/// at points of structure from motion): the negative log-likelihood of its disparity `1/d` under the distribution of a ray's
/// end, mean over the rays of training images,
///
/// `−log(π + (1 − π) Σᵢ wᵢ exp(−(1/tᵢ − 1/d)² / 2(width·step)²))`, divided by `−log π`
///
/// with `step` between the planes of the search. A share π of its depths is taken to be wrong, so that one that colour speaks
/// against lets go. A ray without a depth counts as 0.
///
/// Few photographs of a deep scene are explained by many wrong shapes, and gradients of colour alone do not find the way out
/// of one: a search over all depths does.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StereoConfig {
    /// Its weight.
    pub weight: Schedule,
    /// How exact a depth is taken to be: a standard deviation in steps between planes.
    pub width: f32,
    /// The share π of depths that are taken to be wrong.
    pub outliers: f32,
}

impl TermSpec for StereoConfig {
    fn weight(&self) -> &Schedule {
        &self.weight
    }

    fn weight_mut(&mut self) -> &mut Schedule {
        &mut self.weight
    }

    fn validate(&self) -> Result<(), LossError> {
        in_range("width", self.width.into(), 0.1, 100.0)?;
        in_range("outliers", self.outliers.into(), 1e-6, 0.99)
    }

    fn left_out(&self, scene: &Scene) -> Option<&'static str> {
        match scene.train.len() {
            0..2 => Some("left out: one view has no depth"),
            2..=MOST_VIEWS => None,
            _ => Some("left out: so many views show depth by themselves"),
        }
    }

    fn build(&self, setup: &TermSetup<'_>) -> Result<Box<dyn Term>, LossError> {
        Ok(Box::new(Stereo {
            width: self.width,
            outliers: self.outliers,
            scene: setup.scene.clone(),
            maps: OnceLock::new(),
        }))
    }
}

#[derive(Debug)]
struct Stereo {
    width: f32,
    outliers: f32,
    scene: Scene,
    /// Made in the first step, so that the search counts as training time.
    maps: OnceLock<Vec<DepthMap>>,
}

impl Stereo {
    /// Disparity of the surface that a pixel of a view shows and the step between planes, if there was a match.
    fn depth(&self, (view, x, y): (usize, f32, f32)) -> Option<(f32, f32)> {
        let maps = self.maps.get_or_init(|| {
            let neighbours = (PAIRS / self.scene.train.len()).clamp(1, 4);
            depth_maps(&self.scene, &Settings { neighbours, ..Settings::default() })
        });
        maps[view].at(&self.scene.train[view].camera, x, y)
    }
}

impl Term for Stereo {
    fn needs(&self) -> Vec<Need> {
        Vec::new()
    }

    fn value(&self, renders: &Renders) -> Tensor<1> {
        let output = renders.seen.output();
        let target = renders.seen.target.as_ref().expect("training images have pixels");
        let device = output.tau.device();
        let (samples, segments) = (&output.samples, output.segments());
        let depths: Vec<_> = target.places.iter().map(|&place| self.depth(place)).collect();
        let mut near_surface = vec![0.0; segments.samples()];
        for (range, depth) in segments.ranges().zip(&depths) {
            let Some((disparity, step)) = depth else { continue };
            for i in range {
                let off = (1.0 / samples.t[i].max(f32::MIN_POSITIVE) - disparity) / (self.width * step);
                near_surface[i] = (-0.5 * off * off).exp();
            }
        }
        let known: Vec<f32> = depths.iter().map(|depth| f32::from(u8::from(depth.is_some()))).collect();
        let near_surface = Tensor::<2>::from_data(TensorData::new(near_surface, [segments.samples(), 1]), &device);
        let known = Tensor::<1>::from_data(TensorData::new(known, [depths.len()]), &device);
        let likelihood = composite(output.tau.clone(), near_surface, segments).values.squeeze_dim(1);
        let robust = likelihood * (1.0 - self.outliers) + self.outliers;
        (robust.log() * known).mean() / self.outliers.ln()
    }
}

#[cfg(test)]
mod tests {
    use infonerf_scene::{Camera, Image, View};

    use super::*;
    use crate::testing;

    fn map(disparity: f32) -> DepthMap {
        DepthMap { width: 1, height: 1, disparity: vec![disparity], step: vec![0.1] }
    }

    fn term(disparity: f32) -> Stereo {
        let camera = Camera::from_fov(8, 8, 1.0, glam::DMat4::IDENTITY);
        let image = Image::filled(8, 8, [0.5; 3]);
        let view = View { id: 0, name: String::new(), camera, image: image.into(), depth: None, mask: None };
        let scene = Scene { train: vec![view], ..Scene::default() };
        Stereo { width: 1.0, outliers: 0.01, scene, maps: vec![map(disparity)].into() }
    }

    /// Samples of the test's rays are at 0.5, 1.5, …
    #[test]
    fn a_ray_that_ends_at_the_surface_costs_nothing() {
        let term =
            |disparity| Stereo { width: 1.0, outliers: 0.01, cameras: vec![camera()], maps: vec![map(disparity)] };
        let value = |disparity: f32, tau: &[f32]| {
            let mut renders = testing::renders(&[tau]);
            renders.seen.target.as_mut().unwrap().places = vec![(0, 4.0, 4.0)];
            term(disparity).value(&renders).into_scalar::<f32>()
        };
        approx::assert_abs_diff_eq!(value(1.0 / 1.5, &[0.0, f32::INFINITY]), 0.0, epsilon = 1e-5);
        // All of the weight is far from the surface, and then half of it.
        approx::assert_abs_diff_eq!(value(1.0 / 1.5, &[f32::INFINITY, 0.0]), 1.0, epsilon = 1e-5);
        let half = (0.01f32 + 0.99 * 0.5).ln() / 0.01f32.ln();
        approx::assert_abs_diff_eq!(value(1.0 / 1.5, &[0.0, std::f32::consts::LN_2]), half, epsilon = 1e-5);
        assert_eq!(value(f32::NAN, &[1.0, 1.0]), 0.0);
    }
}
