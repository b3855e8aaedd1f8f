//! Straight (not premultiplied) RGBA.

use std::path::Path;

use super::{Image, codec, resize::box_filter};
use crate::error::SceneError;

/// A straight-alpha RGBA image in `f32`, as decoded from a file of any depth.
///
/// Pixels are row-major from the top left, `width · height` of them.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbaImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Red, green, blue and coverage, each in `[0, 1]`; colours are not multiplied by coverage.
    pub pixels: Vec<[f32; 4]>,
    /// Whether the coverage comes from the file; otherwise it is 1 everywhere.
    pub has_alpha: bool,
}

impl RgbaImage {
    /// Returns `rgb · α + background · (1 − α)` in every pixel.
    pub fn composite(&self, background: [f32; 3]) -> Image {
        self.compose((self.width, self.height), self.premultiplied(), background)
    }

    /// Resizes with a box filter, then composites on `background`.
    ///
    /// The filter averages *premultiplied* colours and coverage over the area each output pixel
    /// covers, fractional pixels by their fraction, so that an object's edge takes no colour from
    /// what lies hidden under α = 0. The order matters only for that; compositing is linear.
    pub fn composite_resized(&self, width: u32, height: u32, background: [f32; 3]) -> Image {
        if (width, height) == (self.width, self.height) {
            return self.composite(background);
        }
        let source: Vec<_> = self.premultiplied().collect();
        let resized = box_filter(&source, (self.width, self.height), (width, height));
        self.compose((width, height), resized.into_iter(), background)
    }

    fn premultiplied(&self) -> impl Iterator<Item = [f32; 4]> {
        self.pixels.iter().map(|&[r, g, b, a]| [r * a, g * a, b * a, a])
    }

    fn compose(&self, size: (u32, u32), premultiplied: impl Iterator<Item = [f32; 4]>, background: [f32; 3]) -> Image {
        let over = |[r, g, b, a]: [f32; 4]| {
            let [kr, kg, kb] = background.map(|k| k * (1.0 - a));
            ([r + kr, g + kg, b + kb], a)
        };
        let (rgb, alpha): (Vec<_>, Vec<_>) = premultiplied.map(over).unzip();
        Image { width: size.0, height: size.1, rgb, alpha: self.has_alpha.then_some(alpha) }
    }
}

/// An 8-bit straight-alpha RGBA image, as a PNG file holds it. Procedural scenes define their pixels in this form, so
/// that exporting and loading a scene changes nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rgba8 {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Pixels, row-major from the top left, `width · height` of them.
    pub pixels: Vec<[u8; 4]>,
}

impl Rgba8 {
    /// Converts the pixels to `[0, 1]`: `v / 255`.
    pub fn to_f32(&self) -> RgbaImage {
        let pixels = self.pixels.iter().map(|p| p.map(|v| f32::from(v) / 255.0)).collect();
        RgbaImage { width: self.width, height: self.height, pixels, has_alpha: true }
    }

    /// Writes an 8-bit RGBA PNG.
    ///
    /// # Errors
    /// The file cannot be written, or `pixels` does not hold `width · height` pixels.
    pub fn write_png(&self, path: &Path) -> Result<(), SceneError> {
        codec::write_png(path, self.width, self.height, self.pixels.as_flattened(), ::image::ColorType::Rgba8)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two_by_two() -> RgbaImage {
        // Opaque red, hidden green, half blue, opaque white.
        let pixels = vec![[1.0, 0.0, 0.0, 1.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.5], [1.0; 4]];
        RgbaImage { width: 2, height: 2, pixels, has_alpha: true }
    }

    #[test]
    fn composite_by_hand() {
        let image = two_by_two().composite([1.0, 1.0, 0.0]);
        assert_eq!(image.rgb, [[1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.5, 0.5, 0.5], [1.0; 3]]);
        assert_eq!(image.alpha, Some(vec![1.0, 0.0, 0.5, 1.0]));
    }

    #[test]
    fn resizing_ignores_colour_under_zero_alpha() {
        let image = two_by_two().composite_resized(1, 1, [0.0; 3]);
        // Mean of premultiplied (1,0,0) (0,0,0) (0,0,.5) (1,1,1); coverage 2.5 / 4.
        assert_eq!(image.rgb, [[0.5, 0.25, 0.375]]);
        assert_eq!(image.alpha, Some(vec![0.625]));
    }
}
