//! Which pixels of a view count.

use std::path::Path;

use infonerf_scene::image::{dimensions, read_rgba};
use infonerf_scene::{Camera, SceneError};

/// What a mask beside an image is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MaskRole {
    /// Only pixels that are not black count; the photograph stays as it is.
    Counts,
    /// The same, and outside there is nothing: the mask is the image's alpha.
    Matte,
}

/// The pixels of a mask that are not black, row-major. The mask must have the image's size and not be empty.
pub(super) fn read_mask(path: &Path, size: (u32, u32)) -> Result<Vec<bool>, SceneError> {
    let expected = format!("a mask of {}×{} pixels like its image", size.0, size.1);
    let found = dimensions(path)?;
    if found != size {
        return Err(SceneError::malformed(path, expected, format!("it has {}×{}", found.0, found.1)));
    }
    let counts: Vec<bool> =
        read_rgba(path)?.pixels.iter().map(|&[r, g, b, a]| a > 0.0 && r.max(g).max(b) > 0.0).collect();
    if counts.iter().all(|&c| !c) {
        return Err(SceneError::malformed(path, "a mask with at least one pixel that is not black", "all are black"));
    }
    Ok(counts)
}

/// The pixels whose ray is known, row-major, where that is not all of them.
pub(super) fn lens_mask(camera: &Camera) -> Option<Vec<bool>> {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let shares = [0.0, 0.5, 1.0];
    let border = shares.iter().flat_map(|x| shares.iter().map(move |y| (x * w, y * h)));
    if camera.lens.is_perspective() || border.clone().all(|(x, y)| camera.covers(x, y)) {
        return None;
    }
    let pixel = |i: u32| f64::from(i) + 0.5;
    Some((0..camera.height).flat_map(|y| (0..camera.width).map(move |x| camera.covers(pixel(x), pixel(y)))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use infonerf_scene::{Lens, Rgba8};

    #[test]
    fn masks_are_checked() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.png");
        let mut mask = Rgba8 { width: 2, height: 1, pixels: vec![[0, 0, 0, 255], [0, 9, 0, 255]] };
        mask.write_png(&path).unwrap();
        assert_eq!(read_mask(&path, (2, 1)).unwrap(), [false, true]);
        assert!(read_mask(&path, (1, 2)).unwrap_err().to_string().contains("it has 2×1"));
        mask.pixels[1] = [0, 0, 0, 255];
        mask.write_png(&path).unwrap();
        assert!(read_mask(&path, (2, 1)).unwrap_err().to_string().contains("all are black"));
    }

    #[test]
    fn pixels_beyond_the_lens_do_not_count() {
        let camera = Camera::from_fov(20, 20, 1.5, glam::DMat4::IDENTITY);
        assert_eq!(lens_mask(&camera), None);
        let bent = camera.with_lens(Lens::radial_tangential([-0.3, 0.0, 0.0, 0.0], [0.0; 2]));
        let mask = lens_mask(&bent).unwrap();
        assert!(mask[10 * 20 + 10] && !mask[0]);
    }
}
