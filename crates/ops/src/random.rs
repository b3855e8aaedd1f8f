//! Counter-based random numbers, the same on the host and in kernels: number `index` of item `item` of the stream `key` is a pure
//! function of the three.

/// The random numbers of one ray: an item of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    /// Which stream.
    pub key: u64,
    /// Which ray of it.
    pub item: usize,
}

impl Stream {
    /// Number `index`, uniform in [0, 1): the first 24 bits of [`number`].
    pub fn uniform(self, index: usize) -> f32 {
        (number(self.key, self.item, index) >> 40) as f32 / (1u64 << 24) as f32
    }
}

/// Number `index` of an item, 64 random bits: items up to 2⁴⁰ and indices up to 2²⁴ have numbers of their own.
pub fn number(key: u64, item: usize, index: usize) -> u64 {
    mix(key ^ mix(((item as u64) << 24) ^ index as u64))
}

/// The finaliser of SplitMix64 (Steele et al. 2014) after its increment.
pub fn mix(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
