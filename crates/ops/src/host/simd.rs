//! Code compiled for several instruction sets, one of which is chosen at run time.

/// Work whose loops the compiler vectorises for the processor at hand.
pub(crate) trait Job {
    /// Does the work; mark the implementation `#[inline(always)]`. `FMA` is set if fused multiply-add is one instruction, `WIDE`
    /// if there are 32 registers of 16 values.
    fn run<const FMA: bool, const WIDE: bool>(self);
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Instructions {
    /// AVX-512 with its F, DQ, BW and VL parts.
    Avx512,
    Avx2,
    /// Instructions of every processor of the target.
    Baseline,
}

impl Instructions {
    pub(crate) const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Baseline];

    pub(crate) fn present(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx512 | Self::Avx2 => false,
            Self::Baseline => true,
        }
    }

    /// Runs `job` with these instructions.
    pub(crate) fn run(self, job: impl Job) {
        assert!(self.present(), "{self:?}: not on this processor");
        /// Runs `job` in a function that is compiled for `$features`.
        #[cfg(target_arch = "x86_64")]
        macro_rules! compiled_for {
            ($features:literal, $wide:literal) => {{
                #[target_feature(enable = $features)]
                fn compiled(job: impl Job) {
                    job.run::<true, $wide>();
                }
                // SAFETY: the features that `compiled` is compiled for are present.
                #[allow(unsafe_code, reason = "the only way to call code for a detected instruction set")]
                unsafe {
                    compiled(job);
                }
            }};
        }
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => compiled_for!("avx2,fma,avx512f,avx512dq,avx512bw,avx512vl", true),
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => compiled_for!("avx2,fma", false),
            _ if cfg!(target_arch = "aarch64") => job.run::<true, false>(),
            _ => job.run::<false, false>(),
        }
    }
}

/// Runs `job` with the widest vectors that this processor has.
pub(crate) fn run(job: impl Job) {
    let widest = Instructions::ALL.into_iter().find(|instructions| instructions.present());
    widest.expect("every processor has the baseline").run(job);
}
