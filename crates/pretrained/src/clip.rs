//! The image encoder of CLIP (Radford et al. 2021), a vision transformer (Dosovitskiy et al. 2021).

use std::collections::HashMap;
use std::path::Path;

use burn::tensor::activation::{sigmoid, softmax};
use burn::tensor::module::{adaptive_avg_pool2d, conv2d, layer_norm};
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData};
use infonerf_ops::bilinear::{Taps, bilinear};

use crate::file::{TensorShape, WeightFile};

/// Sizes of [`ClipVision`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ClipConfig {
    /// Side of the square input image, pixels.
    pub image: usize,
    /// Side of a patch, pixels.
    pub patch: usize,
    /// Width of the transformer.
    pub width: usize,
    /// Layers of the transformer.
    pub layers: usize,
    /// Heads of each layer.
    pub heads: usize,
    /// Hidden width of each layer's MLP.
    pub hidden: usize,
    /// Length of an embedding.
    pub embedding: usize,
}

impl ClipConfig {
    /// ViT-B/32, as in DietNeRF.
    pub const VIT_B_32: Self =
        Self { image: 224, patch: 32, width: 768, layers: 12, heads: 12, hidden: 3072, embedding: 512 };

    /// Returns names and shapes of the encoder's tensors, as at Hugging Face.
    pub fn tensors(&self) -> Vec<TensorShape> {
        let Self { image, patch, width, hidden, .. } = *self;
        let embeddings = "vision_model.embeddings";
        let tokens = 1 + (image / patch).pow(2);
        let mut tensors = vec![
            (format!("{embeddings}.class_embedding"), vec![width]),
            (format!("{embeddings}.patch_embedding.weight"), vec![width, 3, patch, patch]),
            (format!("{embeddings}.position_embedding.weight"), vec![tokens, width]),
            ("visual_projection.weight".to_owned(), vec![self.embedding, width]),
        ];
        let mut weight_and_bias = |name: &str, shape: &[usize]| {
            tensors.push((format!("{name}.weight"), shape.to_vec()));
            tensors.push((format!("{name}.bias"), vec![shape[0]]));
        };
        weight_and_bias("vision_model.pre_layrnorm", &[width]);
        weight_and_bias("vision_model.post_layernorm", &[width]);
        for layer in 0..self.layers {
            let part = |part: &str| format!("vision_model.encoder.layers.{layer}.{part}");
            for projection in ["q", "k", "v", "out"] {
                weight_and_bias(&part(&format!("self_attn.{projection}_proj")), &[width, width]);
            }
            weight_and_bias(&part("layer_norm1"), &[width]);
            weight_and_bias(&part("layer_norm2"), &[width]);
            weight_and_bias(&part("mlp.fc1"), &[hidden, width]);
            weight_and_bias(&part("mlp.fc2"), &[width, hidden]);
        }
        tensors
    }
}

/// Mean and standard deviation of each channel of the images that CLIP was trained on.
const MEAN: [f32; 3] = [0.481_454_66, 0.457_827_5, 0.408_210_73];
const DEVIATION: [f32; 3] = [0.268_629_54, 0.261_302_6, 0.275_777_1];
const EPSILON: f64 = 1e-5;

/// Image encoder of CLIP with fixed weights; gradients flow to the image alone.
pub struct ClipVision {
    config: ClipConfig,
    /// Tensors by their published name: `[1, n]` if they have one axis, `[first axis, all others]` else.
    weights: HashMap<String, Tensor<2>>,
}

impl ClipVision {
    /// Reads the encoder from a weight file with the names that the published model has at Hugging Face
    /// (`openai/clip-vit-base-patch32`); other tensors in the file are ignored.
    ///
    /// # Errors
    /// One line if the file cannot be read, or a tensor is missing or has another shape.
    pub fn read(path: &Path, config: ClipConfig, device: &Device) -> Result<Self, String> {
        let file = WeightFile::read(path)?;
        let load = |(name, shape): TensorShape| {
            let values = file.floats(&name, &shape)?;
            let rows = if shape.len() == 1 { 1 } else { shape[0] };
            let matrix = [rows, values.len() / rows];
            Ok((name, Tensor::from_data(TensorData::new(values, matrix), device)))
        };
        let weights = config.tensors().into_iter().map(load).collect::<Result<_, String>>()?;
        Ok(Self { config, weights })
    }

