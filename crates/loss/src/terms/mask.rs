use burn::tensor::Tensor;
use infonerf_ops::upload;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::Renders;
use crate::term::{Term, TermSetup, TermSpec};

/// Supervision of opacity by the alpha channel of the training images: (Σ w − alpha)², mean over the rays of training images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaskConfig {
    /// Scheduled weight of the term.
    pub weight: Schedule,
}

impl TermSpec for MaskConfig {
    fn build(&self, setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        if let Some(view) = setup.scene.train.iter().find(|view| view.image.alpha.is_none()) {
            let found = format!("none in {}", view.name);
            return Err(Fault::new("weight", "0, or training images with an alpha channel", found));
        }
        Ok(Box::new(self.clone()))
    }

    fn extra_supervision(&self) -> Option<&'static str> {
        Some("the alpha channel of the training images")
    }
}

impl Term for MaskConfig {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let acc = renders.seen.output().acc.clone();
        let target = renders.seen.target.as_ref().expect("training images show colours");
        let alphas: Vec<f32> = target.rgba.iter().map(|pixel| pixel[3]).collect();
        let alphas = upload(alphas, [target.rgba.len()], &acc.device());
        (acc - alphas).square().mean()
    }
}

#[cfg(test)]
mod tests {
    use infonerf_oracle::opacity;

    use super::*;
    use crate::testing::{SEEN, check, config};

    #[test]
    fn squared_difference_of_opacity_and_alpha() {
        let alphas = [0.5, 1.0, 0.25, 0.0];
        let set_up = |renders: &mut Renders| {
            let target = renders.seen.target.as_mut().unwrap();
            target.rgba.iter_mut().zip(alphas).for_each(|(pixel, alpha)| pixel[3] = alpha as f32);
        };
        check(&config("").mask, set_up, |d| {
            d[SEEN].iter().zip(alphas).map(|(ray, alpha)| (opacity(ray) - alpha).powi(2)).sum::<f64>() / 4.0
        });
    }
}
