//! How many runs fit on the machine at a time.

use std::thread;

/// Share of the free memory that runs may take.
const MEMORY_SHARE: f64 = 0.8;

/// Processor cores of this machine.
pub(super) fn cores() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// How many of `jobs` runs fit: no more than `cores`, and no more than there is `free` memory for if each takes `peak`
/// bytes. At least one. What is not known does not limit.
pub(super) fn fitting(jobs: usize, cores: usize, free: Option<u64>, peak: Option<u64>) -> usize {
    let in_memory = match (free, peak) {
        (Some(free), Some(peak)) if peak > 0 => (MEMORY_SHARE * free as f64 / peak as f64) as usize,
        _ => usize::MAX,
    };
    jobs.min(cores).min(in_memory).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cores_and_memory_limit() {
        let gib = |n: u64| Some(n << 30);
        assert_eq!(fitting(8, 4, None, None), 4);
        assert_eq!(fitting(2, 4, gib(16), gib(1)), 2);
        assert_eq!(fitting(8, 8, gib(10), gib(2)), 4);
        assert_eq!(fitting(8, 8, gib(1), gib(2)), 1);
        assert_eq!(fitting(8, 8, gib(1), None), 8);
    }
}
