use burn::tensor::Tensor;
use infonerf_ops::means::mean_by_class;
use infonerf_ops::upload;
use infonerf_scene::{Backdrop, Scene};
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Renders, pixel_class};
use crate::term::{Term, TermSetup, TermSpec};

/// Supervision of opacity A = Σ w by a known background colour: the mean over the rays of training images of `background`·A
/// for pixels of that colour, which most likely show the background, of −`edge`·A for others with such a pixel among the
/// 3 × 3 around them, and of −`foreground`·A for the rest.
///
/// No alpha channel is used; an object of exactly the background's colour would be thinned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SilhouetteConfig {
    /// Scheduled weight of the term.
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

    fn extra_supervision(&self) -> Option<&'static str> {
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
    use infonerf_oracle::opacity;

    use super::*;
    use crate::testing::{SEEN, check, config};

    /// Classes of pixels from their colours, and as a GPU drew them.
    #[test]
    fn background_is_pressed_down_and_foreground_pulled_up() {
        let term = config("silhouette = { background = 2.0, foreground = 3.0, edge = 0.5 }").silhouette;
        let signs = [2.0, -3.0, -0.5, -3.0];
        let formula =
            |rays: &[Vec<f64>]| rays.iter().zip(signs).map(|(ray, sign)| sign * opacity(ray)).sum::<f64>() / 4.0;
        let from_colors = |renders: &mut Renders| {
            let target = renders.seen.target.as_mut().unwrap();
            target.rgba[0] = [1.0, 1.0, 1.0, 1.0];
            target.coverage = vec![0.0, 1.0, 0.8, 1.0];
        };
        let drawn = |renders: &mut Renders| {
            let device = renders.seen.output().acc.device();
            let target = renders.seen.target.as_mut().unwrap();
            target.rgba.clear();
            target.classes = Some(Tensor::from_floats([0.0, 2.0, 1.0, 2.0], &device));
        };
        check(&term, from_colors, |d| formula(&d[SEEN]));
        check(&term, drawn, |d| formula(&d[SEEN]));
    }
}
