//! Package of a scene for a page: one JSON object.

use std::path::Path;

use anyhow::Result;
use infonerf_experiment::Trained;
use infonerf_field::RadianceField;
use infonerf_render::TrainedModel;
use infonerf_scene::{Layout, Range};
use serde_json::{Value, json};

use crate::subjects::Subjects;
use crate::training_images::{cameras, jpeg_url};
use crate::{baked, factored};

/// Longest side of the image that is shown where a field cannot be drawn, and of a slow field's.
const POSTER: u32 = 256;
const SMALL_POSTER: u32 = 96;

/// Makes the JSON object of the run in `folder`: title, notes, shader, arrays, cameras. A field that a page cannot hold
/// is baked to at most `resolution` voxels along the longest side of its box.
///
/// # Errors
/// If an image cannot be encoded.
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
    let mut note = format!("{} steps", run.trainers[0].progress().step);
    if let Some(difference) = run.plan.export_note(folder, true) {
        note += &format!("; {difference}");
    }
    if let Some(voxels) = voxels {
        note += &format!("; not the field itself, but baked to {voxels} voxels along its box");
    }
    note
}

/// Makes the object without title, note and images.
pub(crate) fn of_field(subjects: &Subjects<'_>, resolution: usize) -> Result<Value> {
    let scene = subjects.scene;
    let exact = match &subjects.trained.model.fine {
        RadianceField::Factored(field) => factored::package(field, subjects)?,
        _ => None,
    };
    let mut package = match exact {
        Some(package) => package,
        None => baked::package(subjects, resolution)?,
    };
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
    let side = if factored::holds(&run.plan.config.field) { POSTER } else { SMALL_POSTER };
    let camera = &run.scene().train[0].camera;
    let longest = side.min(camera.width.max(camera.height));
    let (width, height) = infonerf_scene::resized_dimensions(camera.width, camera.height, longest);
    let camera = camera.resized(width, height);
    let image = infonerf_render::render_image(run.renderer(), std::slice::from_ref(trained), &camera);
    jpeg_url(&infonerf_metrics::to_rgb8(&image.rgb, width, height)?)
}
