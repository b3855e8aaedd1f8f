//! NumPy's legacy random number generator, as far as view selection needs it.
//!
//! Published few-shot splits were drawn with `np.random.seed(s); np.random.choice(n, k, False)`.
//! Reproducing them takes the same MT19937 stream, seeding, masked rejection and shuffle.

const N: usize = 624;
const M: usize = 397;

/// Mersenne Twister 19937, seeded as NumPy's `RandomState(seed)` does for an integer seed.
pub(super) struct Mt19937 {
    state: [u32; N],
    next: usize,
}

impl Mt19937 {
    pub(super) fn new(seed: u32) -> Self {
        let mut state = [0u32; N];
        state[0] = seed;
        for i in 1..N {
            let previous = state[i - 1];
            state[i] = 1_812_433_253u32.wrapping_mul(previous ^ (previous >> 30)).wrapping_add(i as u32);
        }
        Self { state, next: N }
    }

    fn refill(&mut self) {
        for i in 0..N {
            let y = (self.state[i] & 0x8000_0000) | (self.state[(i + 1) % N] & 0x7fff_ffff);
            let odd = if y & 1 == 1 { 0x9908_b0df } else { 0 };
            self.state[i] = self.state[(i + M) % N] ^ (y >> 1) ^ odd;
        }
        self.next = 0;
    }

    pub(super) fn next_u32(&mut self) -> u32 {
        if self.next == N {
            self.refill();
        }
        let mut y = self.state[self.next];
        self.next += 1;
        y ^= y >> 11;
        y ^= (y << 7) & 0x9d2c_5680;
        y ^= (y << 15) & 0xefc6_0000;
        y ^ (y >> 18)
    }

    /// Draws uniformly from `0..=max`: bits above those of `max` are masked off, larger values drawn again (NumPy's
    /// `random_interval`).
    fn interval(&mut self, max: u32) -> u32 {
        let mask = u32::MAX.checked_shr(max.leading_zeros()).unwrap_or(0);
        loop {
            let value = self.next_u32() & mask;
            if value <= max {
                return value;
            }
        }
    }

    /// Returns `np.random.permutation(n)`: Fisher–Yates from the end. `n` is at most `u32::MAX`.
    pub(super) fn permutation(&mut self, n: usize) -> Vec<usize> {
        let mut order: Vec<usize> = (0..n).collect();
        for i in (1..n).rev() {
            let j = self.interval(u32::try_from(i).unwrap_or(u32::MAX)) as usize;
            order.swap(i, j);
        }
        order
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reference_output_of_the_generator() {
        // The C++ standard states the 10000th value for the default seed 5489.
        let mut rng = Mt19937::new(5489);
        let value = (0..10_000).map(|_| rng.next_u32()).last();
        assert_eq!(value, Some(4_123_659_995));
    }

    #[test]
    fn numpy_permutations() {
        let known: [(u32, &[usize]); 5] = [
            (0, &[26, 86, 2, 55, 75, 93, 16, 73]),
            (1, &[80, 84, 33, 81]),
            (2, &[83, 30, 56, 24]),
            (3, &[93, 67, 6, 64]),
            (4, &[20, 10, 96, 16]),
        ];
        for (seed, expected) in known {
            let order = Mt19937::new(seed).permutation(100);
            assert_eq!(&order[..expected.len()], expected, "seed {seed}");
        }
    }

    #[test]
    fn tiny_permutations() {
        assert!(Mt19937::new(0).permutation(0).is_empty());
        assert_eq!(Mt19937::new(0).permutation(1), [0]);
    }
}
