//! Forward-facing captures in LLFF's format: `poses_bounds.npy` and `images`.

use std::path::Path;

use infonerf_procedural as procedural;
use infonerf_scene::SceneError;

use super::{ExportedView, make, photographs};
use crate::files::npy;

/// Number of photographs.
const VIEWS: usize = 40;

/// Writes `images/image<NNN>.png` and a row for each: the camera's down, right and backward axes, its position, and
/// (height, width, focal length) as columns of a 3×5 matrix, then the depths of the nearest and the farthest point.
pub(super) fn write(name: &str, size: u32, dir: &Path) -> Result<(), SceneError> {
    let (near, far, _) = procedural::extent(name)?;
    let photographs = photographs(name, procedural::photographs(name, size, VIEWS))?;
    make(&dir.join("images"))?;
    for (i, photograph) in photographs.iter().enumerate() {
        photograph.image.write_png(&dir.join(format!("images/image{i:03}.png")))?;
    }
    let rows: Vec<f64> = photographs.iter().flat_map(|p| row(p, (near, far))).collect();
    npy::write(&dir.join("poses_bounds.npy"), &[photographs.len() as u64, 17], &rows)
}

/// Returns the row of a photograph; `extent` is near and far where it shows nothing.
fn row(photograph: &ExportedView, extent: (f32, f32)) -> [f64; 17] {
    let camera = &photograph.camera;
    let [x, y, z, at] = [0, 1, 2, 3].map(|column| camera.to_world.col(column));
    let size = [f64::from(camera.height), f64::from(camera.width), camera.fx];
    let (near, far) = depths(photograph).unwrap_or(extent);
    let mut row = [0.0; 17];
    for i in 0..3 {
        row[5 * i..5 * i + 5].copy_from_slice(&[-y[i], x[i], z[i], at[i], size[i]]);
    }
    row[15..].copy_from_slice(&[f64::from(near), f64::from(far)]);
    row
}

/// Returns the least and the greatest depth along the camera's axis.
fn depths(photograph: &ExportedView) -> Option<(f32, f32)> {
    let width = photograph.camera.width as usize;
    let depth = |(i, &distance): (usize, &f32)| {
        let ray = photograph.camera.ray((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
        distance * ray.cosine
    };
    let depths = photograph.depth.iter().enumerate().filter(|(_, d)| d.is_finite()).map(depth);
    depths.fold(None, |range, d| Some(range.map_or((d, d), |(near, far): (f32, f32)| (near.min(d), far.max(d)))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export;
    use crate::loaders::testing::{load, request};
    use infonerf_scene::{Format, Layout, SceneRequest, TestProtocol};

    #[test]
    fn a_room_reads_back() {
        let guard = tempfile::tempdir().unwrap();
        export("room", 12, Format::Llff, guard.path()).unwrap();
        let chosen = SceneRequest { train: "regnerf-3".parse().unwrap(), test: TestProtocol::Split, ..request() };
        let scene = load(guard.path(), &chosen).unwrap();
        assert_eq!((scene.format, scene.space.layout), (Format::Llff, Layout::Forward));
        assert_eq!((scene.train.len(), scene.test.len()), (3, 5));
        let cameras = procedural::photographs("room", 12, VIEWS);
        // The third of 35 training views: 39 of all.
        let view = &scene.train[2];
        assert_eq!(view.name, "images/image039");
        let shown = procedural::render("room", &cameras[39]).unwrap();
        assert_eq!(
            *view.image,
            infonerf_scene::RgbaImage { has_alpha: false, ..shown.rgba.to_f32() }.composite([0.0; 3])
        );
        // Poses are moved and scaled by the loader: angles stay, distances keep their ratios.
        let [a, b] = [&scene.train[0], &scene.train[1]].map(|view| &view.camera);
        let [p, q] = [&cameras[1], &cameras[20]];
        assert_eq!(scene.train[1].name, "images/image020");
        for (x, y) in [(0.0, 0.0), (12.0, 3.0)] {
            let found = a.ray(x, y).direction.dot(b.ray(y, x).direction);
            assert!((found - p.ray(x, y).direction.dot(q.ray(y, x).direction)).abs() < 1e-5);
        }
        let scale = view.camera.position().distance(a.position()) / cameras[39].position().distance(p.position());
        assert!((b.position().distance(a.position()) / q.position().distance(p.position()) / scale - 1.0).abs() < 1e-4);
        // Bounds are those of what is seen.
        let (near, far) = (scene.space.near / 0.9 / scale, scene.space.far / scale);
        assert!((0.4..3.0).contains(&near) && (3.0..9.0).contains(&far), "{near} {far}");
    }
}
