//! Positions as shares of a box.

use burn::tensor::{Device, Tensor};

use crate::dispatch::dispatch;
use crate::upload;

/// `positions` `[M, 3]` as shares of the box from `low` to `high`, clamped to it: min(max((x − low)/(high − low), 0), 1) of
/// each axis. Differentiable; the gradient is 0 beyond the box.
pub fn unit_box(positions: Tensor<2>, [low, high]: [[f32; 3]; 2]) -> Tensor<2> {
    let scale = [0, 1, 2].map(|axis| 1.0 / (high[axis] - low[axis]));
    dispatch! {
        &positions.device();
        host => crate::kernel::apply(host::UnitBoxKernel { low, scale }, positions),
        cube if positions.dims()[0] > 0 => crate::cube::unit_box(positions, low, scale),
        plain => plain(positions, low, scale),
    }
}

/// [`unit_box`] of one position.
#[inline]
pub fn share_of_box(position: [f32; 3], [low, high]: [[f32; 3]; 2]) -> [f32; 3] {
    [0, 1, 2].map(|axis| ((position[axis] - low[axis]) * (1.0 / (high[axis] - low[axis]))).clamp(0.0, 1.0))
}

fn plain(positions: Tensor<2>, low: [f32; 3], scale: [f32; 3]) -> Tensor<2> {
    let row = |row: [f32; 3], device: &Device| upload(row.to_vec(), [1, 3], device);
    let device = positions.device();
    ((positions - row(low, &device)) * row(scale, &device)).clamp(0.0, 1.0)
}

#[cfg(feature = "flex")]
mod host {
    use rayon::prelude::*;

    use crate::kernel::{Kernel, Pass};

    /// Numbers that a thread takes at a time.
    const CHUNK: usize = 3 << 12;

    #[derive(Debug)]
    pub(super) struct UnitBoxKernel {
        pub(super) low: [f32; 3],
        pub(super) scale: [f32; 3],
    }

    impl UnitBoxKernel {
        /// `of(share of the box, scale, index)` of each coordinate.
        fn each(&self, positions: &[f32], of: impl Fn(f32, f32, usize) -> f32 + Sync) -> Vec<f32> {
            let mut out = vec![0.0; positions.len()];
            let chunks = out.par_chunks_mut(CHUNK).zip(positions.par_chunks(CHUNK)).enumerate();
            chunks.for_each(|(chunk, (out, positions))| {
                for (row, (out, p)) in out.chunks_exact_mut(3).zip(positions.chunks_exact(3)).enumerate() {
                    for axis in 0..3 {
                        let share = (p[axis] - self.low[axis]) * self.scale[axis];
                        out[axis] = of(share, self.scale[axis], chunk * CHUNK + 3 * row + axis);
                    }
                }
            });
            out
        }
    }

    impl Kernel for UnitBoxKernel {
        fn shape(&self, inputs: &[Vec<usize>]) -> Vec<usize> {
            inputs[0].clone()
        }

        fn forward(&self, inputs: &[&[f32]], _saved: Option<&mut Vec<f32>>) -> Vec<f32> {
            self.each(inputs[0], |share, _, _| share.clamp(0.0, 1.0))
        }

        fn backward(&self, pass: Pass<'_>, _wanted: &[bool]) -> Vec<Option<Vec<f32>>> {
            let inside = |share: f32| (0.0..=1.0).contains(&share);
            let slope = |share, scale, index: usize| if inside(share) { scale * pass.grad[index] } else { 0.0 };
            vec![Some(self.each(pass.inputs[0], slope))]
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{from_host, to_host};

    #[test]
    #[allow(deprecated, reason = "the older CPU backend is tested for as long as it is selectable")]
    fn shares_and_slopes_by_hand() {
        for device in [Device::flex(), Device::ndarray()] {
            let positions = from_host(&[0.0, 2.0, -5.0, 3.0, 1.0, 0.5], 3, &device.autodiff()).require_grad();
            let shares = unit_box(positions.clone(), [[-1.0, 0.0, 0.0], [1.0, 4.0, 1.0]]);
            let slopes = to_host(positions.grad(&shares.clone().sum().backward()).unwrap());
            assert_eq!(to_host(shares), [0.5, 0.5, 0.0, 1.0, 0.25, 0.5]);
            assert_eq!(slopes, [0.5, 0.25, 0.0, 0.0, 0.25, 1.0]);
        }
    }
}
