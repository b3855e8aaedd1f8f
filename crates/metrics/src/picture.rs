use image::RgbImage;

use crate::rgb8::{from_rgb8, quantise_8bit, to_rgb8};
use crate::size::{check_length, check_size};
use crate::{MetricError, Rectangle};

/// An RGB picture as displayed and composited on its background: at least one pixel, all values finite, nominally in
/// [0, 1].
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    pixels: Vec<[f32; 3]>,
    size: [usize; 2],
}

impl Picture {
    /// The picture of row-major `pixels`, `pixels[y * width + x]`.
    ///
    /// # Errors
    /// [`MetricError::Empty`], [`MetricError::Length`] unless there are `width × height` pixels, and
    /// [`MetricError::NonFinite`] with the index of the pixel.
    pub fn new(pixels: Vec<[f32; 3]>, width: usize, height: usize) -> Result<Self, MetricError> {
        check_length("picture", pixels.len(), [width, height])?;
        if pixels.is_empty() {
            return Err(MetricError::Empty { what: "picture" });
        }
        match pixels.iter().position(|pixel| pixel.iter().any(|value| !value.is_finite())) {
            Some(index) => Err(MetricError::NonFinite { what: "picture", index }),
            None => Ok(Self { pixels, size: [width, height] }),
        }
    }

    /// The picture of an 8-bit image, value / 255.
    ///
    /// # Errors
    /// [`MetricError::Empty`] for an image without pixels.
    pub fn from_rgb8(image: &RgbImage) -> Result<Self, MetricError> {
        Self::new(from_rgb8(image), image.width() as usize, image.height() as usize)
    }

    /// The 8-bit image, rounded to the nearest step.
    ///
    /// # Errors
    /// [`MetricError::Length`] when a side does not fit in 32 bits.
    pub fn to_rgb8(&self) -> Result<RgbImage, MetricError> {
        let side = |side: usize| u32::try_from(side).unwrap_or(u32::MAX);
        to_rgb8(&self.pixels, side(self.width()), side(self.height()))
    }

    /// Row-major pixels.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// Width and height in pixels.
    pub fn size(&self) -> [usize; 2] {
        self.size
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.size[0]
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.size[1]
    }

    /// Every value rounded to 8 bits, see [`quantise_8bit`].
    #[must_use]
    pub fn rounded(&self) -> Self {
        Self { pixels: quantise_8bit(&self.pixels), size: self.size }
    }

    /// The part inside `rectangle`.
    ///
    /// # Panics
    /// If it reaches out of the picture or is empty.
    pub(crate) fn cropped(&self, rectangle: Rectangle) -> Self {
        Self { pixels: rectangle.of(&self.pixels, self.width()), size: rectangle.size }
    }

    /// The same size with pixel `i` made by `pixel(i, value)`, which gives finite values.
    pub(crate) fn mapped(&self, pixel: impl Fn(usize, [f32; 3]) -> [f32; 3]) -> Self {
        let pixels = self.pixels.iter().enumerate().map(|(index, &value)| pixel(index, value)).collect();
        Self { pixels, size: self.size }
    }
}

/// The render and the truth have the same size.
pub(crate) fn check_sizes(render: &Picture, truth: &Picture) -> Result<(), MetricError> {
    check_size("truth", truth.size, render.size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_has_pixels_of_its_size_and_finite() {
        let refused = |pixels: Vec<[f32; 3]>, width, height| Picture::new(pixels, width, height).unwrap_err();
        assert_eq!(refused(vec![], 0, 0), MetricError::Empty { what: "picture" });
        let length = MetricError::Length { what: "picture", found: 2, expected: 4 };
        assert_eq!(refused(vec![[0.0; 3]; 2], 2, 2), length);
        assert!(matches!(refused(vec![[0.0; 3]; 2], usize::MAX, 2), MetricError::Length { .. }));
        let nan = MetricError::NonFinite { what: "picture", index: 1 };
        assert_eq!(refused(vec![[0.0; 3], [0.0, f32::NAN, 0.0]], 2, 1), nan);
    }

    #[test]
    fn eight_bits_there_and_back_is_rounding() {
        let pixels = (0..6).map(|i| [i as f32 / 7.0, 0.1, 1.5]).collect();
        let picture = Picture::new(pixels, 3, 2).unwrap();
        assert_eq!(Picture::from_rgb8(&picture.to_rgb8().unwrap()).unwrap(), picture.rounded());
        assert!(Picture::from_rgb8(&RgbImage::new(0, 4)).is_err());
    }
}
