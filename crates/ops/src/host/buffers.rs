//! Buffers that are reused, and arrays that several threads fill: for the system to map and clear new pages takes longer than to
//! fill a buffer.

use std::ops::{Deref, DerefMut};
use std::sync::{Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

/// Slice of `f32` whose memory returns to a pool when it is dropped. It holds the values of earlier users, or zeros.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Memory of at least `len` values.
    buffer: Vec<f32>,
    len: usize,
}

/// Buffers that nothing uses, from the shortest to the longest.
static POOL: Mutex<Vec<Vec<f32>>> = Mutex::new(Vec::new());

fn pool() -> MutexGuard<'static, Vec<Vec<f32>>> {
    POOL.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Scratch {
    /// Takes the shortest buffer of the pool that has `len` values, or else a new one.
    pub(crate) fn of_len(len: usize) -> Self {
        let mut pool = pool();
        let place = pool.partition_point(|buffer| buffer.len() < len);
        let buffer = (len > 0 && place < pool.len()).then(|| pool.remove(place));
        drop(pool);
        Self { buffer: buffer.unwrap_or_else(|| vec![0.0; len]), len }
    }
}

impl Deref for Scratch {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.buffer[..self.len]
    }
}

impl DerefMut for Scratch {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.buffer[..self.len]
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        /// Number of buffers that an optimizer step holds at once, in addition to one per thread.
        const BUFFERS_PER_STEP: usize = 4;
        let mut pool = pool();
        let place = pool.partition_point(|buffer| buffer.len() < self.buffer.len());
        pool.insert(place, std::mem::take(&mut self.buffer));
        if pool.len() > BUFFERS_PER_STEP + rayon::current_num_threads() {
            pool.remove(0);
        }
    }
}

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
