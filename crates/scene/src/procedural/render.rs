//! From a model and a camera to pixels, coverage and depth.

use glam::DVec3;
use rayon::prelude::*;

use super::convex::Line;
use super::model::Model;
use super::shade::{LIGHT_SAMPLES, encode, radiance};
use crate::{Camera, Rgba8};

/// Samples a pixel along each side.
const GRID: usize = 2;

/// Renders straight-alpha RGBA of 8 bits a channel.
///
/// A pixel takes `GRID × GRID` rays on a regular grid. Coverage is the share of rays that hit
/// something, the colour the display-encoded mean light of those that do. Rows are independent, so
/// the result does not depend on the number of threads.
pub(super) fn render(model: &Model, camera: &Camera) -> Rgba8 {
    let pixels = rows(camera, |x, y| pixel(model, camera, x, y));
    Rgba8 { width: camera.width, height: camera.height, pixels }
}

/// Exact distance along the unit ray through each pixel's centre; `f32::INFINITY` where it hits
/// nothing.
pub(super) fn depth(model: &Model, camera: &Camera) -> Vec<f32> {
    rows(camera, |x, y| {
        let line = ray(model, camera, f64::from(x) + 0.5, f64::from(y) + 0.5);
        model.nearest(&line).map_or(f32::INFINITY, |(hit, _)| (hit.t * model.scale()) as f32)
    })
}

fn rows<T: Send>(camera: &Camera, pixel: impl Fn(u32, u32) -> T + Sync) -> Vec<T> {
    let pixel = &pixel;
    (0..camera.height).into_par_iter().flat_map_iter(|y| (0..camera.width).map(move |x| pixel(x, y))).collect()
}

fn ray(model: &Model, camera: &Camera, x: f64, y: f64) -> Line {
    let (origin, direction) = camera.ray_f64(x, y);
    model.line(origin, direction)
}

fn pixel(model: &Model, camera: &Camera, x: u32, y: u32) -> [u8; 4] {
    let mut sum = DVec3::ZERO;
    let mut hits = 0u32;
    for sample in 0..GRID * GRID {
        let offset = |k: usize| (k as f64 + 0.5) / GRID as f64;
        let (dx, dy) = (offset(sample % GRID), offset(sample / GRID));
        let line = ray(model, camera, f64::from(x) + dx, f64::from(y) + dy);
        if let Some(colour) = radiance(model, &line, sample % LIGHT_SAMPLES) {
            sum += colour;
            hits += 1;
        }
    }
    if hits == 0 {
        return [0; 4];
    }
    let [r, g, b] = encode(sum / f64::from(hits)).map(byte);
    [r, g, b, byte(f64::from(hits) / (GRID * GRID) as f64)]
}

fn byte(v: f64) -> u8 {
    (v * 255.0 + 0.5) as u8
}
