use image::{Rgb, RgbImage};

use crate::MetricError;
use crate::size::check_length;

/// Pixels rounded to 8 bits and back: `round(255 · clamp(x, 0, 1)) / 255`, what a PNG of them would hold.
///
/// The protocol rounds before any metric, so that a render in memory and the same render read from disk score the
/// same. NaN stays NaN, for a metric to refuse.
pub fn quantise_8bit(pixels: &[[f32; 3]]) -> Vec<[f32; 3]> {
    pixels.iter().map(|pixel| pixel.map(|value| rounded(value) / 255.0)).collect()
}

/// The picture of `pixels`, row-major `[height × width]`, rounded as [`quantise_8bit`] does; NaN becomes black.
///
/// # Errors
/// [`MetricError::Length`] when `pixels` does not hold `width × height` pixels.
pub fn to_rgb8(pixels: &[[f32; 3]], width: u32, height: u32) -> Result<RgbImage, MetricError> {
    check_length("image", pixels.len(), [width as usize, height as usize])?;
    Ok(RgbImage::from_fn(width, height, |x, y| {
        Rgb(pixels[y as usize * width as usize + x as usize].map(|value| rounded(value) as u8))
    }))
}

/// Row-major pixels of an 8-bit picture, in `[0, 1]`.
pub fn from_rgb8(image: &RgbImage) -> Vec<[f32; 3]> {
    image.pixels().map(|pixel| pixel.0.map(|value| f32::from(value) / 255.0)).collect()
}

fn rounded(value: f32) -> f32 {
    (255.0 * value.clamp(0.0, 1.0)).round()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_to_the_nearest_step_and_clamps() {
        assert_eq!(quantise_8bit(&[[-1.0, 0.501, 2.0]]), [[0.0, 128.0 / 255.0, 1.0]]);
        assert!(quantise_8bit(&[[f32::NAN; 3]])[0][0].is_nan());
    }

    #[test]
    fn a_picture_reads_back_as_the_rounded_pixels() {
        let pixels: Vec<[f32; 3]> = (0..6).map(|i| [i as f32 / 7.0, 0.1, 1.5]).collect();
        assert_eq!(from_rgb8(&to_rgb8(&pixels, 3, 2).unwrap()), quantise_8bit(&pixels));
        assert!(to_rgb8(&pixels, 4, 2).is_err());
    }
}
