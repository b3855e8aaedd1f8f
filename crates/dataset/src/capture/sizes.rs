//! Scale at which a scene's images of different sizes are loaded.

use infonerf_scene::{Camera, resized_dimensions};

/// Max difference between the logarithms of two focal lengths in pixels at which images have one scale: they are crops
/// of each other, or portrait and landscape.
const SAME_SCALE: f64 = 0.1;

/// Scale of a scene's images; each is loaded into the middle of a shared canvas.
pub(super) struct ImageScale {
    /// Camera of an image of the most frequent size.
    base: Camera,
    /// Ratio of the loaded to the stored sides of an image of `base`'s size.
    factor: f64,
    pub canvas: (u32, u32),
}

impl ImageScale {
    /// Chooses the scale for the images of `cameras`, if any: no side is longer than `longest`, and no image is enlarged.
    ///
    /// The most frequent size is the base. Images with about the base's focal length in pixels are scaled like the
    /// base. Others, of another resolution or lens, are resized to the base's longest side.
    pub fn new(cameras: &[Camera], longest: Option<u32>) -> Option<Self> {
        let size = |camera: &Camera| (camera.width, camera.height);
        let count = |camera: &&Camera| cameras.iter().filter(|other| size(other) == size(camera)).count();
        let base = cameras.iter().rev().max_by_key(count)?.clone();
        let mut scale = Self { base, factor: 1.0, canvas: (1, 1) };
        let greatest = cameras.iter().map(|camera| scale.relative(camera)).fold(1.0, f64::max);
        let whole = cameras.iter().map(|camera| scale.relative(camera) * long_side(camera)).fold(1.0, f64::max);
        scale.factor = longest.map_or(1.0, |longest| f64::from(longest) / whole).min(1.0 / greatest);
        let sizes: Vec<(u32, u32)> = cameras.iter().map(|camera| scale.size(camera)).collect();
        let side = |of: fn(&(u32, u32)) -> u32| sizes.iter().map(of).max().unwrap_or(1);
        scale.canvas = (side(|size| size.0), side(|size| size.1));
        Some(scale)
    }

    /// Returns the most frequent size of the stored images.
    pub fn base_size(&self) -> (u32, u32) {
        (self.base.width, self.base.height)
    }

    /// Returns the size at which the image of `camera` is loaded.
    pub fn size(&self, camera: &Camera) -> (u32, u32) {
        let longest = (self.factor * self.relative(camera) * long_side(camera)).round().max(1.0) as u32;
        resized_dimensions(camera.width, camera.height, longest)
    }

    /// Returns `camera` for its loaded image on the canvas.
    pub fn framed(&self, camera: &Camera) -> Camera {
        let (width, height) = self.size(camera);
        camera.resized(width, height).framed(self.canvas.0, self.canvas.1)
    }

    /// Returns the factor from the stored sides of `camera`'s image to the base's scale.
    fn relative(&self, camera: &Camera) -> f64 {
        let focal = |camera: &Camera| (camera.fx * camera.fy).sqrt();
        let same_size = (camera.width, camera.height) == self.base_size();
        let same_scale = same_size || (focal(camera) / focal(&self.base)).ln().abs() < SAME_SCALE;
        if same_scale { 1.0 } else { long_side(&self.base) / long_side(camera) }
    }
}

pub(super) fn long_side(camera: &Camera) -> f64 {
    f64::from(camera.width.max(camera.height))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat4;

    #[test]
    fn images_of_all_sizes_come_to_one_scale() {
        let sizes = |sides: &[((u32, u32), f64)], longest| {
            let camera = |&(size, focal)| Camera::pinhole(size, [focal; 2], [1.0; 2], DMat4::IDENTITY);
            let cameras: Vec<Camera> = sides.iter().map(camera).collect();
            let scale = ImageScale::new(&cameras, longest).unwrap();
            (cameras.iter().map(|camera| scale.size(camera)).collect::<Vec<_>>(), scale.canvas)
        };
        // Images of one size, reduced as asked for.
        let one = sizes(&[((800, 600), 700.0), ((800, 600), 1400.0)], Some(400));
        assert_eq!(one, (vec![(400, 300); 2], (400, 300)));
        assert_eq!(sizes(&[((8, 6), 7.0)], Some(400)).1, (8, 6), "none is enlarged");
        // Portrait and landscape.
        let both = sizes(&[((96, 72), 100.0), ((72, 96), 100.0), ((96, 72), 100.0)], None);
        assert_eq!(both, (vec![(96, 72), (72, 96), (96, 72)], (96, 96)));
        // An image that is one pixel short, twice as large, and half as large: the smallest sets the size.
        for (other, longest, all) in [
            (((96, 95), 100.0), Some(48), (48, 48)),
            (((192, 192), 200.0), None, (96, 96)),
            (((48, 48), 50.0), Some(96), (48, 48)),
        ] {
            assert_eq!(sizes(&[((96, 96), 100.0), other, ((96, 96), 100.0)], longest), (vec![all; 3], all));
        }
    }
}
