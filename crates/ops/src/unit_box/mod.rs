//! Positions in the coordinates of a box.

#[cfg(feature = "flex")]
mod host;

use burn::tensor::Tensor;

use crate::dispatch::dispatch;
use crate::traffic::upload;

/// Maps `positions` `[M, 3]` into the unit cube, clamped: min(max((x − low)/(high − low), 0), 1) of each axis. Differentiable;
/// the gradient is 0 outside the box.
pub fn unit_box(positions: Tensor<2>, bounds: [[f32; 3]; 2]) -> Tensor<2> {
    dispatch! {
        &positions.device();
        host => crate::host::apply(host::UnitBoxKernel { bounds }, positions.dims(), [positions.into_dispatch()]),
        plain => {
            let [low, high] = bounds;
            let scale = [0, 1, 2].map(|axis| 1.0 / (high[axis] - low[axis]));
            let [low, scale] = [low, scale].map(|row| upload(row.to_vec(), [1, 3], &positions.device()));
            ((positions - low) * scale).clamp(0.0, 1.0)
        },
    }
}

/// Computes [`unit_box`] of one position.
#[inline]
pub fn share_of_box(position: [f32; 3], [low, high]: [[f32; 3]; 2]) -> [f32; 3] {
    [0, 1, 2].map(|axis| ((position[axis] - low[axis]) * (1.0 / (high[axis] - low[axis]))).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::traffic::{to_host, upload_rows};

    #[test]
    fn values_and_gradients_by_hand() {
        for device in [Device::flex(), Device::ndarray()] {
            let positions = upload_rows(&[0.0, 2.0, -5.0, 3.0, 1.0, 0.5], 3, &device.autodiff()).require_grad();
            let shares = unit_box(positions.clone(), [[-1.0, 0.0, 0.0], [1.0, 4.0, 1.0]]);
            let gradients = to_host(positions.grad(&shares.clone().sum().backward()).unwrap());
            assert_eq!(to_host(shares), [0.5, 0.5, 0.0, 1.0, 0.25, 0.5]);
            assert_eq!(gradients, [0.5, 0.25, 0.0, 0.0, 0.25, 1.0]);
        }
    }
}
