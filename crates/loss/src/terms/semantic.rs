use std::fmt;
use std::path::PathBuf;

use burn::tensor::{Tensor, TensorData};
use infonerf_pretrained::{ClipConfig, ClipVision};
use infonerf_scene::View;
use infonerf_schedule::{Fault, Moment, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, Renders};
use crate::term::{Term, TermSetup, TermSpec};

/// Semantic consistency (DietNeRF, Jain et al. 2021, Eq. 5): 1 − φᵀφ̂ of the CLIP embeddings of a render from an unseen pose
/// and a training image.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SemanticConfig {
    /// λ (DietNeRF: 0.1).
    pub weight: Schedule,
    /// Number of steps between two renders for this term (DietNeRF: 10 to 16).
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
            Fault::new("weights", expected, cause)
        })?;
        let embed = |view: &View| {
            let image = &view.image;
            let (height, width) = (image.height as usize, image.width as usize);
            let pixels = TensorData::new(image.rgb.as_flattened().to_vec(), [height * width, 3]);
            clip.embed(Tensor::from_data(pixels, setup.device), (height, width)).detach()
        };
        let targets = setup.scene.train.iter().map(embed).collect();
        Ok(Box::new(SemanticTerm { config: self.clone(), clip, targets }))
    }

    fn weights_file(&mut self) -> Option<(&'static str, &mut PathBuf)> {
        Some(("weights", &mut self.weights))
    }
}

struct SemanticTerm {
    config: SemanticConfig,
    clip: ClipVision,
    targets: Vec<Tensor<1>>,
}

impl fmt::Debug for SemanticTerm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SemanticTerm").field("config", &self.config).finish_non_exhaustive()
    }
}

impl Term for SemanticTerm {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let picture = renders.picture.as_ref().expect("an image is needed");
        let embedding = self.clip.embed(picture.rgb.clone(), picture.size);
        semantic_loss(embedding, self.targets[picture.view].clone())
    }

    fn is_due(&self, at: Moment) -> bool {
        at.step.is_multiple_of(self.config.every)
    }
}

/// Computes 1 − φᵀφ̂ of two unit-length embeddings, a scalar in [0, 2].
pub fn semantic_loss(embedding: Tensor<1>, target: Tensor<1>) -> Tensor<1> {
    (embedding * target).sum().neg() + 1.0
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use infonerf_ops::to_host;

    use super::*;
    use crate::testing::config;

    #[test]
    fn the_loss_is_a_distance_on_the_sphere_and_its_gradient_the_target() {
        let device = Device::flex().autodiff();
        for (a, b, want) in
            [([0.6, 0.8], [0.6, 0.8], 0.0), ([1.0, 0.0], [0.0, 1.0], 1.0), ([0.0, -1.0], [0.0, 1.0], 2.0)]
        {
            let a = Tensor::<1>::from_floats(a, &device).require_grad();
            let loss = semantic_loss(a.clone(), Tensor::from_floats(b, &device));
            let gradient = a.grad(&loss.backward()).unwrap();
            assert_eq!((loss.into_scalar::<f32>(), to_host(gradient)), (want, b.map(|x| -x).to_vec()));
        }
    }

    #[test]
    fn without_weights_the_file_is_named() {
        let mut config = config("semantic.weights = 'absent.safetensors'").semantic;
        assert_eq!(config.weights_file().map(|(key, _)| key), Some("weights"));
        let setup = TermSetup { scene: &Default::default(), device: &Device::flex() };
        let fault = config.build(&setup).unwrap_err();
        assert!(fault.key == "weights" && fault.found.starts_with("absent.safetensors: "), "{fault}");
    }
}
