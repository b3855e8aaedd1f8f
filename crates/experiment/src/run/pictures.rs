//! The pictures that a run leaves.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use infonerf_metrics::to_rgb8;
use infonerf_report::{depth_image, error_image};
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
pub fn save_png(picture: &image::RgbImage, path: &Path) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let saved = picture.save(path);
    if saved.is_err() {
        let _ = fs::remove_file(path);
    }
    saved.with_context(|| path.display().to_string())
}
