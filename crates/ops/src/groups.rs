//! Rays in groups, one task of a host kernel each.

use std::ops::Range;

use rayon::prelude::*;

use crate::Segments;

/// Rays of a group: enough samples to fill vectors, few enough to stay in cache.
pub(crate) const GROUP: usize = 64;

impl Segments {
    /// The rays in groups of [`GROUP`], the last of which may be smaller.
    pub(crate) fn groups(&self) -> impl IndexedParallelIterator<Item = Group<'_>> {
        let (starts, offsets) = ((0..self.rays()).into_par_iter().step_by(GROUP), self.offsets());
        starts.map(move |start| Group { offsets: &offsets[start..=(start + GROUP).min(self.rays())] })
    }

    /// Splits per-sample `values` (`width` numbers per sample) into one mutable slice per group.
    pub(crate) fn split_mut<'a, T>(&self, mut values: &'a mut [T], width: usize) -> Vec<&'a mut [T]> {
        let offsets = self.offsets();
        let groups = (0..self.rays()).step_by(GROUP).map(|start| {
            let end = (start + GROUP).min(self.rays());
            let samples = (offsets[end] - offsets[start]) as usize;
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
