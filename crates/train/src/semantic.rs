//! CLIP's judgement of a render: see [`SemanticConfig`].

use burn::tensor::{Device, Tensor, TensorData};
use infonerf_loss::{SemanticConfig, semantic_loss};
use infonerf_pretrained::{ClipConfig, ClipVision};
use infonerf_scene::{Scene, View};

use crate::TrainError;

/// The encoder, and what it makes of the photographs.
pub(crate) struct Semantic {
    clip: ClipVision,
    photographs: Vec<Tensor<1>>,
}

impl Semantic {
    /// Nothing if the term is off.
    pub(crate) fn new(config: &SemanticConfig, scene: &Scene, device: &Device) -> Result<Option<Self>, TrainError> {
        if config.weight == 0.0 {
            return Ok(None);
        }
        let clip = ClipVision::read(&config.weights, ClipConfig::VIT_B_32, device).map_err(|cause| {
            let expected = "expected a safetensors file of openai/clip-vit-base-patch32";
            TrainError::config(
                "loss.semantic.weights",
                format!("{expected}, found {}: {cause}", config.weights.display()),
            )
        })?;
        let embed = |view: &View| {
            let image = &view.image;
            let (height, width) = (image.height as usize, image.width as usize);
            let pixels = TensorData::new(image.rgb.as_flattened().to_vec(), [height * width, 3]);
            clip.embed(Tensor::from_data(pixels, device), (height, width)).detach()
        };
        let photographs = scene.train.iter().map(embed).collect();
        Ok(Some(Self { clip, photographs }))
    }

    /// Distance of a render (`[height·width, 3]`) from the photograph that `choose` picks of so many.
    pub(crate) fn loss(
        &self,
        render: Tensor<2>,
        size: (usize, usize),
        choose: impl FnOnce(usize) -> usize,
    ) -> Tensor<1> {
        let photograph = self.photographs[choose(self.photographs.len())].clone();
        semantic_loss(self.clip.embed(render, size), photograph)
    }
}
