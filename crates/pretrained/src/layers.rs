//! Layers of image networks with fixed weights, on maps `[n, channels, height, width]`.
//!
//! Burn computes them on every device.

use burn::tensor::activation::relu;
use burn::tensor::module::{avg_pool2d, conv2d, max_pool2d};
use burn::tensor::ops::{AvgPoolOptions, ConvOptions, MaxPoolOptions, PadMode};
use burn::tensor::{Device, Tensor, TensorData};
use infonerf_ops::has_host_kernels;

/// Output pixels of a convolution on the host that are summed at a time, so that the sums stay in the cache.
const STRIP: usize = 1 << 12;

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
    window: Window,
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
        if stride == 1 && has_host_kernels(&x.device()) {
            return relu(self.products(x) + self.bias.clone().reshape([1, -1, 1, 1]));
        }
        let options = ConvOptions::new([stride; 2], padding, [1, 1], 1);
        relu(conv2d(x, self.weight.clone(), Some(self.bias.clone()), options))
    }

    /// Computes W ∗ x of stride 1 as a sum of matrix products, one for each element of the kernel. Their inputs are views
    /// of one padded map, whose rows follow each other without a gap: an element at (y, x) shifts it by y rows and x pixels.
    /// VGG takes half the time of Burn's convolution, which copies the pixels of every window.
    fn products(&self, x: Tensor<4>) -> Tensor<4> {
        let ([n, inputs, height, width], Window { kernel, padding, .. }) = (x.dims(), self.window);
        let [rows, columns] = self.window.output([height, width]).expect("a window fits");
        let row = width + 2 * padding[1];
        // The last shifts reach into a row below.
        let sides = (padding[1], padding[1], padding[0], padding[0] + 1);
        let x = x.pad(sides, PadMode::Constant(0.0)).reshape([n, inputs, (height + 2 * padding[0] + 1) * row]);
        let shifts: Vec<[usize; 2]> = (0..kernel[0]).flat_map(|y| (0..kernel[1]).map(move |x| [y, x])).collect();
        let weight = |[y, x]: [usize; 2]| {
            let weight = self.weight.clone().narrow(2, y, 1).narrow(3, x, 1);
            weight.reshape([1, self.bias.dims()[0], inputs])
        };
        let weights: Vec<Tensor<3>> = shifts.iter().map(|&shift| weight(shift)).collect();
        let strip = STRIP.div_ceil(row);
        let strips = (0..rows).step_by(strip).map(|first| {
            let length = strip.min(rows - first) * row;
            let product = |(&[down, right], weight): (&[usize; 2], &Tensor<3>)| {
                weight.clone().matmul(x.clone().narrow(2, (first + down) * row + right, length))
            };
            let products = shifts.iter().zip(&weights).map(product);
            products.reduce(|sum, product| sum + product).expect("a kernel has elements")
        });
        Tensor::cat(strips.collect(), 2).reshape([n, self.bias.dims()[0], rows, row]).narrow(3, 0, columns)
    }
}

pub(crate) fn max_pool(x: Tensor<4>, window: Window) -> Tensor<4> {
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
