//! Training cameras with their photographs.

use anyhow::Result;
use base64::prelude::{BASE64_STANDARD, Engine};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use infonerf_scene::{Scene, View, resized_dimensions};
use serde_json::{Value, json};

const JPEG_QUALITY: u8 = 80;
/// Longest side of up to eight photographs; more of them are smaller, to take as much in total.
const SIDE: f32 = 256.0;
const SMALLEST_SIDE: f32 = 32.0;

/// The training cameras as pinholes with small JPEGs of their photographs.
pub(crate) fn cameras(scene: &Scene) -> Result<Vec<Value>> {
    let side = (SIDE * (8.0 / scene.train.len().max(8) as f32).sqrt()).max(SMALLEST_SIDE) as u32;
    scene.train.iter().map(|view| camera(view, side)).collect()
}

fn camera(view: &View, side: u32) -> Result<Value> {
    let camera = &view.camera;
    let longest = side.min(view.image.width.max(view.image.height));
    let (width, height) = resized_dimensions(view.image.width, view.image.height, longest);
    let small = view.image.resized(width, height);
    let photograph = infonerf_metrics::to_rgb8(&small.rgb, width, height)?;
    Ok(json!({
        "name": view.name,
        "width": camera.width,
        "height": camera.height,
        "lens": [camera.fx, camera.fy, camera.cx, camera.cy],
        "pose": camera.to_world.to_cols_array(),
        "photograph": jpeg_url(&photograph)?,
    }))
}

/// A picture as JPEG in a `data:` URL.
pub(crate) fn jpeg_url(picture: &RgbImage) -> Result<String> {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY).encode_image(picture)?;
    Ok(format!("data:image/jpeg;base64,{}", BASE64_STANDARD.encode(jpeg)))
}
