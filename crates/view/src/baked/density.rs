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
    fn encoded_densities_are_within_a_step() {
        let voxel = 0.01;
        let mut last = 0;
        for i in 0..400 {
            let density = 10f32.powf(-3.0 + i as f32 * 0.02);
            let stored = byte(density, voxel);
            assert!(stored >= last, "bytes rise with the density");
            last = stored;
            let root = f32::from(stored) / 255.0;
            let (opacity, expected) = (MAX_OPACITY * root * root, -(-density * voxel).exp_m1());
            // Half a step of the root, and what lies beyond the greatest.
            let bound = expected.sqrt() / 255.0 + 5e-4;
            assert!((opacity - expected).abs() < bound, "{density}: {opacity} for {expected}");
        }
        assert_eq!((byte(0.0, voxel), byte(f32::INFINITY, voxel), byte(f32::NAN, voxel)), (0, 255, 0));
        assert!((0.9 - MAX_OPACITY * (f32::from(NEARLY_OPAQUE) / 255.0).powi(2)).abs() < 5e-3);
    }
}
