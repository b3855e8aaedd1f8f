//! The images that a run leaves.

use std::io::Cursor;
use std::path::Path;

use anyhow::{Context, Result};
use image::{ImageFormat, RgbImage};
use infonerf_metrics::to_rgb8;
use infonerf_report::{depth_image, error_image, write_atomically};
use infonerf_scene::{Scene, View};
use infonerf_train::TestView;

/// Writes a test view's render, truth, depth and error below a run's folder.
pub(super) fn write_pictures(folder: &Path, scene: &Scene, view: &View, result: &TestView) -> Result<()> {
    let image = &result.image;
    let (width, height) = (image.width, image.height);
    let pictures = [
        ("test", to_rgb8(&image.rgb, width, height)?),
        ("truth", to_rgb8(&view.image.rgb, width, height)?),
        ("depth", depth_image(&image.depth, &image.acc, width, height, scene.space.near, scene.space.far)?),
        ("error", error_image(&image.rgb, &view.image.rgb, width, height)?),
    ];
    for (kind, picture) in pictures {
        save_png(&picture, &folder.join(kind).join(format!("{:03}.png", view.id)))?;
    }
    Ok(())
}

/// Writes a PNG, with its folder.
///
/// # Errors
/// If it cannot be written; no part of it is left.
pub fn save_png(picture: &RgbImage, path: &Path) -> Result<()> {
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, ImageFormat::Png).with_context(|| path.display().to_string())?;
    Ok(write_atomically(path, bytes.get_ref())?)
}
