use burn::tensor::{Device, Tensor};
use infonerf_ops::upload;
use infonerf_scene::{Backdrop, Scene};
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::Renders;
use crate::term::{Term, TermSpec};

/// Supervision of opacity A = Σ w by a known background colour: the mean over the rays of training images of A for pixels of
/// that colour, which most likely show the background, and of −A for the rest.
///
/// No alpha channel is used; an object of exactly the background's colour would be thinned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SilhouetteConfig {
    /// Scheduled weight of the term.
    pub weight: Schedule,
}

impl TermSpec for SilhouetteConfig {
    fn skip_reason(&self, scene: &Scene) -> Option<&'static str> {
        (scene.backdrop == Backdrop::Unknown).then_some("left out: nothing is known of what is behind the scene")
    }

    fn build(&self, _scene: &Scene, _device: &Device) -> Result<Box<dyn Term>, Fault> {
        Ok(Box::new(self.clone()))
    }

    fn extra_supervision(&self) -> Option<&'static str> {
        Some("the colour of the background")
    }
}

impl Term for SilhouetteConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let acc = renders.seen.fine.acc.clone();
        let signs: Vec<f32> = renders.target.foreground().map(|shown| if shown { -1.0 } else { 1.0 }).collect();
        let signs = upload(signs, acc.dims(), &acc.device());
        (acc * signs).mean()
    }
}

#[cfg(test)]
mod tests {
    use infonerf_oracle::opacity;

    use super::*;
    use crate::testing::{SEEN, check_with, config};

    #[test]
    fn opacity_falls_on_the_background_and_rises_elsewhere() {
        let signs = [1.0, -1.0, -1.0, -1.0];
        // The third pixel differs from the background by less than one part in a hundred.
        let with_background = |Renders { target, .. }: &mut Renders| {
            target.on_host[0] = target.background;
            target.on_host[2] = target.background.map(|c| c - 0.008);
        };
        check_with(&config("").silhouette, with_background, |d| {
            d[SEEN].iter().zip(signs).map(|(ray, sign)| sign * opacity(ray)).sum::<f64>() / 4.0
        });
    }
}
