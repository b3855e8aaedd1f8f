//! Arrays that several threads fill in parts.

use std::mem::MaybeUninit;
use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

/// Calls `job` with each of `blocks` and a buffer of `length` values: a part of `saved` if a backward pass will read the
/// values, else a buffer that a thread reuses.
pub(crate) fn each_with_buffer<B: IndexedParallelIterator>(
    blocks: B,
    length: usize,
    saved: Option<&mut Vec<f32>>,
    job: impl Fn(B::Item, &mut [f32]) + Send + Sync,
) {
    match saved {
        Some(saved) => {
            saved.resize(blocks.len() * length, 0.0);
            blocks.zip(saved.par_chunks_mut(length)).for_each(|(block, buffer)| job(block, buffer));
        }
        None => blocks.for_each_init(|| vec![0.0; length], |buffer, block| job(block, buffer)),
    }
}

/// Allocates an array of parts of these `lengths`. `fill` sets each part to [zeros](UninitPart::zeros) and adds to it, in
/// any thread: no single thread clears the whole array, and values stay in the cache of the thread that adds to them.
pub(crate) fn in_parts(lengths: impl IntoIterator<Item = usize>, fill: impl FnOnce(Vec<UninitPart<'_>>)) -> Vec<f32> {
    let lengths: Vec<usize> = lengths.into_iter().collect();
    let total = lengths.iter().sum();
    let mut all = Vec::with_capacity(total);
    let filled = AtomicUsize::new(0);
    let mut rest = &mut all.spare_capacity_mut()[..total];
    let part = |length| {
        let (values, others) = std::mem::take(&mut rest).split_at_mut(length);
        rest = others;
        UninitPart { values, filled: &filled }
    };
    fill(lengths.into_iter().map(part).collect());
    assert_eq!(filled.into_inner(), total, "every part is filled");
    // SAFETY: `total` values were written, each of them once, as a part is consumed when it is filled.
    #[allow(unsafe_code, reason = "zeros first would be a pass over the whole by one thread")]
    unsafe {
        all.set_len(total);
    }
    all
}

pub(crate) struct UninitPart<'a> {
    values: &'a mut [MaybeUninit<f32>],
    filled: &'a AtomicUsize,
}

impl<'a> UninitPart<'a> {
    pub(crate) fn zeros(self) -> &'a mut [f32] {
        self.filled.fetch_add(self.values.len(), Ordering::Relaxed);
        self.values.fill(MaybeUninit::new(0.0));
        // SAFETY: all values of the part were just written.
        #[allow(unsafe_code, reason = "as above")]
        unsafe {
            self.values.assume_init_mut()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[should_panic(expected = "every part is filled")]
    fn missing_parts_are_refused() {
        in_parts([2, 1], |parts| parts.into_iter().take(1).for_each(|part| part.zeros().fill(1.0)));
    }
}
