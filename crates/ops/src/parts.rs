//! Arrays that several threads fill.

use std::mem::MaybeUninit;
use std::sync::atomic::{AtomicUsize, Ordering};

/// An array of parts of these `lengths`, each of which `fill` makes [zeros](Part::zeros) of and adds to: in whatever thread, so
/// that nobody waits for one that clears the whole, and numbers are still in that thread's cache.
///
/// # Panics
/// If `fill` leaves out a part.
pub(crate) fn in_parts(lengths: impl IntoIterator<Item = usize>, fill: impl FnOnce(Vec<Part<'_>>)) -> Vec<f32> {
    let lengths: Vec<usize> = lengths.into_iter().collect();
    let total = lengths.iter().sum();
    let mut all = Vec::with_capacity(total);
    let filled = AtomicUsize::new(0);
    let mut rest = &mut all.spare_capacity_mut()[..total];
    let part = |length| {
        let (numbers, others) = std::mem::take(&mut rest).split_at_mut(length);
        rest = others;
        Part { numbers, filled: &filled }
    };
    fill(lengths.into_iter().map(part).collect());
    assert_eq!(filled.into_inner(), total, "every part is filled");
    // SAFETY: so many numbers were written, each of them once, as a part is consumed when it is filled.
    #[allow(unsafe_code, reason = "zeros first would be a pass over the whole by one thread")]
    unsafe {
        all.set_len(total);
    }
    all
}

/// Numbers that are still to be written.
pub(crate) struct Part<'a> {
    numbers: &'a mut [MaybeUninit<f32>],
    filled: &'a AtomicUsize,
}

impl<'a> Part<'a> {
    /// The part, of zeros.
    pub(crate) fn zeros(self) -> &'a mut [f32] {
        self.filled.fetch_add(self.numbers.len(), Ordering::Relaxed);
        self.numbers.fill(MaybeUninit::new(0.0));
        // SAFETY: each of them was just written.
        #[allow(unsafe_code, reason = "as above")]
        unsafe {
            self.numbers.assume_init_mut()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_come_in_order() {
        let all = in_parts([2, 0, 1], |parts| {
            for (index, part) in parts.into_iter().enumerate() {
                part.zeros().iter_mut().for_each(|x| *x += index as f32);
            }
        });
        assert_eq!(all, [0.0, 0.0, 2.0]);
    }

    #[test]
    #[should_panic(expected = "every part is filled")]
    fn no_part_is_left_out() {
        in_parts([2, 1], |parts| parts.into_iter().take(1).for_each(|part| part.zeros().fill(1.0)));
    }
}