    fn weight(&self, name: &str) -> Tensor<2> {
        self.weights[name].clone()
    }

    fn norm(&self, name: &str, x: Tensor<2>) -> Tensor<2> {
        let [gamma, beta] = ["weight", "bias"].map(|part| self.weight(&format!("{name}.{part}")).squeeze_dim::<1>(0));
        layer_norm(x, gamma, Some(beta), EPSILON)
    }

    fn dense(&self, name: &str, x: Tensor<2>) -> Tensor<2> {
        x.matmul(self.weight(&format!("{name}.weight")).transpose()) + self.weight(&format!("{name}.bias"))
    }

    /// Computes x + attention(norm(x)), then x + MLP(norm(x)); `[T, width]`.
    fn layer(&self, index: usize, x: Tensor<2>) -> Tensor<2> {
        let part = |part: &str| format!("vision_model.encoder.layers.{index}.{part}");
        let x = x.clone() + self.attention(&part("self_attn"), self.norm(&part("layer_norm1"), x));
        let h = self.dense(&part("mlp.fc1"), self.norm(&part("layer_norm2"), x.clone()));
        // CLIP was trained with the activation x·σ(1.702 x).
        x + self.dense(&part("mlp.fc2"), h.clone() * sigmoid(h * 1.702))
    }

    fn attention(&self, name: &str, x: Tensor<2>) -> Tensor<2> {
        let ([tokens, width], heads) = (x.dims(), self.config.heads);
        let size = width / heads;
        let [query, key, value] = ["q", "k", "v"].map(|part| {
            let projection = self.dense(&format!("{name}.{part}_proj"), x.clone());
            projection.reshape([tokens, heads, size]).swap_dims(0, 1)
        });
        let scores = query.matmul(key.swap_dims(1, 2)) / (size as f32).sqrt();
        let mixed = softmax(scores, 2).matmul(value);
        self.dense(&format!("{name}.out_proj"), mixed.swap_dims(0, 1).reshape([tokens, width]))
    }

    /// Computes the unit-length embedding, `[embedding]`, of an image of `size` = (height, width): colours in [0, 1], one pixel
    /// a row, `[height·width, 3]`. The image is resized first: averaged over areas if it is larger, else bilinear.
    pub fn embed(&self, picture: Tensor<2>, size: (usize, usize)) -> Tensor<1> {
        let ClipConfig { image, patch, width, layers, .. } = self.config;
        let embeddings = |part: &str| self.weight(&format!("vision_model.embeddings.{part}"));
        let device = picture.device();
        let channels = |values: [f32; 3]| Tensor::<1>::from_floats(values, &device).reshape([1, 3, 1, 1]);
        let pixels = (self.resized(picture, size) - channels(MEAN)) / channels(DEVIATION);
        let options = ConvOptions::new([patch, patch], [0, 0], [1, 1], 1);
        let kernel = embeddings("patch_embedding.weight").reshape([width, 3, patch, patch]);
        let patches = conv2d(pixels, kernel, None, options).reshape([width, (image / patch).pow(2)]).transpose();
        let position = embeddings("position_embedding.weight");
        let tokens = Tensor::cat(vec![embeddings("class_embedding"), patches], 0) + position;
        // The published name has no "e" in it.
        let tokens = self.norm("vision_model.pre_layrnorm", tokens);
        let tokens = (0..layers).fold(tokens, |tokens, index| self.layer(index, tokens));
        let class = self.norm("vision_model.post_layernorm", tokens.narrow(0, 0, 1));
        let embedding = class.matmul(self.weight("visual_projection.weight").transpose()).squeeze_dim::<1>(0);
        let length = embedding.clone().square().sum().sqrt();
        embedding / length
    }

    /// Resizes `[height·width, 3]` to `[1, 3, image, image]`.
    fn resized(&self, picture: Tensor<2>, (height, width): (usize, usize)) -> Tensor<4> {
        let side = self.config.image;
        let planes = |rows: Tensor<2>, height, width| rows.transpose().reshape([1, 3, height, width]);
        if height >= side && width >= side {
            return adaptive_avg_pool2d(planes(picture, height, width), [side, side]);
        }
        planes(bilinear(picture, &Taps::resize(1, (height, width), (side, side))), side, side)
    }
}
