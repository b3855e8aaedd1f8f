//! What a page needs to draw a scene, as one JSON object.

use anyhow::Result;
use infonerf_experiment::Trained;
use infonerf_field::RadianceField;
use infonerf_render::TrainedModel;
use infonerf_scene::{Layout, Range};
use serde_json::{Value, json};

use crate::photographs::{cameras, jpeg_url};
use crate::subjects::Subjects;
use crate::{baked, factored};

/// Longest side of the picture that is shown where a field cannot be drawn, and of a slow field's.
const POSTER: u32 = 256;
const SMALL_POSTER: u32 = 96;

/// The JSON object of a run: title, notes, shader, arrays, cameras. A field that a page
/// cannot hold is baked to at most `resolution` voxels along the longest side of its box.
///
/// # Errors
/// If a photograph cannot be encoded.
pub(crate) fn of_run(run: &Trained, trained: &TrainedModel, resolution: usize) -> Result<Value> {
    let (scene, plan) = (run.scene(), &run.plan);
    let subjects = Subjects { scene, renderer: run.renderer(), config: &plan.config.render, trained };
    let mut package = of_field(&subjects, resolution)?;
    package["title"] = json!(plan.label());
    package["note"] = json!(note(run, package["voxels"].as_u64()));
    package["cameras"] = json!(cameras(scene)?);
    Ok(package)
}

/// How far the field is trained, which of several it is, and whether it is shown as it is.
fn note(run: &Trained, voxels: Option<u64>) -> String {
    let mut note = format!("{} steps", run.trainers[0].progress().step);
    let fields = run.plan.members();
    if fields > 1 {
        note += &format!("; the first of {fields} fields, whose mean the run's pictures are");
    }
    if let Some(voxels) = voxels {
        note += &format!("; not the field itself, but baked to {voxels} voxels along its box");
    }
    note
}

/// The object without title, note and photographs.
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
    Ok(package)
}

/// A render as JPEG in a `data:` URL, for browsers that cannot draw the field.
pub(crate) fn poster(run: &Trained, trained: &TrainedModel) -> Result<String> {
    let side = if factored::holds(&run.plan.config.field) { POSTER } else { SMALL_POSTER };
    let camera = &run.scene().train[0].camera;
    let longest = side.min(camera.width.max(camera.height));
    let (width, height) = infonerf_scene::resized_dimensions(camera.width, camera.height, longest);
    let camera = camera.resized(width, height);
    let image = infonerf_render::render_image(run.renderer(), std::slice::from_ref(trained), &camera);
    jpeg_url(&infonerf_metrics::to_rgb8(&image.rgb, width, height)?)
}
