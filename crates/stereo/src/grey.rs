use infonerf_scene::{Image, bilinear, resized_dimensions};

/// A grey picture, row-major.
#[derive(Clone, Debug)]
pub(crate) struct Grey {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

impl Grey {
    /// The mean of the channels of `image`, its longest side at most `size`.
    pub(crate) fn of(image: &Image, size: u32) -> Self {
        let longest = image.width.max(image.height).min(size);
        let (width, height) = resized_dimensions(image.width, image.height, longest);
        let image = image.resized(width, height);
        let values = image.rgb.iter().map(|rgb| (rgb[0] + rgb[1] + rgb[2]) / 3.0).collect();
        Self { width: width as usize, height: height as usize, values }
    }

    /// The value at the continuous position `(x, y)`, bilinear between pixel centres; NaN outside of the picture.
    pub(crate) fn sample(&self, x: f32, y: f32) -> f32 {
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
    fn values_are_interpolated_between_centres() {
        let image = Grey { width: 2, height: 2, values: vec![0.0, 1.0, 2.0, 3.0] };
        assert_eq!([image.sample(0.5, 0.5), image.sample(1.0, 1.0), image.sample(2.0, 2.0)], [0.0, 1.5, 3.0]);
        assert!(image.sample(2.1, 1.0).is_nan() && image.sample(f32::NAN, 1.0).is_nan());
    }
}
