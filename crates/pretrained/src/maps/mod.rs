//! Stacks of feature maps, and the layers that image networks with fixed weights are made of.
//!
//! Every layer has two bodies, tested against each other: one over slices for CPUs, one of Burn's tensor operations for all
//! other devices. Almost all time goes into convolutions, which take half as long on the host as `conv2d` of Burn's `flex`
//! backend.

mod concatenate;
mod convolution;
mod host;
mod pool;
mod window;
mod winograd;

pub(crate) use concatenate::concatenate;
pub(crate) use convolution::Convolution;
pub(crate) use host::HostMaps;
pub(crate) use pool::{max_pool, mean_pool, means};
pub(crate) use window::Window;

use burn::tensor::{Device, Tensor, TensorData};
use infonerf_ops::has_host_kernels;

/// Feature maps of `n` pictures.
#[derive(Clone)]
pub(crate) enum Maps {
    /// Where the host's kernels serve.
    Host(HostMaps),
    /// Elsewhere, `[n, channels, height, width]`.
    Device(Tensor<4>),
}

impl Maps {
    /// Maps of `values`, `[n, height, width, channels]`.
    pub(crate) fn new(values: Vec<f32>, shape: [usize; 4], device: &Device) -> Self {
        if has_host_kernels(device) {
            return Self::Host(HostMaps::new(values, shape));
        }
        Self::Device(Tensor::<4>::from_data(TensorData::new(values, shape), device).permute([0, 3, 1, 2]))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// One whose layers are the host's kernels, and one whose layers are Burn's.
    #[allow(deprecated, reason = "the older CPU backend has Burn's own layers")]
    pub(crate) fn devices() -> [Device; 2] {
        [Device::flex(), Device::ndarray()]
    }

    /// Numbers in [−1, 1) that look random.
    fn numbers(count: usize, seed: usize) -> Vec<f32> {
        let number = |i: usize| ((i * 7919 + seed * 104_729) % 2048 * ((i + seed) % 331)) as f32 % 997.0 / 498.5 - 1.0;
        (0..count).map(number).collect()
    }

    /// Values in the order of `[n, channels, height, width]`.
    fn values(maps: &Maps) -> (Vec<usize>, Vec<f32>) {
        let tensor = match maps {
            Maps::Device(tensor) => tensor.clone(),
            Maps::Host(maps) => {
                let data = TensorData::new(maps.values().to_vec(), maps.shape);
                Tensor::<4>::from_data(data, &devices()[1]).permute([0, 3, 1, 2])
            }
        };
        (tensor.dims().to_vec(), infonerf_ops::to_host(tensor))
    }

    /// Both bodies of `layer` on maps of `shape`, `[n, height, width, channels]`.
    fn compare(shape: [usize; 4], layer: impl Fn(&Maps, &Device) -> Maps) {
        compare_within(1e-5, shape, layer);
    }

    fn compare_within(epsilon: f32, shape: [usize; 4], layer: impl Fn(&Maps, &Device) -> Maps) {
        let of =
            |device: &Device| values(&layer(&Maps::new(numbers(shape.iter().product(), 1), shape, device), device));
        let [(host_shape, host), (shape, expected)] = devices().map(|device| of(&device));
        assert_eq!(host_shape, shape);
        for (host, expected) in host.iter().zip(&expected) {
            approx::assert_relative_eq!(host, expected, epsilon = epsilon, max_relative = epsilon);
        }
        assert!(expected.iter().any(|value| *value != 0.0));
    }

    #[test]
    fn flex_has_the_kernels_of_the_host_and_ndarray_those_of_burn() {
        let is_host = devices().map(|device| matches!(Maps::new(vec![0.0], [1; 4], &device), Maps::Host(_)));
        assert_eq!(is_host, [true, false]);
        assert!(matches!(Maps::new(vec![0.0], [1; 4], &Device::flex().autodiff()), Maps::Host(_)));
    }

    #[test]
    fn convolutions_agree() {
        let windows = [
            Window::square(3, 1, 1),
            Window::square(11, 4, 2),
            Window::square(1, 1, 0),
            Window::square(3, 2, 0),
            Window { kernel: [1, 7], stride: 1, padding: [0, 3] },
            Window { kernel: [7, 1], stride: 1, padding: [3, 0] },
        ];
        for (channels, window) in windows.into_iter().flat_map(|window| [[3, 5], [8, 2]].map(|c| (c, window))) {
            let [inputs, outputs] = channels;
            compare([2, 13, 9, inputs], |x, device| {
                let weight = numbers(outputs * inputs * window.kernel[0] * window.kernel[1], 2);
                let bias = numbers(outputs, 3);
                Convolution::new(window, channels, (weight, bias), device).forward(x)
            });
        }
    }

    #[test]
    fn large_maps_are_worked_through_in_groups() {
        let window = Window::square(3, 1, 1);
        compare([1, 70, 61, 4], |x, device| {
            Convolution::new(window, [4, 6], (numbers(6 * 4 * 9, 2), numbers(6, 3)), device).forward(x)
        });
    }

    #[test]
    fn tiles_and_what_they_reach_beyond_agree() {
        for size in [[4, 4], [13, 9], [70, 61]] {
            // Sums of 144 products of up to 1, of which little is left: 1e-5 of their absolute values.
            // 48 outputs: a strip of weights and half of one.
            compare_within(2e-4, [2, size[0], size[1], 16], |x, device| {
                let weights = (numbers(48 * 16 * 9, 2), numbers(48, 3));
                Convolution::new(Window::square(3, 1, 1), [16, 48], weights, device).forward(x)
            });
        }
    }

    #[test]
    fn pooling_agrees() {
        for window in [Window::square(3, 2, 0), Window::square(2, 2, 0), Window::square(3, 1, 1)] {
            compare([2, 7, 10, 3], |x, _| max_pool(x, window));
            compare([2, 7, 10, 3], |x, _| mean_pool(x, window));
        }
        let [host, expected] =
            devices().map(|device| means(&Maps::new(numbers(2 * 6 * 5 * 3, 4), [2, 6, 5, 3], &device)));
        for (host, expected) in host.iter().flatten().zip(expected.iter().flatten()) {
            approx::assert_abs_diff_eq!(host, expected, epsilon = 1e-6);
        }
    }

    #[test]
    fn what_was_in_a_room_is_gone() {
        for _ in 0..2 {
            drop(HostMaps::new(vec![f32::NAN; 4096], [1, 64, 64, 1]));
            compare([1, 16, 16, 4], |x, _| max_pool(x, Window::square(3, 1, 1)));
            compare([1, 16, 16, 4], |x, _| mean_pool(x, Window::square(3, 1, 1)));
        }
    }

    #[test]
    fn concatenation_agrees() {
        compare([2, 4, 5, 3], |x, _| {
            concatenate([x.clone(), max_pool(x, Window::square(3, 1, 1)), mean_pool(x, Window::square(3, 1, 1))])
        });
    }
}
