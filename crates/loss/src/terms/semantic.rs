use std::path::PathBuf;

use burn::tensor::{Device, Tensor};
use infonerf_ops::upload;
use infonerf_pretrained::{ClipConfig, ClipVision};
use infonerf_scene::{Scene, View};
use infonerf_schedule::{Fault, Moment, Schedule};
use serde::{Deserialize, Serialize};

use crate::renders::{Need, Renders};
use crate::term::{Term, TermSpec};

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
        Fault::unless_within(1..=1_000_000_000, "every", self.every)?;
        Fault::unless_within(1..=1024, "size", self.size)
    }

    fn build(&self, scene: &Scene, device: &Device) -> Result<Box<dyn Term>, Fault> {
        let clip = ClipVision::read(&self.weights, ClipConfig::VIT_B_32, device).map_err(|cause| {
            let expected = "the tensors of openai/clip-vit-base-patch32, as safetensors or PyTorch's";
            Fault::new("weights", expected, cause)
        })?;
        Ok(Box::new(SemanticTerm::new(self, clip, scene, device)))
    }

    fn weights_file(&mut self) -> Option<(&'static str, &mut PathBuf)> {
        Some(("weights", &mut self.weights))
    }
}

struct SemanticTerm {
    every: usize,
    clip: ClipVision,
    targets: Vec<Tensor<1>>,
}

impl SemanticTerm {
    fn new(config: &SemanticConfig, clip: ClipVision, scene: &Scene, device: &Device) -> Self {
        let embed = |View { image, .. }: &View| {
            let pixels = upload(image.rgb.as_flattened().to_vec(), [image.rgb.len(), 3], device);
            clip.embed(pixels, (image.height as usize, image.width as usize)).detach()
        };
        let targets = scene.train.iter().map(embed).collect();
        Self { every: config.every, clip, targets }
    }
}

impl Term for SemanticTerm {
    fn value(&self, renders: &Renders) -> Tensor<1> {
        let picture = renders.picture.as_ref().expect("an image is needed");
        let embedding = self.clip.embed(picture.rgb.clone(), picture.size);
        semantic_loss(embedding, self.targets[picture.view].clone())
    }

    fn is_due(&self, at: Moment) -> bool {
        at.step.is_multiple_of(self.every)
    }
}

/// Computes 1 − φᵀφ̂ of two unit-length embeddings, a scalar in [0, 2].
pub fn semantic_loss(embedding: Tensor<1>, target: Tensor<1>) -> Tensor<1> {
    (embedding * target).sum().neg() + 1.0
}

#[cfg(test)]
mod tests {
    use infonerf_ops::to_host;
    use infonerf_scene::{Camera, Image};

    use super::*;
    use crate::renders::UnseenImage;
    use crate::testing::{config, scenario};

    /// Writes a small encoder as safetensors: the header's length, the header, and the numbers.
    fn write_clip(config: ClipConfig, path: &std::path::Path) {
        let (mut tensors, mut numbers) = (Vec::new(), Vec::new());
        for (name, shape) in config.tensors() {
            let (start, count): (usize, usize) = (numbers.len(), shape.iter().product());
            numbers.extend((0..count).flat_map(|i| (((i * 37 + start) % 23) as f32 / 23.0 - 0.4).to_le_bytes()));
            let end = numbers.len();
            tensors.push(format!(r#""{name}":{{"dtype":"F32","shape":{shape:?},"data_offsets":[{start},{end}]}}"#));
        }
        let header = format!("{{{}}}", tensors.join(","));
        std::fs::write(path, [&(header.len() as u64).to_le_bytes(), header.as_bytes(), &numbers].concat()).unwrap();
    }

    /// Checks that the loss is 0 for the training image of the picture's view and positive for that of another view, and that
    /// the term is due every tenth step.
    #[test]
    fn a_picture_is_compared_with_the_training_image_of_its_view() {
        let sizes = ClipConfig { image: 8, patch: 4, width: 8, layers: 1, heads: 2, hidden: 8, embedding: 4 };
        let path = std::env::temp_dir().join(format!("infonerf-clip-{}.safetensors", std::process::id()));
        write_clip(sizes, &path);
        let device = Device::flex();
        let clip = ClipVision::read(&path, sizes, &device).unwrap();
        std::fs::remove_file(&path).unwrap();
        let image = |grey: f32| {
            let rgb = (0..6 * 4).map(|i| [grey, (grey * i as f32).fract(), 1.0 - grey]).collect();
            Image { width: 6, height: 4, rgb, alpha: None }
        };
        let camera = Camera::from_fov(6, 4, 1.0, glam::DMat4::IDENTITY);
        let views = [0.1, 0.9].map(|grey| View::new(0, "", camera.clone(), image(grey)));
        let scene = Scene { train: views.to_vec(), ..Scene::default() };
        let term = SemanticTerm::new(&config("").semantic, clip, &scene, &device);
        let (_, mut renders) = scenario(&device);
        let mut distance = |view: usize| {
            let rgb = upload(image(0.9).rgb.as_flattened().to_vec(), [24, 3], &device);
            renders.picture = Some(UnseenImage { rgb, size: (4, 6), view });
            term.value(&renders).into_scalar::<f32>()
        };
        assert!(distance(1).abs() < 1e-5 && distance(0) > 1e-5, "{} {}", distance(1), distance(0));
        let is_due = |step| term.is_due(Moment { step, progress: 0.5 });
        assert_eq!([0, 9, 10, 11].map(is_due), [true, false, true, false]);
    }

    #[test]
    fn the_loss_is_a_distance_on_the_sphere_and_its_gradient_the_target() {
        let device = Device::flex().autodiff();
        let pairs = [([0.6, 0.8], [0.6, 0.8], 0.0), ([1.0, 0.0], [0.0, 1.0], 1.0), ([0.0, -1.0], [0.0, 1.0], 2.0)];
        for (a, b, want) in pairs {
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
        let fault = config.build(&Scene::default(), &Device::flex()).err().unwrap();
        assert!(fault.key == "weights" && fault.found.starts_with("absent.safetensors: "), "{fault}");
    }
}
