//! Scenes of our own, ray-traced on demand with exact depth and coverage.
//!
//! Each is an object in about `[−1.2, 1.2]³` on a transparent background, seen by 100 training and
//! 200 test cameras as in NeRF's synthetic scenes: textured and glossy surfaces with highlights and
//! mirror images that move with the view, thin rods, holes, parts that hide each other, and shadows.
//! Only the views asked for are rendered. Pixels are *defined* as 8-bit straight RGBA, so that
//! [`crate::export`] writes exactly what training sees.

mod bvh;
mod cameras;
mod convex;
mod model;
mod render;
mod scenes;
mod shade;
mod shape;
mod texture;

pub use cameras::{TEST_VIEWS, TRAIN_VIEWS, test_cameras, train_cameras};

pub(crate) use cameras::FOV_X;

use glam::Vec3;

use crate::select::pool;
use crate::{Aabb, Camera, Range, Rgba8, Scene, SceneError, SceneRequest, View, loaders};
use model::Model;

/// The names of the procedural scenes that were built by hand. Beside them there is `random-<seed>` for every `u64`.
pub const NAMES: [&str; 4] = ["castle", "crane", "knot", "orrery"];
/// Image side in pixels where none is asked for.
pub const DEFAULT_SIZE: u32 = 200;
/// Nothing lies nearer to a camera than this, scene units.
pub const NEAR: f32 = 2.0;
/// Nothing lies farther from a camera than this, scene units.
pub const FAR: f32 = 6.0;
/// A box that holds every procedural scene.
pub const BOUNDS: Aabb = Aabb { min: Vec3::splat(-1.3), max: Vec3::splat(1.3) };

/// What a procedural scene shows to one camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendering {
    /// Colours and coverage, anti-aliased.
    pub rgba: Rgba8,
    /// Exact distance along the unit ray through each pixel's centre, row-major, scene units;
    /// `f32::INFINITY` where nothing is hit.
    pub depth: Vec<f32>,
}

/// Renders the scene `name` for one camera, which may be anywhere outside the object.
///
/// # Errors
/// There is no scene `name`.
pub fn render(name: &str, camera: &Camera) -> Result<Rendering, SceneError> {
    let model = model(name)?;
    Ok(Rendering { rgba: render::render(&model, camera), depth: render::depth(&model, camera) })
}

/// Renders the views of the scene `name` that `request` asks for.
pub(crate) fn load(name: &str, request: &SceneRequest) -> Result<Scene, SceneError> {
    let model = model(name)?;
    let size = request.image_size.unwrap_or(DEFAULT_SIZE);
    let (train, test) = (train_cameras(size), test_cameras(size));
    let ids = |n: usize| (0..n).collect::<Vec<_>>();
    let named = loaders::named_selections(&train);
    let train_ids = pool::train(&request.train, &train, &ids(train.len()), &named)?;
    let test_ids = pool::test(&request.test, &ids(test.len()), None, &Vec::new())?;
    let view = |split: &str, id: usize, camera: &Camera| View {
        id,
        name: format!("{split}/r_{id}"),
        image: render::render(&model, camera).to_f32().composite(request.background).into(),
        depth: Some(render::depth(&model, camera).into()),
        mask: None,
        camera: camera.clone(),
    };
    let views = |split: &str, ids: &[usize], cameras: &[Camera]| -> Vec<View> {
        ids.iter().filter_map(|&id| cameras.get(id).map(|c| view(split, id, c))).collect()
    };
    Ok(Scene {
        name: name.into(),
        train: views("train", &train_ids, &train),
        test: views("test", &test_ids, &test),
        background: request.background,
        near: NEAR,
        far: FAR,
        range: Range::Distance { near: NEAR, far: FAR },
        bounds: BOUNDS,
        radius: cameras::RADIUS as f32,
        all_train_cameras: train,
        ..Scene::default()
    })
}

/// Fails unless there is a scene `name`: one of [`NAMES`], or `random-<seed>`.
///
/// # Errors
/// There is none.
pub fn check_name(name: &str) -> Result<(), SceneError> {
    model(name).map(drop)
}

/// The seed in `random-<seed>`, written in the one way that `u64` is printed.
fn random_seed(name: &str) -> Option<u64> {
    let text = name.strip_prefix("random-")?;
    text.parse().ok().filter(|seed: &u64| seed.to_string() == text)
}

fn model(name: &str) -> Result<Model, SceneError> {
    // Scale and rise: chosen so that no camera's image is cropped, which a test holds them to.
    match name {
        "castle" => Ok(scenes::castle().build(0.87, 0.18)),
        "crane" => Ok(scenes::crane().build(0.81, 0.15)),
        "knot" => Ok(scenes::knot().build(0.90, 0.17)),
        "orrery" => Ok(scenes::orrery().build(0.94, 0.08)),
        _ => match random_seed(name) {
            Some(seed) => Ok(scenes::random(seed).build(1.0, 0.05)),
            None => {
                let known = format!("{}, random-<seed>", NAMES.join(", "));
                Err(SceneError::UnknownScene { name: name.into(), known })
            }
        },
    }
}

#[cfg(test)]
mod tests;
