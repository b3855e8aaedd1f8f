//! Training cameras with their images.

use anyhow::Result;
use base64::prelude::{BASE64_STANDARD, Engine};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use infonerf_scene::{Scene, View, resized_dimensions};
use serde_json::{Value, json};

const JPEG_QUALITY: u8 = 80;
/// Longest side of up to eight images; more of them are smaller, to take as much in total.
const SIDE: f32 = 256.0;
const MIN_SIDE: f32 = 32.0;

/// Returns the training cameras as pinholes with small JPEGs of their images.
pub(crate) fn cameras(scene: &Scene) -> Result<Vec<Value>> {
    let side = (SIDE * (8.0 / scene.train.len().max(8) as f32).sqrt()).max(MIN_SIDE) as u32;
    scene.train.iter().map(|view| camera(view, side)).collect()
}

fn camera(view: &View, side: u32) -> Result<Value> {
    let camera = &view.camera;
    let longest = side.min(view.image.width.max(view.image.height));
    let (width, height) = resized_dimensions(view.image.width, view.image.height, longest);
    let small = view.image.resized(width, height);
    let image = infonerf_metrics::to_rgb8(&small.rgb, width, height)?;
    Ok(json!({
        "name": view.name,
        "width": camera.width,
        "height": camera.height,
        "lens": [camera.fx, camera.fy, camera.cx, camera.cy],
        "pose": camera.to_world.to_cols_array(),
        "image": jpeg_url(&image)?,
    }))
}

/// Encodes an image as JPEG in a `data:` URL.
pub(crate) fn jpeg_url(image: &RgbImage) -> Result<String> {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY).encode_image(image)?;
    Ok(format!("data:image/jpeg;base64,{}", BASE64_STANDARD.encode(jpeg)))
}
