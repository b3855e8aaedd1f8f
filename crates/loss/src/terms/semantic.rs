use std::fmt;
use std::path::PathBuf;

use burn::tensor::{Tensor, TensorData};
use infonerf_pretrained::{ClipConfig, ClipVision};
use infonerf_scene::View;
use infonerf_schedule::{Fault, Moment, Schedule};
use serde::{Deserialize, Serialize};

use crate::{Need, Renders, Term, TermSetup, TermSpec};

/// Semantic consistency (DietNeRF, Jain et al. 2021, Eq. 5): 1 − φᵀφ̂ of the CLIP embeddings of a rendered view and a
/// photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SemanticConfig {
    /// λ (DietNeRF: 0.1).
    pub weight: Schedule,
    /// Steps between two such renders (DietNeRF: 10 to 16).
    pub every: usize,
    /// Longest side of the render in pixels (DietNeRF: 168).
    pub size: u32,
    /// Safetensors file with the weights of `openai/clip-vit-base-patch32`.
    pub weights: PathBuf,
}

impl TermSpec for SemanticConfig {
    fn needs(&self) -> Vec<Need> {
        vec![Need::Picture { size: self.size }]
    }

    fn validate(&self) -> Result<(), Fault> {
        Fault::unless_within(1.0..=1e9, "every", self.every as f64)?;
        Fault::unless_within(1.0..=1024.0, "size", self.size.into())
    }

    fn build(&self, setup: &TermSetup<'_>) -> Result<Box<dyn Term>, Fault> {
        let clip = ClipVision::read(&self.weights, ClipConfig::VIT_B_32, setup.device).map_err(|cause| {
            let expected = "the tensors of openai/clip-vit-base-patch32, as safetensors or PyTorch's";
            Fault::new("weights", expected, format!("{}: {cause}", self.weights.display()))
        })?;
        let embed = |view: &View| {
            let image = &view.image;
            let (height, width) = (image.height as usize, image.width as usize);
            let pixels = TensorData::new(image.rgb.as_flattened().to_vec(), [height * width, 3]);
            clip.embed(Tensor::from_data(pixels, setup.device), (height, width)).detach()
        };
        let photographs = setup.scene.train.iter().map(embed).collect();
        Ok(Box::new(SemanticTerm { config: self.clone(), clip, photographs }))
    }

    fn weights_file(&mut self) -> Option<(&'static str, &mut PathBuf)> {
        Some(("weights", &mut self.weights))
    }
}

/// The encoder, and its embeddings of the photographs.
struct SemanticTerm {
    config: SemanticConfig,
    clip: ClipVision,
    photographs: Vec<Tensor<1>>,
}

impl fmt::Debug for SemanticTerm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SemanticTerm").field("config", &self.config).finish_non_exhaustive()
    }
}

impl Term for SemanticTerm {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let picture = renders.picture.as_ref().expect("a picture was asked for");
        let embedding = self.clip.embed(picture.rgb.clone(), picture.size);
        semantic_loss(embedding, self.photographs[picture.view].clone())
    }

    fn is_due(&self, at: Moment) -> bool {
        at.step.is_multiple_of(self.config.every)
    }
}

/// 1 − φᵀφ̂ of two unit-length embeddings, a scalar in [0, 2].
pub fn semantic_loss(embedding: Tensor<1>, target: Tensor<1>) -> Tensor<1> {
    (embedding * target).sum().neg() + 1.0
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;

    #[test]
    fn the_loss_is_a_distance_on_the_sphere() {
        let vector = |x: f32, y: f32| Tensor::<1>::from_floats([x, y], &Device::flex());
        let loss = |a, b| semantic_loss(a, b).into_scalar::<f32>();
        assert_eq!(loss(vector(0.6, 0.8), vector(0.6, 0.8)), 0.0);
        assert_eq!(loss(vector(1.0, 0.0), vector(0.0, 1.0)), 1.0);
        assert_eq!(loss(vector(0.0, -1.0), vector(0.0, 1.0)), 2.0);
    }
}
