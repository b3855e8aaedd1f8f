//! Package of a scene for a page: one JSON object.

use std::path::Path;

use anyhow::Result;
use base64::prelude::{BASE64_STANDARD, Engine};
use image::RgbImage;
use image::codecs::jpeg::JpegEncoder;
use infonerf_experiment::Trained;
use infonerf_field::RadianceField;
use infonerf_metrics::to_rgb8;
use infonerf_render::{RenderConfig, Renderer, TrainedModel};
use infonerf_scene::{Layout, Range, Scene, View, resized_dimensions};
use serde_json::{Value, json};

use crate::{baked, factored};

/// Longest side in pixels of the image that replaces a field that cannot be drawn; `SMALL_POSTER` is for baked fields.
const POSTER: u32 = 256;
const SMALL_POSTER: u32 = 96;
/// Longest side in pixels of up to eight training images. More images are smaller, down to `MIN_SIDE`, for the same total.
const SIDE: f32 = 256.0;
const MIN_SIDE: f32 = 32.0;
const JPEG_QUALITY: u8 = 80;

/// Field with its scene and renderer, of which a package is made.
pub(crate) struct Subjects<'a> {
    pub(crate) scene: &'a Scene,
    pub(crate) renderer: &'a Renderer,
    pub(crate) config: &'a RenderConfig,
    pub(crate) trained: &'a TrainedModel,
}

/// Makes the JSON object of the run in `folder`: title, notes, shader, arrays, cameras. A field that a page cannot hold
/// is baked to at most `resolution` voxels along the longest side of its box.
pub(crate) fn of_run(run: &Trained, folder: &Path, trained: &TrainedModel, resolution: usize) -> Result<Value> {
    let (scene, plan) = (run.scene(), &run.plan);
    let subjects = Subjects { scene, renderer: run.renderer(), config: &plan.config.render, trained };
    let mut package = of_field(&subjects, resolution)?;
    package["title"] = json!(plan.label());
    package["note"] = json!(note(run, folder, package["voxels"].as_u64()));
    package["cameras"] = json!(cameras(scene)?);
    Ok(package)
}

/// Describes the field's training, and its difference from the whole model and from the field itself.
fn note(run: &Trained, folder: &Path, voxels: Option<u64>) -> String {
    let steps = format!("{} steps", run.trainers[0].progress().step);
    let baked = |voxels: u64| format!("an approximation of the field, baked to {voxels} voxels along its box");
    let parts = [Some(steps), run.plan.export_note(folder, true), voxels.map(baked)];
    parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

/// Makes the JSON object of a field, without title, note and images.
pub(crate) fn of_field(subjects: &Subjects<'_>, resolution: usize) -> Result<Value> {
    let scene = subjects.scene;
    let exact = match &subjects.trained.model.fine {
        RadianceField::Factored(field) => factored::package(field, subjects)?,
        _ => None,
    };
    let mut package = exact.map_or_else(|| baked::package(subjects, resolution), Ok)?;
    let (near, far) = match scene.space.range {
        Range::Distance { near, far } | Range::Depth { near, far } => (near, far),
        Range::Sphere { .. } => (scene.space.near, scene.space.far),
    };
    package["background"] = json!(scene.background);
    package["near"] = json!(near);
    package["far"] = json!(far);
    package["up"] = json!(scene.space.up.to_array());
    package["centre"] = json!(scene.space.centre.to_array());
    package["radius"] = json!(scene.space.radius);
    package["inside"] = json!(scene.space.layout == Layout::Inside);
    package["forward"] = json!(scene.space.layout == Layout::Forward);
    Ok(package)
}

/// Renders an image for browsers that cannot draw the field, as JPEG in a `data:` URL.
pub(crate) fn poster(run: &Trained, trained: &TrainedModel) -> Result<String> {
    let side = if factored::is_exact(&run.plan.config.field) { POSTER } else { SMALL_POSTER };
    let camera = &run.scene().train[0].camera;
    let (width, height) = resized_dimensions(camera.width, camera.height, side.min(camera.width.max(camera.height)));
    let camera = camera.resized(width, height);
    let image = infonerf_render::render_image(run.renderer(), std::slice::from_ref(trained), &camera);
    jpeg_url(&to_rgb8(&image.rgb, width, height)?)
}

/// Returns the training cameras as pinholes with small JPEGs of their images.
fn cameras(scene: &Scene) -> Result<Vec<Value>> {
    let side = (SIDE * (8.0 / scene.train.len().max(8) as f32).sqrt()).max(MIN_SIDE) as u32;
    let of_view = |View { name, camera, image, .. }: &View| {
        let (width, height) = resized_dimensions(image.width, image.height, side.min(image.width.max(image.height)));
        let image = to_rgb8(&image.resized(width, height).rgb, width, height)?;
        Ok(json!({
            "name": name,
            "width": camera.width,
            "height": camera.height,
            "lens": [camera.fx, camera.fy, camera.cx, camera.cy],
            "pose": camera.to_world.to_cols_array(),
            "image": jpeg_url(&image)?,
        }))
    };
    scene.train.iter().map(of_view).collect()
}

fn jpeg_url(image: &RgbImage) -> Result<String> {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY).encode_image(image)?;
    Ok(format!("data:image/jpeg;base64,{}", BASE64_STANDARD.encode(jpeg)))
}
