//! The image encoder of CLIP (Radford et al. 2021), a vision transformer (Dosovitskiy et al. 2021).

use std::path::Path;

use burn::tensor::activation::{sigmoid, softmax};
use burn::tensor::module::{adaptive_avg_pool2d, conv2d, layer_norm};
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor};
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
    patch: Tensor<4>,
    class: Tensor<2>,
    position: Tensor<2>,
    before: ClipNorm,
    layers: Vec<TransformerLayer>,
    after: ClipNorm,
    projection: Tensor<2>,
}

struct ClipNorm {
    gamma: Tensor<1>,
    beta: Tensor<1>,
}

/// Dense layer, x W + b.
struct ClipDense {
    weight: Tensor<2>,
    bias: Tensor<1>,
}

struct TransformerLayer {
    norm1: ClipNorm,
    query: ClipDense,
    key: ClipDense,
    value: ClipDense,
    out: ClipDense,
    norm2: ClipNorm,
    up: ClipDense,
    down: ClipDense,
}

impl ClipNorm {
    fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        layer_norm(x, self.gamma.clone(), Some(self.beta.clone()), EPSILON)
    }
}

impl ClipDense {
    fn forward(&self, x: Tensor<2>) -> Tensor<2> {
        x.matmul(self.weight.clone()) + self.bias.clone().unsqueeze::<2>()
    }
}

impl TransformerLayer {
    /// Computes x + attention(norm(x)), then x + MLP(norm(x)); `[T, width]`.
    fn forward(&self, x: Tensor<2>, heads: usize) -> Tensor<2> {
        let x = x.clone() + self.attention(self.norm1.forward(x), heads);
        let h = self.up.forward(self.norm2.forward(x.clone()));
        // CLIP was trained with the activation x·σ(1.702 x).
        x + self.down.forward(h.clone() * sigmoid(h * 1.702))
    }

    fn attention(&self, x: Tensor<2>, heads: usize) -> Tensor<2> {
        let [tokens, width] = x.dims();
        let size = width / heads;
        let split = |dense: &ClipDense| dense.forward(x.clone()).reshape([tokens, heads, size]).swap_dims(0, 1);
        let scores = split(&self.query).matmul(split(&self.key).swap_dims(1, 2)) / (size as f32).sqrt();
        let mixed = softmax(scores, 2).matmul(split(&self.value));
        self.out.forward(mixed.swap_dims(0, 1).reshape([tokens, width]))
    }
}

impl ClipVision {
    /// Reads the encoder from a weight file with the names that the published model has at Hugging Face
    /// (`openai/clip-vit-base-patch32`); other tensors in the file are ignored.
    ///
    /// # Errors
    /// One line if the file cannot be read, or a tensor is missing or has another shape.
    pub fn read(path: &Path, config: ClipConfig, device: &Device) -> Result<Self, String> {
        let file = ClipReader { file: WeightFile::read(path)?, device };
        let ClipConfig { image, patch, width, hidden, embedding, .. } = config;
        let embeddings = "vision_model.embeddings";
        let tokens = 1 + (image / patch).pow(2);
        let projection = file.file.tensor::<2>("visual_projection.weight", [embedding, width], device)?;
        Ok(Self {
            patch: file.file.tensor(
                &format!("{embeddings}.patch_embedding.weight"),
                [width, 3, patch, patch],
                device,
            )?,
            class: file.file.tensor::<1>(&format!("{embeddings}.class_embedding"), [width], device)?.unsqueeze(),
            position: file.file.tensor(&format!("{embeddings}.position_embedding.weight"), [tokens, width], device)?,
            // The published name has no "e" in it.
            before: file.norm("vision_model.pre_layrnorm", width)?,
            layers: (0..config.layers).map(|index| file.layer(index, width, hidden)).collect::<Result<_, _>>()?,
            after: file.norm("vision_model.post_layernorm", width)?,
            projection: projection.transpose(),
            config,
        })
    }

    /// Computes the unit-length embedding, `[embedding]`, of an image of `size` = (height, width): colours in [0, 1], one pixel
    /// a row, `[height·width, 3]`. The image is resized first: averaged over areas if it is larger, else bilinear.
    pub fn embed(&self, picture: Tensor<2>, size: (usize, usize)) -> Tensor<1> {
        let ClipConfig { image, patch, width, heads, .. } = self.config;
        let device = picture.device();
        let channels = |values: [f32; 3]| Tensor::<1>::from_floats(values, &device).reshape([1, 3, 1, 1]);
        let pixels = (self.resized(picture, size) - channels(MEAN)) / channels(DEVIATION);
        let options = ConvOptions::new([patch, patch], [0, 0], [1, 1], 1);
        let patches = conv2d(pixels, self.patch.clone(), None, options);
        let patches = patches.reshape([width, (image / patch).pow(2)]).transpose();
        let tokens = Tensor::cat(vec![self.class.clone(), patches], 0) + self.position.clone();
        let tokens = self.layers.iter().fold(self.before.forward(tokens), |tokens, layer| layer.forward(tokens, heads));
        let class = self.after.forward(tokens.narrow(0, 0, 1));
        let embedding = class.matmul(self.projection.clone()).squeeze_dim::<1>(0);
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

struct ClipReader<'a> {
    file: WeightFile,
    device: &'a Device,
}

impl ClipReader<'_> {
    fn norm(&self, name: &str, width: usize) -> Result<ClipNorm, String> {
        Ok(ClipNorm {
            gamma: self.file.tensor(&format!("{name}.weight"), [width], self.device)?,
            beta: self.file.tensor(&format!("{name}.bias"), [width], self.device)?,
        })
    }

    fn dense(&self, name: &str, inputs: usize, outputs: usize) -> Result<ClipDense, String> {
        let weight = self.file.tensor::<2>(&format!("{name}.weight"), [outputs, inputs], self.device)?;
        let bias = self.file.tensor(&format!("{name}.bias"), [outputs], self.device)?;
        Ok(ClipDense { weight: weight.transpose(), bias })
    }

    fn layer(&self, index: usize, width: usize, hidden: usize) -> Result<TransformerLayer, String> {
        let name = format!("vision_model.encoder.layers.{index}");
        let projection = |part: &str| self.dense(&format!("{name}.self_attn.{part}_proj"), width, width);
        Ok(TransformerLayer {
            norm1: self.norm(&format!("{name}.layer_norm1"), width)?,
            query: projection("q")?,
            key: projection("k")?,
            value: projection("v")?,
            out: projection("out")?,
            norm2: self.norm(&format!("{name}.layer_norm2"), width)?,
            up: self.dense(&format!("{name}.mlp.fc1"), width, hidden)?,
            down: self.dense(&format!("{name}.mlp.fc2"), hidden, width)?,
        })
    }
}
