//! Buffers that are reused: for the system to map and clear new pages takes longer than to fill a buffer.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Buffer of `f32` that returns to a pool when it is dropped. A buffer from the pool still holds the values of its last user.
#[derive(Debug)]
pub(crate) struct Scratch(pub(crate) Vec<f32>);

static POOL: Mutex<Vec<Vec<f32>>> = Mutex::new(Vec::new());

fn pool() -> MutexGuard<'static, Vec<Vec<f32>>> {
    POOL.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Scratch {
    /// Takes the buffer that was returned last, or an empty one.
    pub(crate) fn new() -> Self {
        Self(pool().pop().unwrap_or_default())
    }

    /// Takes the smallest buffer that holds `len` values, or a new one, and sets its length.
    pub(crate) fn of_len(len: usize) -> Self {
        let mut pool = pool();
        let fits = pool.iter().enumerate().filter(|(_, buffer)| buffer.capacity() >= len);
        let smallest = fits.min_by_key(|(_, buffer)| buffer.capacity()).map(|(index, _)| index);
        let mut buffer = smallest.map(|index| pool.remove(index)).unwrap_or_default();
        drop(pool);
        buffer.resize(len, 0.0);
        Self(buffer)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        /// Number of buffers that an optimizer step holds at once, in addition to one per thread.
        const BUFFERS_PER_STEP: usize = 4;
        let mut pool = pool();
        if pool.len() < BUFFERS_PER_STEP + rayon::current_num_threads() {
            pool.push(std::mem::take(&mut self.0));
        }
    }
}
