//! Images: composited colours for training, and straight RGBA as files hold it.

mod codec;
mod exif;
mod grey;
mod resize;
mod rgba;

pub use ::image::metadata::Orientation;
pub(crate) use codec::MAX_SIDE;
pub use codec::{
    decode_bytes, dimensions, find_image, has_alpha, has_transparency, is_image_name, list_images, read_rgba,
    read_rgba_turned, stored_dimensions, unread_format,
};
pub use exif::{FILM_WIDTH, focal_length, orientation, quarter_turns};
pub use grey::GreyImage;
pub use resize::resized_dimensions;
pub use rgba::{Rgba8, RgbaImage};

use std::ops::{Add, Mul};
use std::path::Path;

use crate::error::SceneError;

/// An RGB image composited on its scene's background, with the coverage it was composited with.
///
/// Pixels are row-major from the top left; `rgb` (and `alpha`) hold `width · height` values.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Colours in `[0, 1]`, display-encoded (sRGB) as in the file.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage in `[0, 1]`; `None` without an alpha channel, and in scenes whose pixels are all opaque.
    pub alpha: Option<Vec<f32>>,
}

impl Image {
    /// Returns an image of one colour without alpha.
    pub fn filled(width: u32, height: u32, rgb: [f32; 3]) -> Self {
        Self { width, height, rgb: vec![rgb; width as usize * height as usize], alpha: None }
    }

    /// Returns the colour of column `x`, row `y`, or `None` outside the image.
    pub fn get(&self, x: u32, y: u32) -> Option<[f32; 3]> {
        let pixel = self.rgb.get(y as usize * self.width as usize + x as usize);
        pixel.filter(|_| x < self.width).copied()
    }

    /// Returns every channel rounded to 8 bits, `⌊255 · clamp(v, 0, 1) + ½⌋` with 0 for NaN, interleaved RGB.
    pub fn to_rgb8(&self) -> Vec<u8> {
        self.rgb.iter().flatten().map(|&v| round_to_u8(v)).collect()
    }

    /// Returns the image after a round trip through 8 bits, as it would come back from a PNG.
    pub fn rounded(&self) -> Self {
        let round = |v: f32| f32::from(round_to_u8(v)) / 255.0;
        Self { rgb: self.rgb.iter().map(|p| p.map(round)).collect(), alpha: self.alpha.clone(), ..*self }
    }

    /// Returns the image at another size: each pixel the mean over the area that it covers.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let (from, to) = ((self.width, self.height), (width, height));
        let coverage = |alpha: &Vec<f32>| {
            let alpha: Vec<[f32; 1]> = alpha.iter().map(|&a| [a]).collect();
            resize::box_filter(&alpha, from, to).into_iter().map(|[a]| a).collect()
        };
        Self { width, height, rgb: resize::box_filter(&self.rgb, from, to), alpha: self.alpha.as_ref().map(coverage) }
    }

    /// Whether at least 95 % of the border is within 2 % of `colour`.
    pub fn has_border(&self, colour: [f32; 3]) -> bool {
        let (w, h) = (self.width, self.height);
        let border = (0..w).flat_map(|x| [(x, 0), (x, h - 1)]).chain((0..h).flat_map(|y| [(0, y), (w - 1, y)]));
        let border: Vec<_> = border.filter_map(|(x, y)| self.get(x, y)).collect();
        let like = |p: &&[f32; 3]| p.iter().zip(colour).all(|(a, b)| (a - b).abs() <= 0.02);
        !border.is_empty() && border.iter().filter(like).count() * 100 >= border.len() * 95
    }

    /// Reads an image file and composites it on `background`.
    ///
    /// # Errors
    /// The file is missing, unreadable, not an image, or larger than this crate reads.
    pub fn read(path: &Path, background: [f32; 3]) -> Result<Self, SceneError> {
        Ok(read_rgba(path)?.composite(background))
    }

    /// Writes the colours as an 8-bit RGB PNG, rounded by [`Self::to_rgb8`], without alpha.
    ///
    /// # Errors
    /// The file cannot be written, or `rgb` does not hold `width · height` pixels.
    pub fn write_png(&self, path: &Path) -> Result<(), SceneError> {
        codec::write_png(path, self.width, self.height, &self.to_rgb8(), ::image::ColorType::Rgb8)
    }
}

/// Resizes a mask: a pixel of the result is true if at least half of the area that it covers is.
pub fn resized_mask(mask: &[bool], from: (u32, u32), to: (u32, u32)) -> Vec<bool> {
    if from == to {
        return mask.to_vec();
    }
    let weights: Vec<[f32; 1]> = mask.iter().map(|&m| [f32::from(u8::from(m))]).collect();
    resize::box_filter(&weights, from, to).into_iter().map(|[w]| w >= 0.5 - 1e-6).collect()
}

/// Returns `⌊255 · clamp(v, 0, 1) + ½⌋`; NaN gives 0.
fn round_to_u8(v: f32) -> u8 {
    // `as` saturates, and takes NaN to 0.
    (v * 255.0 + 0.5) as u8
}

/// Interpolates `value`, a function of row-major pixel indices, between the four pixels around the continuous position
/// `(x, y)` of an image of `[width, height]` pixels. Beyond the outermost centres it returns the value at the edge.
pub fn bilinear<T: Add<Output = T> + Mul<f32, Output = T>>(
    [width, height]: [usize; 2],
    (x, y): (f32, f32),
    value: impl Fn(usize) -> T,
) -> T {
    let (x, y) = ((x - 0.5).clamp(0.0, (width - 1) as f32), (y - 0.5).clamp(0.0, (height - 1) as f32));
    let (left, top) = (x as usize, y as usize);
    let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (u, v) = (x - left as f32, y - top as f32);
    let row = |row: usize| value(row * width + left) * (1.0 - u) + value(row * width + right) * u;
    row(top) * (1.0 - v) + row(bottom) * v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding() {
        for (v, expected) in [(0.0, 0), (1.0, 255), (0.5, 128), (-3.0, 0), (7.0, 255), (f32::NAN, 0)] {
            assert_eq!(round_to_u8(v), expected, "{v}");
        }
        assert!((0..=255u8).all(|byte| round_to_u8(f32::from(byte) / 255.0) == byte));
    }

    #[test]
    fn values_are_bilinear_between_centres_and_constant_beyond() {
        for (x, y, expected) in [(0.0, 0.0, 0.0), (1.25, 1.0, 1.75), (1.0, 1.5, 2.5), (5.0, 0.5, 1.0), (2.0, 9.0, 5.0)]
        {
            assert_eq!(bilinear([2, 3], (x, y), |pixel| pixel as f32), expected, "{x} {y}");
        }
    }

    #[test]
    fn png_round_trip() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let mut image = Image::filled(3, 2, [1.0, 0.5, 0.0]);
        image.rgb[4] = [0.2, 0.4, 0.6];
        image.write_png(&path).unwrap();
        assert_eq!(Image::read(&path, [0.0; 3]).unwrap(), image.rounded());
        assert_eq!(image.get(1, 1), Some([0.2, 0.4, 0.6]));
        assert_eq!(image.get(3, 0), None);
    }

    #[test]
    fn writing_into_a_missing_folder_names_the_file() {
        let error = Image::filled(1, 1, [0.0; 3]).write_png(Path::new("no-such-folder/a.png")).unwrap_err().to_string();
        assert!(error.contains("no-such-folder/a.png"), "{error}");
    }
}
