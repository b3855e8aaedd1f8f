use std::fmt;
use std::ops::Range;
use std::sync::{Arc, OnceLock};

use burn::tensor::{Device, Int, Tensor};

use crate::dispatch::dispatch;
use crate::upload;

/// Which packed samples each ray owns: ray `r` owns `offsets[r]..offsets[r + 1]`.
///
/// Cheap to clone. Clones share what has been moved to a device, which happens once. Rays may own no sample at all.
///
/// A GPU that has packed samples itself is the only one to know the offsets, until somebody on the host asks for them. There are
/// then as many samples as there is room for: behind the last ray's there is a tail that is no ray's. Its τ is 0, and operations
/// along rays give it a gradient of 0.
#[derive(Clone)]
pub struct Segments {
    rays: usize,
    samples: usize,
    on_host: Arc<OnceLock<Arc<[u32]>>>,
    owners: Arc<OnceLock<Tensor<1, Int>>>,
    /// The parts of the first split, and how many rays each has.
    parts: Arc<OnceLock<(Vec<usize>, Vec<Segments>)>>,
    #[cfg(feature = "cube")]
    pub(crate) on_gpu: Arc<OnceLock<burn_cubecl::tensor::CubeTensor>>,
}

impl PartialEq for Segments {
    fn eq(&self, other: &Self) -> bool {
        self.samples == other.samples && self.offsets() == other.offsets()
    }
}

impl fmt::Debug for Segments {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { rays, samples, on_host, .. } = self;
        f.debug_struct("Segments")
            .field("rays", rays)
            .field("samples", samples)
            .field("offsets", &on_host.get())
            .finish()
    }
}

impl Segments {
    /// Every one of `rays` rays owns `samples` samples.
    pub fn uniform(rays: usize, samples: usize) -> Self {
        Self::from_counts(std::iter::repeat_n(samples, rays))
    }

    /// Ray `r` owns `counts[r]` samples.
    ///
    /// # Panics
    /// If there are more than `u32::MAX` samples in all.
    pub fn from_counts(counts: impl IntoIterator<Item = usize>) -> Self {
        let mut total = 0u32;
        let ends = counts.into_iter().map(|count| {
            total = u32::try_from(count)
                .ok()
                .and_then(|count| total.checked_add(count))
                .expect("a batch holds fewer than 2^32 samples");
            total
        });
        let offsets: Arc<[u32]> = std::iter::once(0).chain(ends.collect::<Vec<_>>()).collect();
        let segments = Self::unknown(offsets.len() - 1, total as usize);
        segments.on_host.get_or_init(|| offsets);
        segments
    }

    /// Ray `r` owns `counts[r]` of `samples` samples; what is left is the tail.
    ///
    /// # Panics
    /// If there are not as many.
    pub fn with_tail(counts: impl IntoIterator<Item = usize>, samples: usize) -> Self {
        let whole = Self::from_counts(counts);
        assert!(whole.samples <= samples, "rays have {} samples of {samples}", whole.samples);
        Self { samples, ..whole }
    }

    /// Those of `rays` rays with `samples` samples and tail, whose offsets are yet to be said.
    pub(crate) fn unknown(rays: usize, samples: usize) -> Self {
        Self {
            rays,
            samples,
            on_host: Arc::default(),
            owners: Arc::default(),
            parts: Arc::default(),
            #[cfg(feature = "cube")]
            on_gpu: Arc::default(),
        }
    }

    /// The offsets, `R + 1`. A device that packed the samples is asked once.
    pub(crate) fn offsets(&self) -> &Arc<[u32]> {
        self.on_host.get_or_init(|| {
            #[cfg(feature = "cube")]
            if let Some(offsets) = self.on_gpu.get() {
                return crate::cube::read_offsets(offsets).into();
            }
            unreachable!("offsets are known on the host or on a device")
        })
    }

    /// Those of the first `counts[0]` rays, of the next `counts[1]`, and so on. What has been moved to a GPU is theirs too.
    pub fn split(&self, counts: &[usize]) -> Vec<Self> {
        let (of, parts) = self.parts.get_or_init(|| (counts.to_vec(), self.parts(counts)));
        if of == counts { parts.clone() } else { self.parts(counts) }
    }

