//! The MLP of NeRF (Mildenhall et al. 2020, Fig. 7).

use burn::module::Module;
use burn::nn::Linear;
use burn::tensor::{Device, Tensor, TensorData, activation::relu, activation::sigmoid};
use infonerf_ops::frequency::{encoded_width, frequency_encode};
use rand::Rng;

use crate::{NerfConfig, Points, Sampled, init::linear};

/// Encoded position → trunk of ReLU layers with one skip → density; trunk features and encoded direction → colour.
#[derive(Module, Debug)]
pub struct NerfMlp {
    trunk: Vec<Linear>,
    sigma: Linear,
    feature: Linear,
    view: Linear,
    rgb: Linear,
    #[module(skip)]
    config: NerfConfig,
}

impl NerfMlp {
    pub(crate) fn new(config: &NerfConfig, rng: &mut impl Rng, device: &Device) -> Self {
        let position = encoded_width(3, config.position_octaves);
        let direction = encoded_width(3, config.direction_octaves);
        let width = config.width;
        let trunk = (0..config.layers)
            .map(|layer| {
                let fan_in = match layer {
                    0 => position,
                    layer if layer == config.skip => width + position,
                    _ => width,
                };
                linear(rng, fan_in, width, device)
            })
            .collect();
        Self {
            trunk,
            sigma: linear(rng, width, 1, device),
            feature: linear(rng, width, width, device),
            view: linear(rng, width + direction, width / 2, device),
            rgb: linear(rng, width / 2, 3, device),
            config: config.clone(),
        }
    }

    pub(crate) fn evaluate(&self, points: Points<'_>, color: bool, progress: f32) -> Sampled {
        let window = anneal_window(self.config.position_octaves, self.config.anneal, progress);
        let device = self.device();
        let encoded = frequency_encode(points.positions, 3, self.config.position_octaves, &window, &device);
        let mut h = encoded.clone();
        for (layer, linear) in self.trunk.iter().enumerate() {
            if layer > 0 && layer == self.config.skip {
                h = Tensor::cat(vec![encoded.clone(), h], 1);
            }
            h = relu(linear.forward(h));
        }
        let raw = self.sigma.forward(h.clone()).squeeze_dim(1);
        Sampled { sigma: self.config.density.apply(raw), color: color.then(|| self.color(h, points)) }
    }

    fn color(&self, trunk: Tensor<2>, points: Points<'_>) -> Tensor<2> {
        let feature = self.feature.forward(trunk);
        let direction = self.encode_directions(points);
        let h = relu(self.view.forward(Tensor::cat(vec![feature, direction], 1)));
        sigmoid(self.rgb.forward(h))
    }

    /// One encoded row a ray, repeated for each of its samples.
    fn encode_directions(&self, points: Points<'_>) -> Tensor<2> {
        let device = self.device();
        let width = encoded_width(3, self.config.direction_octaves);
        let rays = frequency_encode(points.directions, 3, self.config.direction_octaves, &[], &device);
        let rays = &infonerf_ops::to_host(rays);
        let rows: Vec<f32> = points
            .segments
            .ranges()
            .enumerate()
            .flat_map(|(ray, range)| range.flat_map(move |_| &rays[ray * width..(ray + 1) * width]))
            .copied()
            .collect();
        Tensor::from_data(TensorData::new(rows, [points.segments.samples(), width]), &device)
    }

    pub(crate) fn device(&self) -> Device {
        self.sigma.weight.val().device()
    }
}

/// Weight of each octave when training is `progress` of the way: 0 above the octave that is being faded in, 1 below.
fn anneal_window(octaves: usize, anneal: f32, progress: f32) -> Vec<f32> {
    if anneal <= 0.0 {
        return Vec::new();
    }
    let open = 1.0 + octaves as f32 * progress / anneal;
    (0..octaves).map(|octave| (open - octave as f32).clamp(0.0, 1.0)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_window_opens_from_the_lowest_octave() {
        assert!(anneal_window(4, 0.0, 0.0).is_empty());
        assert_eq!(anneal_window(4, 0.5, 0.0), [1.0, 0.0, 0.0, 0.0]);
        assert_eq!(anneal_window(4, 0.5, 0.1875), [1.0, 1.0, 0.5, 0.0]);
        assert_eq!(anneal_window(4, 0.5, 0.5), [1.0; 4]);
    }
}
