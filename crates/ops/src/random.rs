//! Counter-based random numbers, the same on the host and in kernels: number `index` of item `item` of the stream `key` is a pure
//! function of the three.

/// Random numbers of one ray: an item of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    /// Key of the stream.
    pub key: u64,
    /// Index of the ray in the stream.
    pub item: usize,
}

impl Stream {
    /// Returns number `index`, uniform in [0, 1): the first 24 bits of [`number`].
    pub fn uniform(self, index: usize) -> f32 {
        (number(self.key, self.item, index) >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// Returns number `index` of an item: 64 random bits. Items up to 2⁴⁰ with indices up to 2²⁴ do not share numbers.
pub fn number(key: u64, item: usize, index: usize) -> u64 {
    mix(key ^ mix(((item as u64) << 24) ^ index as u64))
}

/// Returns number `index` of an item, uniform in 0..`count`: ⌊count · [`number`] / 2⁶⁴⌋.
pub fn below(key: u64, item: usize, index: usize, count: usize) -> usize {
    ((u128::from(number(key, item, index)) * count as u128) >> 64) as usize
}

/// Returns the place of `index` in a random permutation of 0..`count`, which `key` selects; `count` is at most 2³². A
/// place is found without the others, unlike by shuffling. The places of the first k indices are k distinct values.
///
/// A Feistel network of six rounds permutes 0..4ᵇ, the smallest such range that has all indices. It is applied until the result
/// is below `count`, less than 4 times in the mean (Mitchell et al. 2021, "Bandwidth-Optimal Random Shuffling for GPUs").
///
/// # Panics
/// If `index` is not below `count`.
pub fn permuted(key: u64, index: usize, count: usize) -> usize {
    assert!(index < count, "{index} is not below {count}");
    let bits = half_bits(count);
    let mask = (1 << bits) - 1;
    let mut place = index as u64;
    loop {
        let (mut left, mut right) = (place >> bits, place & mask);
        for round in 0..ROUNDS {
            (left, right) = (right, left ^ (number(key, right as usize, round) & mask));
        }
        place = left << bits | right;
        if place < count as u64 {
            return place as usize;
        }
    }
}

const ROUNDS: usize = 6;

/// Returns the smallest b ≥ 1 with 4ᵇ ≥ `count`.
fn half_bits(count: usize) -> u32 {
    count.max(2).next_power_of_two().ilog2().div_ceil(2)
}

/// Applies the finaliser of SplitMix64 (Steele et al. 2014) after its increment.
pub fn mix(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_place_is_taken_once() {
        for count in [1, 2, 3, 4, 5, 16, 17, 100, 1000] {
            for key in 0..5 {
                let mut places: Vec<usize> = (0..count).map(|index| permuted(key, index, count)).collect();
                places.sort_unstable();
                assert!(places.into_iter().eq(0..count), "{count} {key}");
            }
        }
        assert_eq!(half_bits(1 << 32), 16);
    }

    /// Checks that each index takes each place about equally often, and that neighbours are separated.
    #[test]
    fn places_are_uniform() {
        const KEYS: u64 = 20_000;
        const COUNT: usize = 10;
        let mut seen = [[0u32; COUNT]; COUNT];
        let mut neighbours = 0;
        for key in 0..KEYS {
            let places: Vec<usize> = (0..COUNT).map(|index| permuted(mix(key), index, COUNT)).collect();
            places.iter().enumerate().for_each(|(index, &place)| seen[index][place] += 1);
            neighbours += places.windows(2).filter(|pair| pair[1] == pair[0] + 1).count();
        }
        let expected = KEYS as f64 / COUNT as f64;
        for count in seen.into_iter().flatten() {
            assert!((f64::from(count) - expected).abs() < 5.0 * expected.sqrt(), "{count} {expected}");
        }
        // 9 of the 90 ordered pairs of places are neighbours, which gives a mean of 0.9 for the 9 pairs of a permutation.
        let expected = 0.9 * KEYS as f64;
        assert!((neighbours as f64 - expected).abs() < 6.0 * expected.sqrt(), "{neighbours} {expected}");
    }
}
