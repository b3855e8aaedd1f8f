//! Random numbers addressed by what they are for, so that they do not depend on the order or number of threads.

/// A stream of reproducible random numbers: number `i` of item `n` is a pure function of (seed, n, i).
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    seed: u64,
}

impl Noise {
    /// A stream for `seed`, a step and a purpose (any distinguishing number).
    pub fn new(seed: u64, step: u64, purpose: u64) -> Self {
        Self { seed: mix(mix(mix(seed) ^ step) ^ purpose) }
    }

    /// Uniform in [0, 1).
    pub fn uniform(self, item: usize, index: usize) -> f32 {
        let bits = mix(self.seed ^ mix(((item as u64) << 24) ^ index as u64));
        (bits >> 40) as f32 / (1u64 << 24) as f32
    }

    /// An independent stream for the next use within one step.
    pub fn next(self) -> Self {
        Self { seed: mix(self.seed) }
    }

    /// The stream's own seed, for generators that want one.
    pub fn bits(self) -> u64 {
        self.seed
    }

    /// Uniform in 0..`count`.
    pub fn below(self, item: usize, index: usize, count: usize) -> usize {
        let bits = mix(self.seed ^ mix(((item as u64) << 24) ^ index as u64));
        ((u128::from(bits) * count as u128) >> 64) as usize
    }
}

/// The finaliser of SplitMix64 (Steele et al. 2014) after its increment.
fn mix(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn is_uniform_and_reproducible() {
        let noise = Noise::new(1, 2, 3);
        let draws: Vec<f32> = (0..10_000).map(|i| noise.uniform(i / 100, i % 100)).collect();
        let mean = draws.iter().sum::<f32>() / draws.len() as f32;
        assert!((mean - 0.5).abs() < 0.01, "{mean}");
        assert!(draws.iter().all(|u| (0.0..1.0).contains(u)));
        assert_eq!(draws[123], Noise::new(1, 2, 3).uniform(1, 23));
        assert_ne!(draws[123], Noise::new(1, 2, 4).uniform(1, 23));
        assert!((0..1000).all(|i| noise.below(i, 0, 7) < 7));
    }
}
