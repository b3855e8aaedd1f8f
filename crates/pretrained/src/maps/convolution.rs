use burn::tensor::activation::relu;
use burn::tensor::module::conv2d;
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData};
use infonerf_ops::has_host_kernels;
use infonerf_ops::matmul::{Matrix, Onto, product};
use rayon::prelude::*;

use super::winograd::Winograd;
use super::{HostMaps, Maps, Window};

/// A convolution with fixed weights and the rectifier behind it, `max(0, W ∗ x + b)`.
pub(crate) struct Convolution {
    window: Window,
    /// Inputs and outputs.
    channels: [usize; 2],
    weights: Weights,
}

enum Weights {
    /// Of a convolution that is worth it.
    Tiles(Winograd),
    /// `[kh, kw, inputs, outputs]`.
    Host { weight: Vec<f32>, bias: Vec<f32> },
    /// `[outputs, inputs, kh, kw]`, and the bias.
    Device(Box<(Tensor<4>, Tensor<1>)>),
}

/// About how many numbers of unfolded windows are in the cache at a time.
const COLUMNS: usize = 1 << 20;

impl Convolution {
    /// The convolution of `weight`, `[outputs, inputs, kh, kw]` as PyTorch has it, and `bias`, on `device`.
    ///
    /// # Panics
    /// If there are not as many numbers as `channels` (inputs and outputs) and the window say.
    pub(crate) fn new(
        window: Window,
        channels @ [inputs, outputs]: [usize; 2],
        (weight, bias): (Vec<f32>, Vec<f32>),
        device: &Device,
    ) -> Self {
        let places = window.kernel[0] * window.kernel[1];
        assert!(weight.len() == outputs * inputs * places && bias.len() == outputs, "weights of a convolution");
        let weights = if has_host_kernels(device) {
            let mut turned = vec![0.0; weight.len()];
            for (at, value) in weight.into_iter().enumerate() {
                let (output, input, place) = (at / (inputs * places), at / places % inputs, at % places);
                turned[(place * inputs + input) * outputs + output] = value;
            }
            if window == Window::square(3, 1, 1) && Winograd::suits(channels) {
                Weights::Tiles(Winograd::new(channels, &turned, bias))
            } else {
                Weights::Host { weight: turned, bias }
            }
        } else {
            let shape = [outputs, inputs, window.kernel[0], window.kernel[1]];
            let weight = Tensor::from_data(TensorData::new(weight, shape), device);
            Weights::Device(Box::new((weight, Tensor::from_data(TensorData::new(bias, [outputs]), device))))
        };
        Self { window, channels, weights }
    }

    /// # Panics
    /// If the maps are elsewhere, have other channels, or are smaller than the window.
    pub(crate) fn forward(&self, x: &Maps) -> Maps {
        match (x, &self.weights) {
            (Maps::Host(x), Weights::Host { weight, bias }) => Maps::Host(self.on_host(x, weight, bias)),
            (Maps::Host(x), Weights::Tiles(tiles)) => Maps::Host(tiles.forward(x)),
            (Maps::Device(x), Weights::Device(weights)) => {
                let (weight, bias) = weights.as_ref().clone();
                let Window { stride, padding, .. } = self.window;
                let options = ConvOptions::new([stride; 2], padding, [1, 1], 1);
                Maps::Device(relu(conv2d(x.clone(), weight, Some(bias), options)))
            }
            _ => panic!("weights and maps are on the same device"),
        }
    }

    /// Groups of output pixels in parallel: their windows are unfolded into rows, which are multiplied with the weights.
    fn on_host(&self, x: &HostMaps, weight: &[f32], bias: &[f32]) -> HostMaps {
        let [inputs, outputs] = self.channels;
        assert_eq!(x.channels(), inputs, "channels of a convolution's input");
        let [height, width] = self.window.output(x.size()).expect("maps are as large as the window");
        let row = weight.len() / outputs;
        let shape = [x.shape[0], height, width, outputs];
        let pixels = x.shape[0] * height * width;
        let group = (COLUMNS / row).min(pixels.div_ceil(4 * rayon::current_num_threads())).max(16);
        let mut maps = HostMaps::of(shape);
        maps.values_mut().par_chunks_mut(group * outputs).enumerate().for_each_init(
            || vec![0.0; group * row],
            |rows, (index, values)| {
                let count = values.len() / outputs;
                let rows = &mut rows[..count * row];
                self.unfold(x, [height, width], index * group, rows);
                let (y_at, x_at) = (Matrix::rows(0, outputs), Matrix::rows(0, row));
                product([count, outputs, row], Onto::Bias(bias), (values, y_at), (rows, x_at), (weight, y_at));
                values.iter_mut().for_each(|value| *value = value.max(0.0));
            },
        );
        maps
    }

    /// The windows of output pixels from `first` on, one after another, `[kh, kw, inputs]` each; 0 outside the maps.
    fn unfold(&self, x: &HostMaps, [height, width]: [usize; 2], first: usize, rows: &mut [f32]) {
        let [kernel_height, kernel_width] = self.window.kernel;
        let line = kernel_width * x.channels();
        for (pixel, row) in (first..).zip(rows.chunks_exact_mut(kernel_height * line)) {
            let (n, y, column) = (pixel / (height * width), pixel / width % height, pixel % width);
            let (lines, above) = self.window.seen(0, y, x.size()[0]);
            let (columns, left) = self.window.seen(1, column, x.size()[1]);
            let (start, length) = (left * x.channels(), columns.len() * x.channels());
            row.fill(0.0);
            for (line, source) in row.chunks_exact_mut(line).skip(above).zip(lines) {
                let at = ((n * x.size()[0] + source) * x.size()[1] + columns.start) * x.channels();
                line[start..start + length].copy_from_slice(&x.values()[at..at + length]);
            }
        }
    }
}
