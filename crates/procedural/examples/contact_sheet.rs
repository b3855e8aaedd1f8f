//! Renders a contact sheet of procedural scenes: `contact_sheet FOLDER [SIZE [SCENE...]]`, all of them by default.
//!
//! The first row shows the four training views of seed 0, the second four test views. Of captures there is a third,
//! the first row again with all that is not the subject dimmed.

use std::path::Path;
use std::time::Instant;

use infonerf_procedural as procedural;
use infonerf_scene::{Image, SceneError, SceneRequest, TestProtocol, View, ViewSelection};

fn main() -> Result<(), SceneError> {
    let mut args = std::env::args().skip(1);
    let folder = args.next().unwrap_or_else(|| ".".into());
    let size = args.next().and_then(|s| s.parse().ok()).unwrap_or(procedural::DEFAULT_SIZE);
    let mut names: Vec<String> = args.collect();
    if names.is_empty() {
        names = procedural::NAMES.map(str::to_owned).to_vec();
    }
    for name in &names {
        let request = SceneRequest {
            train: ViewSelection::Seed { seed: 0, count: 4 },
            test: TestProtocol::Every(if procedural::YARDSTICK.contains(&name.as_str()) { 8 } else { 1 }),
            image_size: Some(size),
            ..Default::default()
        };
        let start = Instant::now();
        let scene = procedural::load(name, &request)?;
        eprintln!("{name}: {} images in {:.2?}", scene.train.len() + scene.test.len(), start.elapsed());
        let mut rows: Vec<Vec<&Image>> = vec![scene.train.iter().map(|v| &*v.image).collect()];
        let step = (scene.test.len() / 4).max(1);
        rows.push(scene.test.iter().step_by(step).take(4).map(|v| &*v.image).collect());
        let subjects: Vec<Image> = match procedural::CAPTURES.contains(&name.as_str()) {
            true => scene.train.iter().map(|v| subject(name, v)).collect::<Result<_, _>>()?,
            false => Vec::new(),
        };
        if !subjects.is_empty() {
            rows.push(subjects.iter().collect());
        }
        sheet(&rows, size).write_png(&Path::new(&folder).join(format!("{name}.png")))?;
    }
    Ok(())
}

/// The view with everything but the subject dimmed.
fn subject(name: &str, view: &View) -> Result<Image, SceneError> {
    let mask = procedural::object_mask(name, &view.camera)?;
    let mut image = Image::clone(&view.image);
    for (pixel, subject) in image.rgb.iter_mut().zip(mask) {
        *pixel = if subject { *pixel } else { pixel.map(|v| 0.25 * v) };
    }
    Ok(image)
}

/// Puts images of `size`² pixels side by side in rows of four.
fn sheet(rows: &[Vec<&Image>], size: u32) -> Image {
    let mut whole = Image::filled(4 * size, size * rows.len() as u32, [1.0; 3]);
    for (row, images) in rows.iter().enumerate() {
        for (column, image) in images.iter().enumerate() {
            for (i, pixel) in image.rgb.iter().enumerate() {
                let (x, y) = (i % size as usize, i / size as usize);
                let at = (row * size as usize + y) * 4 * size as usize + column * size as usize + x;
                if let Some(target) = whole.rgb.get_mut(at) {
                    *target = *pixel;
                }
            }
        }
    }
    whole
}
