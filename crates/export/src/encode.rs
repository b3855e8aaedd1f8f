//! Encoding of numbers and colours as bytes.

use glam::Vec3;

/// Rounds a display-encoded colour to bytes.
pub(crate) fn bytes(color: [f32; 3]) -> [u8; 3] {
    color.map(|channel| (channel.clamp(0.0, 1.0) * 255.0).round() as u8)
}

/// Returns the linear value of a display-encoded channel (sRGB, IEC 61966-2-1).
pub(crate) fn linear(channel: f32) -> f32 {
    let channel = channel.clamp(0.0, 1.0);
    if channel <= 0.040_45 { channel / 12.92 } else { ((channel + 0.055) / 1.055).powf(2.4) }
}

/// Appends a vector, little-endian.
pub(crate) fn push(bytes: &mut Vec<u8>, v: Vec3) {
    v.to_array().iter().for_each(|value| bytes.extend(value.to_le_bytes()));
}
