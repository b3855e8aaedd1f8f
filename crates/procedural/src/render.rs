//! Rendering of a model for a camera: pixels, coverage and depth.

use glam::DVec3;
use infonerf_scene::{Camera, Rgba8};
use rayon::prelude::*;

use super::convex::HalfLine;
use super::model::SceneModel;
use super::shade::encode;
use super::through::{half_hidden_distance, light};

/// Number of samples per pixel along each side.
const GRID: usize = 2;

/// Renders straight-alpha RGBA with 8 bits per channel.
///
/// A pixel takes `GRID × GRID` rays on a regular grid. Coverage is the rays' mean opacity (1 for any opaque surface);
/// the colour is the display-encoded mean radiance divided by coverage. Rows are independent, so the result does not
/// depend on the number of threads.
pub(super) fn render(model: &SceneModel, camera: &Camera) -> Rgba8 {
    Rgba8 { width: camera.width, height: camera.height, pixels: rows(camera, |x, y| pixel(model, camera, x, y)) }
}

/// Returns for each pixel the exact distance along the unit ray through its centre at which the accumulated opacity
/// reaches one half, and whether the surface there belongs to the subject and not to its surroundings: the first surface,
/// unless it is transparent. The distance is `f32::INFINITY` where the opacity stays below.
pub(super) fn fronts(model: &SceneModel, camera: &Camera) -> (Vec<f32>, Vec<bool>) {
    let front = |x, y| {
        let found = half_hidden_distance(model, &ray(model, camera, f64::from(x) + 0.5, f64::from(y) + 0.5));
        found.map_or((f32::INFINITY, false), |(t, subject)| ((t * model.scale) as f32, subject))
    };
    rows(camera, front).into_iter().unzip()
}

fn rows<T: Send>(camera: &Camera, pixel: impl Fn(u32, u32) -> T + Sync) -> Vec<T> {
    let pixel = &pixel;
    (0..camera.height).into_par_iter().flat_map_iter(|y| (0..camera.width).map(move |x| pixel(x, y))).collect()
}

fn ray(model: &SceneModel, camera: &Camera, x: f64, y: f64) -> HalfLine {
    let (origin, direction) = camera.ray_f64(x, y);
    model.line(origin, direction)
}

fn pixel(model: &SceneModel, camera: &Camera, x: u32, y: u32) -> [u8; 4] {
    let mut sum = DVec3::ZERO;
    let mut cover = 0.0;
    for sample in 0..GRID * GRID {
        let offset = |k: usize| (k as f64 + 0.5) / GRID as f64;
        let (dx, dy) = (offset(sample % GRID), offset(sample / GRID));
        let line = ray(model, camera, f64::from(x) + dx, f64::from(y) + dy);
        let (colour, hidden) = light(model, &line, sample);
        sum += colour;
        cover += hidden;
    }
    if cover <= 0.0 {
        return [0; 4];
    }
    let [r, g, b] = encode(sum / cover).map(byte);
    [r, g, b, byte(cover / (GRID * GRID) as f64)]
}

fn byte(v: f64) -> u8 {
    (v * 255.0 + 0.5) as u8
}
