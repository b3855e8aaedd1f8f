//! Arrays that several threads fill in parts.

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
