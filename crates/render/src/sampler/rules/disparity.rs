use burn::tensor::Tensor;
use infonerf_ops::sampling::{self, LastInterval, SampleRule, Streams};

use super::Rule;

/// [`Placement::Disparity`](super::Placement::Disparity).
#[derive(Debug)]
pub(super) struct Disparity;

/// Share of far below which there are no samples: the disparity of distance 0 is infinite.
const NEAREST: f32 = 1e-3;

impl Rule for Disparity {
    fn first(&self, ends: Tensor<2>, count: usize, jitter: Option<&Streams>) -> Tensor<2> {
        let rays = ends.dims()[0];
        let nearest = ends.clone().narrow(1, 1, 1).repeat_dim(1, 2) * NEAREST;
        sampling::stratified(ends.max_pair(nearest).recip(), [rays, count], SampleRule::Left, jitter).recip()
    }

    fn intervals(&self, t: Tensor<2>, ends: Tensor<2>, last: LastInterval) -> [Tensor<1>; 2] {
        sampling::intervals(t, ends, SampleRule::Left, last)
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;
    use infonerf_ops::{from_host, to_host};

    use super::*;

    #[test]
    fn disparities_are_evenly_spaced() {
        let ends = from_host(&[1.0, 4.0, 0.0, 2.0], 2, &Device::flex());
        let t = to_host(Disparity.first(ends, 4, None));
        for (t, want) in t.iter().zip([1.0, 4.0 / 3.0, 2.0, 4.0, 2e-3, 2.9985e-3, 5.988e-3, 2.0]) {
            assert!((t - want).abs() < 1e-4 * want.max(0.1), "{t} for {want}");
        }
    }
}
