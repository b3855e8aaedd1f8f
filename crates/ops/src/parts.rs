//! Arrays that several threads fill in parts, and sums that they share.

use rayon::prelude::*;

/// Number of partial sums of a network's gradient: fixed, so that the result does not depend on the number of threads.
pub(crate) const GROUPS: usize = 16;

/// Returns `len` zeros. All threads write them, each block with one `memset`.
pub(crate) fn zeros(len: usize) -> Vec<f32> {
    const BLOCK: usize = 1 << 12;
    let blocks: Vec<_> = (0..len.div_ceil(BLOCK)).into_par_iter().with_min_len(16).map(|_| [0.0; BLOCK]).collect();
    let mut zeros = blocks.into_flattened();
    zeros.truncate(len);
    zeros
}

/// Calls `job` with each of `blocks` and a buffer of `length` values: a part of `saved` if a backward pass will read the
/// values, else a buffer that a thread reuses.
pub(crate) fn each_with_buffer<B: IndexedParallelIterator>(
    blocks: B,
    length: usize,
    saved: Option<&mut [f32]>,
    job: impl Fn(B::Item, &mut [f32]) + Send + Sync,
) {
    match saved {
        Some(saved) => blocks.zip(saved.par_chunks_mut(length)).for_each(|(block, buffer)| job(block, buffer)),
        None => blocks.for_each_init(|| vec![0.0; length], |buffer, block| job(block, buffer)),
    }
}
