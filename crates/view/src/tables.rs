//! Planes and lines as 8-bit textures.

/// Table `[texels, channels]` as textures of four channels with 8 bits each; a last texture is filled up with zeros.
///
/// A channel's value is `low + range · byte/255`, off by at most half of `range/255`.
pub(crate) struct Quantised {
    /// Bytes `[texels, 4]` of each texture.
    pub(crate) textures: Vec<Vec<u8>>,
    /// Minimum value of each channel.
    pub(crate) low: Vec<f32>,
    /// Range of each channel's values, or 1 if they are all equal.
    pub(crate) range: Vec<f32>,
}

/// Quantises `table`, `[texels, channels]` row-major.
pub(crate) fn quantise(table: &[f32], channels: usize) -> Quantised {
    let of_channel = |k: usize| table.iter().skip(k).step_by(channels).copied();
    let low: Vec<f32> = (0..channels).map(|k| of_channel(k).fold(f32::INFINITY, f32::min)).collect();
    let high = (0..channels).map(|k| of_channel(k).fold(f32::NEG_INFINITY, f32::max));
    let range: Vec<f32> = high.zip(&low).map(|(high, low)| if high > *low { high - low } else { 1.0 }).collect();
    let byte = |value: f32, k: usize| ((value - low[k]) / range[k] * 255.0).round() as u8;
    let texture = |group: usize| {
        let texel = |row: &[f32]| [0, 1, 2, 3].map(|k| row.get(4 * group + k).map_or(0, |&v| byte(v, 4 * group + k)));
        table.chunks_exact(channels).flat_map(texel).collect()
    };
    Quantised { textures: (0..channels.div_ceil(4)).map(texture).collect(), low, range }
}
