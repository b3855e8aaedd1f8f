//! Encoding of density in 8 bits.
//!
//! A byte is `255 √(α/α_max)` of a voxel's opacity `α = 1 − exp(−σ · voxel)`. Opacities lie between 0 and 1 whatever σ
//! is; their root has finer steps for small opacities: the least above 0 is 1.5e-5, a step in the middle is 0.8 %, and
//! nearly opaque voxels are as exact as is visible.

/// Greatest opacity of a voxel, that of optical depth 8.
pub(super) const MAX_OPACITY: f32 = 0.999_664_5;
/// Byte from which on a voxel transmits less than a tenth of the light.
pub(super) const NEARLY_OPAQUE: u8 = 242;

/// Encodes a density, 1/length, of voxels of this length.
pub(super) fn byte(density: f32, voxel: f32) -> u8 {
    let opacity = -(-density * voxel).exp_m1() / MAX_OPACITY;
    (opacity.clamp(0.0, 1.0).sqrt() * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faulty_densities_are_bytes() {
        assert_eq!([0.0, f32::INFINITY, f32::NAN].map(|density| byte(density, 0.01)), [0, 255, 0]);
        assert!((0.9 - MAX_OPACITY * (f32::from(NEARLY_OPAQUE) / 255.0).powi(2)).abs() < 5e-3);
    }
}
