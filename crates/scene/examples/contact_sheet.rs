//! Renders a contact sheet of every procedural scene: `contact_sheet FOLDER [SIZE]`.
//!
//! The first row shows the four training views of seed 0, the second four test views.

use std::path::Path;
use std::time::Instant;

use infonerf_scene::{Image, SceneError, SceneRequest, SceneSource, TestProtocol, ViewSelection, load, procedural};

fn main() -> Result<(), SceneError> {
    let mut args = std::env::args().skip(1);
    let folder = args.next().unwrap_or_else(|| ".".into());
    let size = args.next().and_then(|s| s.parse().ok()).unwrap_or(procedural::DEFAULT_SIZE);
    for name in procedural::NAMES {
        let request = SceneRequest {
            train: ViewSelection::Seed { seed: 0, count: 4 },
            test: TestProtocol::Every(8),
            image_size: Some(size),
            ..Default::default()
        };
        let start = Instant::now();
        let scene = load(&SceneSource::Procedural(name.into()), &request)?;
        eprintln!("{name}: {} images in {:.2?}", scene.train.len() + scene.test.len(), start.elapsed());
        let mut rows: Vec<Vec<&Image>> = vec![scene.train.iter().map(|v| &*v.image).collect()];
        rows.push(scene.test.iter().step_by(6).take(4).map(|v| &*v.image).collect());
        sheet(&rows, size).write_png(&Path::new(&folder).join(format!("{name}.png")))?;
    }
    Ok(())
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
