/// Luma of each pixel, `Y = 0.299 R + 0.587 G + 0.114 B` (ITU-R BT.601), the grey image of [`crate::gmsd`] and
/// [`crate::sharpness`].
pub fn luminance(pixels: &[[f32; 3]]) -> Vec<f64> {
    pixels.iter().map(|&[r, g, b]| 0.299 * f64::from(r) + 0.587 * f64::from(g) + 0.114 * f64::from(b)).collect()
}
