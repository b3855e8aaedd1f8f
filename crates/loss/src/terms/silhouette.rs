use burn::tensor::Tensor;
use infonerf_ops::means::mean_by_class;
use infonerf_ops::upload;
use infonerf_scene::{Backdrop, Scene};
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::{Renders, Term, TermSetup, TermSpec, pixel_class};

/// Supervision of opacity by a known background colour: the mean over the rays of training images of `background`·acc for
/// pixels of that colour, which most likely show the background, of −`edge`·acc for others with such a pixel among the 3 × 3
/// around them, and of −`foreground`·acc for the rest.
///
/// No alpha channel is used; an object of exactly the background's colour would be thinned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SilhouetteConfig {
    /// Its scheduled weight.
    pub weight: Schedule,
    /// Factor for pixels of the background colour.
    pub background: f32,
    /// Factor for pixels within an object.
    pub foreground: f32,
    /// Factor for pixels at its edge.
    pub edge: f32,
}

impl TermSpec for SilhouetteConfig {
    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_within(0.0..=1e6, "background", self.background.into())?;
        Fault::unless_within(0.0..=1e6, "foreground", self.foreground.into())?;
        Fault::unless_within(0.0..=1e6, "edge", self.edge.into())
    }

    fn skip_reason(&self, scene: &Scene) -> Option<&'static str> {
        (scene.backdrop == Backdrop::Unknown).then_some("left out: nothing is known of what is behind the scene")
    }

    fn build(&self, _setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }

    fn privilege(&self) -> Option<&'static str> {
        Some("the colour of the background")
    }
}

impl Term for SilhouetteConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let acc = renders.seen.output().acc.clone();
        let target = renders.seen.target.as_ref().expect("training images show colours");
        let signs = [self.background, -self.edge, -self.foreground];
        if let Some(classes) = &target.classes {
            return mean_by_class(acc, classes.clone(), signs);
        }
        let sign =
            |(pixel, coverage): (&[f32; 4], &f32)| signs[pixel_class(*pixel, *coverage, target.background) as usize];
        let signs: Vec<f32> = target.rgba.iter().zip(&target.coverage).map(sign).collect();
        let signs = upload(signs, [target.rgba.len()], &acc.device());
        (acc * signs).mean()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing;

    #[test]
    fn background_is_pressed_down_and_foreground_pulled_up() {
        let mut renders = testing::renders(&[&[0.5], &[1.0], &[2.0]]);
        let target = renders.seen.target.as_mut().unwrap();
        // The last is at an edge.
        target.rgba = vec![[1.0, 1.0, 1.0, 1.0], [1.0, 0.9, 1.0, 1.0], [1.0, 0.9, 1.0, 1.0]];
        target.coverage = vec![0.0, 1.0, 0.8];
        let config = SilhouetteConfig { weight: 1.0.into(), background: 2.0, foreground: 3.0, edge: 0.5 };
        let acc = [0.5f32, 1.0, 2.0].map(|tau| -(-tau).exp_m1());
        let want = (2.0 * acc[0] - 3.0 * acc[1] - 0.5 * acc[2]) / 3.0;
        approx::assert_abs_diff_eq!(config.value(&renders).into_scalar::<f32>(), want, epsilon = 1e-6);
        // Where the classes are known.
        let device = renders.seen.output().acc.device();
        let target = renders.seen.target.as_mut().unwrap();
        target.rgba.clear();
        target.classes = Some(Tensor::from_floats([0.0, 2.0, 1.0], &device));
        approx::assert_abs_diff_eq!(config.value(&renders).into_scalar::<f32>(), want, epsilon = 1e-6);
    }
}
