use std::fs;

/// Measurement of the peak resident memory of this process from a moment on, if the system reports it.
pub(crate) struct PeakMemory {
    /// Whether the peak that the system reports excludes earlier runs of this process.
    own: bool,
}

impl PeakMemory {
    /// Starts a measurement. Linux resets the peak on request; without that, only a process's first run has a peak of its own.
    pub(crate) fn start() -> Self {
        static FIRST: std::sync::atomic::AtomicBool = std::sync::atomic::AtomicBool::new(true);
        let first = FIRST.swap(false, std::sync::atomic::Ordering::Relaxed);
        let reset = fs::write("/proc/self/clear_refs", "5").is_ok();
        Self { own: reset || first }
    }

    /// Returns the largest resident memory since the start, in bytes; `None` if the system does not report it for this run alone.
    pub(crate) fn peak(&self) -> Option<u64> {
        let status = self.own.then(|| fs::read_to_string("/proc/self/status"))?.ok()?;
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
        Some(line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok()? * 1024)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peak_memory_excludes_previous_run() {
        if fs::write("/proc/self/clear_refs", "5").is_err() {
            return;
        }
        const LARGE: usize = 256 << 20;
        let first = PeakMemory::start();
        let block = std::hint::black_box(vec![1u8; LARGE]);
        let large = first.peak().unwrap();
        drop(block);
        let small = PeakMemory::start().peak().unwrap();
        assert!(large > LARGE as u64 && small + (LARGE / 2) as u64 <= large, "{large}, then {small}");
    }
}