    fn parts(&self, counts: &[usize]) -> Vec<Self> {
        let mut end = 0;
        let part = |&count: &usize| {
            let first = end;
            end += count;
            let part = Self::from_counts((first..end).map(|ray| self.range(ray).len()));
            #[cfg(feature = "cube")]
            if let Some(offsets) = self.on_gpu.get() {
                let own = crate::cube::part_or_copy(offsets, first, [count + 1]);
                part.on_gpu.get_or_init(|| own);
            }
            part
        };
        counts.iter().map(part).collect()
    }

    /// Number of rays `R`.
    pub fn rays(&self) -> usize {
        self.rays
    }

    /// Number of packed samples `M`, with the tail.
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// The samples of ray `r`.
    pub fn range(&self, ray: usize) -> Range<usize> {
        let offsets = self.offsets();
        offsets[ray] as usize..offsets[ray + 1] as usize
    }

    /// All ranges in order.
    pub fn ranges(&self) -> impl ExactSizeIterator<Item = Range<usize>> + '_ {
        (0..self.rays()).map(|ray| self.range(ray))
    }

    /// The longest ray's number of samples.
    pub fn longest(&self) -> usize {
        self.ranges().map(|range| range.len()).max().unwrap_or(0)
    }

    /// Rows of rays, `[R, C]`, as rows of their samples, `[M, C]`. Differentiable.
    pub fn spread(&self, rows: Tensor<2>) -> Tensor<2> {
        dispatch! {
            &rows.device();
            host => self.selected(rows),
            cube if self.samples() > 0 => crate::cube::spread(rows, self),
            plain => self.selected(rows),
        }
    }

    /// [`Self::spread`] from plain tensor operations.
    fn selected(&self, rows: Tensor<2>) -> Tensor<2> {
        let owners = self.owners(&rows.device());
        rows.select(0, owners)
    }

    /// The ray that owns each sample, `[M]`.
    fn owners(&self, device: &Device) -> Tensor<1, Int> {
        let kept = self.owners.get_or_init(|| self.owners_on(device));
        if kept.device() == *device { kept.clone() } else { self.owners_on(device) }
    }

    fn owners_on(&self, device: &Device) -> Tensor<1, Int> {
        upload(self.host_owners(), [self.samples()], device)
    }

    /// The same on the host; the tail is said to be the last ray's.
    pub(crate) fn host_owners(&self) -> Vec<i32> {
        let of_ray = |(ray, range): (usize, Range<usize>)| std::iter::repeat_n(ray as i32, range.len());
        let mut owners: Vec<i32> = self.ranges().enumerate().flat_map(of_ray).collect();
        owners.resize(self.samples, self.rays as i32 - 1);
        owners
    }

    /// `(indices, valid)` of the padded `[R, longest]` layout: where each cell reads from (0 if padding) and whether
    /// it holds a sample.
    pub fn padded(&self) -> (Vec<i32>, Vec<bool>) {
        let longest = self.longest();
        let mut indices = vec![0; self.rays() * longest];
        let mut valid = vec![false; self.rays() * longest];
        for (ray, range) in self.ranges().enumerate() {
            for (slot, sample) in range.enumerate() {
                indices[ray * longest + slot] = sample as i32;
                valid[ray * longest + slot] = true;
            }
        }
        (indices, valid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{from_host, to_host};

    #[test]
    #[allow(deprecated, reason = "the older CPU backend is tested for as long as it is selectable")]
    fn rows_of_rays_go_to_their_samples_and_gradients_back() {
        let segments = Segments::from_counts([0, 2, 0, 1]);
        for device in [Device::flex(), Device::ndarray()] {
            let rows = from_host(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], 2, &device.autodiff()).require_grad();
            let out = segments.spread(rows.clone());
            let pull = from_host(&[1.0, 10.0, 2.0, 20.0, 3.0, 30.0], 2, &rows.device());
            let slopes = rows.grad(&(out.clone() * pull).sum().backward()).unwrap();
            assert_eq!(to_host(out), [3.0, 4.0, 3.0, 4.0, 7.0, 8.0]);
            assert_eq!(to_host(slopes), [0.0, 0.0, 3.0, 30.0, 0.0, 0.0, 3.0, 30.0]);
        }
    }
}
