use burn::tensor::Tensor;
use infonerf_ops::upload;
use infonerf_schedule::{Fault, Schedule};
use serde::{Deserialize, Serialize};

use crate::{Renders, Term, TermSetup, TermSpec};

/// Supervision of opacity by the alpha channel of the training images: (acc − alpha)², mean over the rays
/// of training images.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaskConfig {
    /// Its scheduled weight.
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

    fn privilege(&self) -> Option<&'static str> {
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
    use super::*;
    use crate::testing;

    #[test]
    fn squared_difference_by_hand() {
        let mut renders = testing::renders(&[&[f32::INFINITY], &[0.0]]);
        renders.seen.target.as_mut().unwrap().rgba = vec![[0.0, 0.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]];
        let config = MaskConfig { weight: 1.0.into() };
        approx::assert_abs_diff_eq!(config.value(&renders).into_scalar::<f32>(), 0.625, epsilon = 1e-6);
    }
}
