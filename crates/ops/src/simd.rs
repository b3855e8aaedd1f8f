//! Code compiled for several instruction sets, chosen at run time.

/// Work whose loops the compiler vectorises for the processor at hand.
pub(crate) trait Job {
    /// Does the work; mark the implementation `#[inline(always)]`. `FMA` says that fused multiply-add is one instruction.
    fn run<const FMA: bool>(self);
}

/// Does `job` with the widest vectors that this processor has.
pub(crate) fn run(job: impl Job) {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            #[target_feature(enable = "avx2,fma")]
            fn wide(job: impl Job) {
                job.run::<true>();
            }
            // SAFETY: the features that `wide` is compiled for were just detected.
            #[allow(unsafe_code, reason = "the only way to call code for a detected instruction set")]
            return unsafe { wide(job) };
        }
    }
    if cfg!(target_arch = "aarch64") { job.run::<true>() } else { job.run::<false>() }
}
