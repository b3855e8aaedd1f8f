use std::ops::Range;
use std::sync::Arc;
#[cfg(feature = "cube")]
use std::sync::OnceLock;

use burn::tensor::{Device, Int, Tensor};

use crate::dispatch::dispatch;
use crate::traffic::upload;

/// Packed samples by ray: ray `r` owns samples `offsets[r]..offsets[r + 1]`, perhaps none.
///
/// Clones are cheap. They share the offsets on a GPU, which are uploaded once.
#[derive(Clone, Debug)]
pub struct Segments {
    offsets: Arc<[i32]>,
    #[cfg(feature = "cube")]
    pub(crate) on_gpu: Arc<OnceLock<burn_cubecl::tensor::CubeTensor>>,
}

impl Segments {
    /// Creates segments of `rays` rays with `samples` samples each.
    pub fn uniform(rays: usize, samples: usize) -> Self {
        Self::from_counts(std::iter::repeat_n(samples, rays))
    }

    /// Creates segments in which ray `r` owns `counts[r]` samples.
    ///
    /// # Panics
    /// If there are more than `i32::MAX` samples in all.
    pub fn from_counts(counts: impl IntoIterator<Item = usize>) -> Self {
        let mut total = 0i32;
        let ends = counts.into_iter().map(|count| {
            let sum = i32::try_from(count).ok().and_then(|count| total.checked_add(count));
            total = sum.expect("a batch holds fewer than 2^31 samples");
            total
        });
        let offsets = std::iter::once(0).chain(ends.collect::<Vec<_>>()).collect();
        Self {
            offsets,
            #[cfg(feature = "cube")]
            on_gpu: Arc::default(),
        }
    }

    pub(crate) fn offsets(&self) -> &[i32] {
        &self.offsets
    }

    /// Returns the number of rays `R`.
    pub fn rays(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Returns the number of packed samples `M`.
    pub fn samples(&self) -> usize {
        self.offsets[self.rays()] as usize
    }

    /// Returns the samples of a ray.
    pub fn range(&self, ray: usize) -> Range<usize> {
        self.offsets[ray] as usize..self.offsets[ray + 1] as usize
    }

    /// Returns all ranges in order.
    pub fn ranges(&self) -> impl ExactSizeIterator<Item = Range<usize>> + '_ {
        (0..self.rays()).map(|ray| self.range(ray))
    }

    /// Returns the number of samples of the longest ray.
    pub fn longest(&self) -> usize {
        self.ranges().map(|range| range.len()).max().unwrap_or(0)
    }

    /// Repeats the row of each ray, `[R, C]`, for each of its samples, `[M, C]`. Differentiable in `rows`.
    pub fn spread(&self, rows: Tensor<2>) -> Tensor<2> {
        dispatch! {
            &rows.device();
            cube if self.samples() > 0 => {
                crate::cube::apply(crate::cube::rays::Spread(self.clone()), [rows.into_dispatch()])
            },
            plain => {
                let owners = self.owners(&rows.device());
                rows.select(0, owners)
            },
        }
    }

    /// Uploads the ray of each sample, `[M]`.
    pub(crate) fn owners(&self, device: &Device) -> Tensor<1, Int> {
        upload(self.host_owners(), [self.samples()], device)
    }

    pub(crate) fn host_owners(&self) -> Vec<i32> {
        let of_ray = |(ray, range): (usize, Range<usize>)| std::iter::repeat_n(ray as i32, range.len());
        self.ranges().enumerate().flat_map(of_ray).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traffic::{to_host, upload_rows};

    #[test]
    fn rows_of_rays_go_to_their_samples_and_gradients_back() {
        let segments = Segments::from_counts([0, 2, 0, 1]);
        for device in [Device::flex(), Device::ndarray()] {
            let rows = upload_rows(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], 2, &device.autodiff()).require_grad();
            let out = segments.spread(rows.clone());
            let pull = upload_rows(&[1.0, 10.0, 2.0, 20.0, 3.0, 30.0], 2, &rows.device());
            let gradient = rows.grad(&(out.clone() * pull).sum().backward()).unwrap();
            assert_eq!(to_host(out), [3.0, 4.0, 3.0, 4.0, 7.0, 8.0]);
            assert_eq!(to_host(gradient), [0.0, 0.0, 3.0, 30.0, 0.0, 0.0, 3.0, 30.0]);
        }
    }
}
