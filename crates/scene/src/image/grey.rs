use super::{Image, bilinear, resized_dimensions};

/// Grey image, row-major.
#[derive(Clone, Debug, PartialEq)]
pub struct GreyImage {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `width · height` values.
    pub values: Vec<f32>,
}

impl GreyImage {
    /// Converts row-major colours in `[0, 1]` to luma, `0.299 R + 0.587 G + 0.114 B` (BT.601).
    pub fn luma(width: usize, height: usize, rgb: impl Iterator<Item = [f32; 3]>) -> Self {
        Self { width, height, values: rgb.map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b).collect() }
    }

    /// Reduces `image` until its longest side is at most `size` pixels, and takes the mean of its channels.
    pub fn mean(image: &Image, size: u32) -> Self {
        let longest = image.width.max(image.height).min(size);
        let (width, height) = resized_dimensions(image.width, image.height, longest);
        let image = image.resized(width, height);
        let values = image.rgb.iter().map(|rgb| (rgb[0] + rgb[1] + rgb[2]) / 3.0).collect();
        Self { width: width as usize, height: height as usize, values }
    }

    /// Returns the value of column `x`, row `y`, which must be inside the image.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.values[y * self.width + x]
    }

    /// Interpolates bilinearly between pixel centres at the continuous position `(x, y)`; NaN outside the image.
    pub fn sample(&self, x: f32, y: f32) -> f32 {
        if !(x >= 0.0 && y >= 0.0 && x <= self.width as f32 && y <= self.height as f32) {
            return f32::NAN;
        }
        bilinear([self.width, self.height], (x, y), |pixel| self.values[pixel])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_become_means_or_luma() {
        let mut image = Image::filled(4, 2, [0.25, 0.5, 0.75]);
        image.rgb[..2].fill([0.0, 0.25, 0.5]);
        let mean = |size, (width, height), values| {
            assert_eq!(GreyImage::mean(&image, size), GreyImage { width, height, values });
        };
        mean(9, (4, 2), vec![0.25, 0.25, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5]);
        mean(2, (2, 1), vec![0.375, 0.5]);
        let luma = GreyImage::luma(3, 1, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].into_iter());
        assert_eq!((luma.at(0, 0), luma.at(1, 0), luma.at(2, 0)), (0.299, 0.587, 0.114));
    }

    #[test]
    fn values_are_interpolated_between_centres() {
        let image = GreyImage { width: 2, height: 2, values: vec![0.0, 1.0, 2.0, 3.0] };
        assert_eq!([image.sample(0.5, 0.5), image.sample(1.0, 1.0), image.sample(2.0, 2.0)], [0.0, 1.5, 3.0]);
        assert!(image.sample(2.1, 1.0).is_nan() && image.sample(f32::NAN, 1.0).is_nan());
    }
}
