//! [Counter-based random numbers](crate::random) in kernels.

use burn::cubecl::{self, prelude::*};

/// Integer of 64 bits in two halves, as WGSL may lack integers of that size.
#[derive(CubeType, Clone, Copy)]
pub(crate) struct Bits {
    pub(crate) high: u32,
    pub(crate) low: u32,
}

/// Computes a + b modulo 2⁶⁴.
#[cube]
fn plus(a: Bits, high: u32, low: u32) -> Bits {
    let sum = a.low + low;
    Bits { high: a.high + high + select(sum < low, 1u32, 0u32), low: sum }
}

/// Computes a · b modulo 2⁶⁴.
#[cube]
fn times(a: Bits, high: u32, low: u32) -> Bits {
    Bits { high: u32::mul_hi(a.low, low) + a.low * high + a.high * low, low: a.low * low }
}

/// Computes z ^ (z >> shift), for a shift of 1 to 31.
#[cube]
fn folded(z: Bits, #[comptime] shift: u32) -> Bits {
    Bits { high: z.high ^ (z.high >> shift), low: z.low ^ ((z.low >> shift) | (z.high << (32u32 - shift))) }
}

#[cube]
fn mix(x: Bits) -> Bits {
    let z = folded(plus(x, 0x9e37_79b9u32, 0x7f4a_7c15u32), 30u32);
    let z = folded(times(z, 0xbf58_476du32, 0x1ce4_e5b9u32), 27u32);
    folded(times(z, 0x94d0_49bbu32, 0x1331_11ebu32), 31u32)
}

/// Computes [`number`](crate::random::number) of an item below 2³².
#[cube]
fn number(key: &Bits, item: u32, index: u32) -> Bits {
    let inner = mix(Bits { high: item >> 8u32, low: (item << 24u32) ^ index });
    mix(Bits { high: key.high ^ inner.high, low: key.low ^ inner.low })
}

/// Returns the first 24 bits of [`number`] as a value in [0, 1): [`Stream::uniform`](crate::random::Stream::uniform).
#[cube]
pub(crate) fn uniform(key: &Bits, item: u32, index: u32) -> f32 {
    f32::cast_from(number(key, item, index).high >> 8u32) / 16_777_216.0f32
}
