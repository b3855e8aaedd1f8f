//! Which pixels of a view count.

use std::path::Path;

use infonerf_scene::image::{dimensions, read_rgba};
use infonerf_scene::{Camera, SceneError, View};

use super::frames::Frame;

/// What a mask beside an image is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MaskRole {
    /// Masked metrics are of the pixels that are not black.
    Counts,
    /// The same, and outside there is nothing: the mask is the image's alpha.
    Matte,
    /// A capture's own, see [`infonerf_scene::MaskUse`].
    Capture,
}

/// The pixels of a mask that are not black, row-major. The mask must have the image's size.
pub(super) fn read_mask(path: &Path, size: (u32, u32)) -> Result<Vec<bool>, SceneError> {
    let expected = format!("a mask of {}×{} pixels like its image", size.0, size.1);
    let found = dimensions(path)?;
    if found != size {
        return Err(SceneError::malformed(path, expected, format!("it has {}×{}", found.0, found.1)));
    }
    Ok(read_rgba(path)?.pixels.iter().map(|&[r, g, b, a]| a > 0.0 && r.max(g).max(b) > 0.0).collect())
}

/// Whether the image reaches beyond where the lens can be inverted.
fn exceeds_lens(camera: &Camera) -> bool {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let shares = [0.0, 0.5, 1.0];
    let mut border = shares.iter().flat_map(|x| shares.iter().map(move |y| (x * w, y * h)));
    !camera.lens.is_perspective() && border.any(|(x, y)| !camera.covers(x, y))
}

/// The pixels whose ray is known, row-major, where that is not all of them.
pub(super) fn lens_mask(camera: &Camera) -> Option<Vec<bool>> {
    if !exceeds_lens(camera) {
        return None;
    }
    let pixel = |i: u32| f64::from(i) + 0.5;
    Some((0..camera.height).flat_map(|y| (0..camera.width).map(move |x| camera.covers(pixel(x), pixel(y)))).collect())
}

/// Leaves the views without a valid pixel out of `test`, and gives warnings of what is left out.
///
/// # Errors
/// Such a view is among the training views, which are of `frames`, or no test view is left.
pub(super) fn check_valid(frames: &[&Frame], train: &[View], test: &mut Vec<View>) -> Result<Vec<String>, SceneError> {
    let is_blank = |view: &View| view.valid.as_ref().is_some_and(|valid| !valid.contains(&true));
    if let Some((frame, _)) = frames.iter().zip(train).find(|(_, view)| is_blank(view)) {
        let file = frame.mask.as_ref().map_or(&frame.image, |(mask, _)| mask);
        let expected = "a mask that leaves pixels to train on (or `scene.masks = \"score\"`)";
        return Err(SceneError::malformed(file, expected, "all are black"));
    }
    let mut warnings = Vec::new();
    let blank: Vec<String> = test.extract_if(.., |view| is_blank(view)).map(|view| view.name).collect();
    if !blank.is_empty() {
        warnings.push(format!("masks leave no pixel of the test views {}: they are not tested", blank.join(", ")));
    }
    if test.is_empty() {
        return Err(SceneError::request("test", "a view whose mask is not black throughout", "none"));
    }
    let partial = train.iter().chain(&*test).filter(|view| view.valid.is_some());
    let (bent, masked): (Vec<&View>, Vec<&View>) = partial.partition(|view| exceeds_lens(&view.camera));
    for (what, views) in [("the lens cannot be inverted at the border", bent), ("masks leave out pixels", masked)] {
        if !views.is_empty() {
            let count = views.len();
            warnings.push(format!("{what} of {count} views: those pixels are neither trained on nor measured"));
        }
    }
    Ok(warnings)
}

#[cfg(test)]
mod tests {
    use super::*;
    use infonerf_scene::{Lens, Rgba8};

    #[test]
    fn masks_are_checked() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.png");
        let mask = Rgba8 { width: 2, height: 1, pixels: vec![[0, 0, 0, 255], [0, 9, 0, 255]] };
        mask.write_png(&path).unwrap();
        assert_eq!(read_mask(&path, (2, 1)).unwrap(), [false, true]);
        assert!(read_mask(&path, (1, 2)).unwrap_err().to_string().contains("it has 2×1"));
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
