//! Layers of image networks with fixed weights, on maps `[n, channels, height, width]`.
//!
//! Burn computes them on every device. Its `flex` backend unfolds 512 output pixels of a convolution at a time, so that a
//! layer takes the memory of its input (twice) and output, whatever its kernel.

use burn::tensor::activation::relu;
use burn::tensor::module::{avg_pool2d, conv2d, max_pool2d};
use burn::tensor::ops::{AvgPoolOptions, ConvOptions, MaxPoolOptions};
use burn::tensor::{Device, Tensor, TensorData};

/// Kernel, stride and zero padding of a convolution or pooling; sides are (height, width).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) kernel: [usize; 2],
    pub(crate) stride: usize,
    pub(crate) padding: [usize; 2],
}

impl Window {
    pub(crate) const fn square(kernel: usize, stride: usize, padding: usize) -> Self {
        Self { kernel: [kernel; 2], stride, padding: [padding; 2] }
    }

    /// Returns the size of the output for an input of `size`, or `None` if no window fits.
    pub(crate) fn output(self, size: [usize; 2]) -> Option<[usize; 2]> {
        let free = |axis: usize| (size[axis] + 2 * self.padding[axis]).checked_sub(self.kernel[axis]);
        Some([free(0)?, free(1)?].map(|free| free / self.stride + 1))
    }
}

/// Convolution with fixed weights and a rectifier, `max(0, W ∗ x + b)`.
pub(crate) struct Convolution {
    pub(crate) window: Window,
    weight: Tensor<4>,
    bias: Tensor<1>,
}

impl Convolution {
    /// Uploads `weight`, `[outputs, inputs, kh, kw]` as in PyTorch, and `bias` to `device`.
    pub(crate) fn new(
        window: Window,
        [inputs, outputs]: [usize; 2],
        (weight, bias): (Vec<f32>, Vec<f32>),
        device: &Device,
    ) -> Self {
        let shape = [outputs, inputs, window.kernel[0], window.kernel[1]];
        let weight = Tensor::from_data(TensorData::new(weight, shape), device);
        Self { window, weight, bias: Tensor::from_data(TensorData::new(bias, [outputs]), device) }
    }

    pub(crate) fn forward(&self, x: Tensor<4>) -> Tensor<4> {
        let Window { stride, padding, .. } = self.window;
        let options = ConvOptions::new([stride; 2], padding, [1, 1], 1);
        relu(conv2d(x, self.weight.clone(), Some(self.bias.clone()), options))
    }
}

pub(crate) fn max_pool(x: Tensor<4>, window: Window) -> Tensor<4> {
    if window == Window::square(2, 2, 0) {
        // On the host, Burn's pooling takes 2.5 times as long.
        let [n, channels, height, width] = x.dims();
        let [height, width] = [height / 2, width / 2];
        let whole = x.narrow(2, 0, 2 * height).narrow(3, 0, 2 * width);
        let rows = whole.reshape([n * channels, height, 2, 2 * width]);
        let rows = rows.clone().narrow(2, 0, 1).max_pair(rows.narrow(2, 1, 1));
        return rows.reshape([n * channels, height, width, 2]).max_dim(3).reshape([n, channels, height, width]);
    }
    let options = MaxPoolOptions::new(window.kernel).with_stride([window.stride; 2]).with_padding(window.padding);
    max_pool2d(x, options)
}

/// Takes the mean of each window; padding does not count.
pub(crate) fn mean_pool(x: Tensor<4>, window: Window) -> Tensor<4> {
    let options = AvgPoolOptions::new(window.kernel)
        .with_stride([window.stride; 2])
        .with_padding(window.padding)
        .with_count_include_pad(false);
    avg_pool2d(x, options)
}

/// Uploads pixels with channels innermost, `[n, height, width, 3]`, as maps.
pub(crate) fn maps_of_pixels(values: Vec<f32>, [n, height, width]: [usize; 3], device: &Device) -> Tensor<4> {
    let data = TensorData::new(values, [n, height, width, 3]);
    Tensor::<4>::from_data(data, device).permute([0, 3, 1, 2])
}
