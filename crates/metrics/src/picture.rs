use std::ops::Range;

use image::{Rgb, RgbImage};

use crate::error::MetricError;

/// RGB image as displayed, composited on its background: at least one pixel, all values finite, nominally in [0, 1].
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    pixels: Vec<[f32; 3]>,
    size: [usize; 2],
}

impl Picture {
    /// Wraps row-major `pixels`, `pixels[y * width + x]`.
    ///
    /// # Errors
    /// If there are not `width × height` pixels, there is none, or one is not finite.
    pub fn new(pixels: Vec<[f32; 3]>, width: usize, height: usize) -> Result<Self, MetricError> {
        check_length("picture", pixels.len(), [width, height])?;
        if pixels.is_empty() {
            return Err(MetricError::empty("picture"));
        }
        match pixels.iter().position(|pixel| pixel.iter().any(|value| !value.is_finite())) {
            Some(index) => Err(MetricError::not_finite("picture", index)),
            None => Ok(Self { pixels, size: [width, height] }),
        }
    }

    /// Converts an 8-bit image, value / 255.
    ///
    /// # Errors
    /// If the image has no pixels.
    pub fn from_rgb8(image: &RgbImage) -> Result<Self, MetricError> {
        let pixels = image.pixels().map(|pixel| pixel.0.map(|value| f32::from(value) / 255.0)).collect();
        Self::new(pixels, image.width() as usize, image.height() as usize)
    }

    /// Returns the row-major pixels.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// Returns width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Rounds every value to 8 bits and back, `round(255 · clamp(x, 0, 1)) / 255`, as a PNG does.
    pub fn rounded(&self) -> Self {
        self.mapped(|_, pixel| pixel.map(|value| eight_bit(value) / 255.0))
    }

    pub(crate) fn cropped(&self, [columns, rows]: [Range<usize>; 2]) -> Self {
        let size = [columns.len(), rows.len()];
        let rows = self.pixels.chunks_exact(self.size[0]).skip(rows.start).take(rows.len());
        Self { pixels: rows.flat_map(|row| &row[columns.clone()]).copied().collect(), size }
    }

    /// Replaces pixel `i` by `pixel(i, value)`, which returns finite values.
    pub(crate) fn mapped(&self, pixel: impl Fn(usize, [f32; 3]) -> [f32; 3]) -> Self {
        let pixels = self.pixels.iter().enumerate().map(|(index, &value)| pixel(index, value)).collect();
        Self { pixels, size: self.size }
    }
}

/// Converts row-major `pixels`, `[height × width]`, to an 8-bit image, clamped and rounded to the nearest step; NaN is black.
///
/// # Errors
/// If `pixels` does not hold `width × height` pixels.
pub fn to_rgb8(pixels: &[[f32; 3]], width: u32, height: u32) -> Result<RgbImage, MetricError> {
    check_length("image", pixels.len(), [width as usize, height as usize])?;
    let pixel = |x: u32, y: u32| pixels[y as usize * width as usize + x as usize];
    Ok(RgbImage::from_fn(width, height, |x, y| Rgb(pixel(x, y).map(|value| eight_bit(value) as u8))))
}

fn eight_bit(value: f32) -> f32 {
    (255.0 * value.clamp(0.0, 1.0)).round()
}

pub(crate) fn check_sizes(render: &Picture, truth: &Picture) -> Result<(), MetricError> {
    check_size("truth", truth.size, render.size)
}

/// Checks that `what` is as large as the render.
pub(crate) fn check_size(what: &str, found: [usize; 2], expected: [usize; 2]) -> Result<(), MetricError> {
    let dimensions = |[width, height]: [usize; 2]| format!("{width}×{height}");
    if found == expected {
        return Ok(());
    }
    let (found, expected) = (dimensions(found), dimensions(expected));
    Err(MetricError::other(format!("the {what} has {found} pixels, the render {expected}")))
}

pub(crate) fn check_length(what: &str, found: usize, [width, height]: [usize; 2]) -> Result<(), MetricError> {
    let expected = width.saturating_mul(height);
    if found == expected { Ok(()) } else { Err(MetricError::length(what, found, expected)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_must_fit_the_size_and_be_finite() {
        let refused = |pixels: Vec<[f32; 3]>, width, height| Picture::new(pixels, width, height).unwrap_err();
        assert_eq!(refused(vec![], 0, 0), MetricError::empty("picture"));
        assert_eq!(refused(vec![[0.0; 3]; 2], 2, 2), MetricError::length("picture", 2, 4));
        assert_eq!(refused(vec![[0.0; 3]; 2], usize::MAX, 2), MetricError::length("picture", 2, usize::MAX));
        assert_eq!(refused(vec![[0.0; 3], [0.0, f32::NAN, 0.0]], 2, 1), MetricError::not_finite("picture", 1));
    }

    #[test]
    fn rounding_takes_the_nearest_step_and_clamps_as_images_of_8_bits_do() {
        let pixels = (0..6).map(|i| [i as f32 / 7.0 - 0.1, 0.501, 2.0]).collect();
        let picture = Picture::new(pixels, 3, 2).unwrap();
        assert_eq!(picture.rounded().pixels()[0], [0.0, 128.0 / 255.0, 1.0]);
        assert_eq!(Picture::from_rgb8(&to_rgb8(picture.pixels(), 3, 2).unwrap()).unwrap(), picture.rounded());
        assert!(to_rgb8(picture.pixels(), 4, 2).is_err() && Picture::from_rgb8(&RgbImage::new(0, 4)).is_err());
    }
}
