use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

/// Rays of a group: enough samples to fill vectors, few enough to stay in cache.
pub(crate) const GROUP: usize = 64;

/// How packed samples are shared out among rays: ray `r` owns samples `offsets[r]..offsets[r + 1]`.
///
/// Cheap to clone. Rays may own no sample at all.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Segments {
    offsets: Arc<[u32]>,
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
        Self { offsets: std::iter::once(0).chain(ends.collect::<Vec<_>>()).collect() }
    }

    /// Number of rays `R`.
    pub fn rays(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Number of packed samples `M`.
    pub fn samples(&self) -> usize {
        self.offsets[self.rays()] as usize
    }

    /// The samples of ray `r`.
    pub fn range(&self, ray: usize) -> Range<usize> {
        self.offsets[ray] as usize..self.offsets[ray + 1] as usize
    }

    /// All ranges in order.
    pub fn ranges(&self) -> impl ExactSizeIterator<Item = Range<usize>> + '_ {
        (0..self.rays()).map(|ray| self.range(ray))
    }

    /// The longest ray's number of samples.
    pub fn longest(&self) -> usize {
        self.ranges().map(|range| range.len()).max().unwrap_or(0)
    }

    /// The ray that owns each sample, `[M]`.
    pub fn owners(&self) -> Vec<u32> {
        self.ranges().enumerate().flat_map(|(ray, range)| std::iter::repeat_n(ray as u32, range.len())).collect()
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

    /// The rays in groups of [`GROUP`], the last of which may be smaller: what one task works on.
    pub(crate) fn groups(&self) -> impl IndexedParallelIterator<Item = Group<'_>> {
        let starts = (0..self.rays()).into_par_iter().step_by(GROUP);
        starts.map(|start| Group { offsets: &self.offsets[start..=(start + GROUP).min(self.rays())] })
    }

    /// Splits per-sample `values` (`width` numbers a sample) into one mutable slice for each group.
    pub(crate) fn split_mut<'a, T>(&self, mut values: &'a mut [T], width: usize) -> Vec<&'a mut [T]> {
        let groups = (0..self.rays()).step_by(GROUP).map(|start| {
            let end = (start + GROUP).min(self.rays());
            let samples = (self.offsets[end] - self.offsets[start]) as usize;
            let (head, tail) = std::mem::take(&mut values).split_at_mut(samples * width);
            values = tail;
            head
        });
        groups.collect()
    }
}

/// Rays in a row, whose samples are packed.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Group<'a> {
    offsets: &'a [u32],
}

impl Group<'_> {
    /// Where the group's samples are among all.
    pub(crate) fn samples(&self) -> Range<usize> {
        self.offsets[0] as usize..self.offsets[self.offsets.len() - 1] as usize
    }

    /// Where each ray's samples are among the group's.
    pub(crate) fn ranges(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        let start = self.offsets[0];
        self.offsets.windows(2).map(move |ends| (ends[0] - start) as usize..(ends[1] - start) as usize)
    }
}
