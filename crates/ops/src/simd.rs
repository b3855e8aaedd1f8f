//! Code compiled for several instruction sets, chosen at run time.

/// Work whose loops the compiler vectorises for the processor at hand.
pub(crate) trait Job {
    /// Does the work; mark the implementation `#[inline(always)]`. `FMA` says that fused multiply-add is one instruction,
    /// `WIDE` that there are 32 registers of 16 numbers.
    fn run<const FMA: bool, const WIDE: bool>(self);
}

/// Does `job` with the widest vectors that this processor has.
pub(crate) fn run(job: impl Job) {
    #[cfg(target_arch = "x86_64")]
    {
        if is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512vl")
        {
            #[target_feature(enable = "avx2,fma,avx512f,avx512dq,avx512bw,avx512vl")]
            fn widest(job: impl Job) {
                job.run::<true, true>();
            }
            // SAFETY: the features that `widest` is compiled for were just detected.
            #[allow(unsafe_code, reason = "the only way to call code for a detected instruction set")]
            return unsafe { widest(job) };
        }
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            #[target_feature(enable = "avx2,fma")]
            fn wide(job: impl Job) {
                job.run::<true, false>();
            }
            // SAFETY: the features that `wide` is compiled for were just detected.
            #[allow(unsafe_code, reason = "the only way to call code for a detected instruction set")]
            return unsafe { wide(job) };
        }
    }
    if cfg!(target_arch = "aarch64") { job.run::<true, false>() } else { job.run::<false, false>() }
}
