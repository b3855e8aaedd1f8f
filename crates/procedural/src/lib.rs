//! Built-in scenes, ray-traced on demand with exact depth and coverage.
//!
//! Most are an object in about `[−1.2, 1.2]³` on a transparent background, seen by 100 training and 200 test cameras as
//! in NeRF's synthetic scenes: textured and glossy surfaces with highlights and mirror images that move with the view,
//! thin rods, holes, parts that hide each other, and shadows. Glass and water can be looked through: they hide a share
//! of what is behind them, pass the rest straight on (nothing refracts) and cast no shadow. The scenes of [`CAPTURES`]
//! have surroundings instead of a background. Only the views asked for are rendered. Pixels are *defined* as 8-bit
//! straight RGBA, so that exporting a scene writes exactly what training sees.
//!
//! ```
//! use infonerf_scene::{SceneRequest, TestProtocol, ViewSelection};
//!
//! let train = ViewSelection::Seed { seed: 0, count: 4 };
//! let request = SceneRequest { train, test: TestProtocol::First(1), image_size: Some(16), ..Default::default() };
//! let scene = infonerf_procedural::load("knot", &request)?;
//! assert_eq!(scene.train.iter().map(|v| v.id).collect::<Vec<_>>(), [26, 86, 2, 55]);
//! # Ok::<(), infonerf_scene::SceneError>(())
//! ```

mod bvh;
mod cameras;
mod convex;
mod model;
mod render;
mod scenes;
mod shade;
mod shape;
mod texture;
mod through;

pub use cameras::{field_of_view, photographs, train_cameras};

use glam::Vec3;
use infonerf_scene::select::{pool, published};
use infonerf_scene::{
    Aabb, Backdrop, Body, Camera, PixelCount, Range, Rgba8, RgbaImage, Scene, SceneError, SceneRequest, Space,
    TestProtocol, View,
};
use rayon::prelude::*;

use cameras::SceneCameras;
use model::{Builder, SceneModel};
use scenes::SCENES;

/// Names of the procedural scenes that were built by hand. In addition there is `random-<seed>` for every `u64`.
///
/// Methods are measured on all but [`CAPTURES`] and `figure`, a person seen by a ring of 23 cameras. Their difficulties:
/// something translucent (aquarium), thin rods and wire (birdcage, crane), parts that hide each other (bookshelf, castle),
/// an object small in the image (chessman) or larger than it (facade), polished metal (kettle, orrery), varnish that
/// mirrors (knot), dark matter (piano), white matter before white (porcelain). In alphabetical order the first, third,
/// fifth, … of these are for tuning and the others for judging; the rule was written down before anything was trained on
/// the scenes that are not castle, crane, knot and orrery. `docs/limits.md` lists what was chosen on other scenes.
pub const NAMES: [&str; SCENES.len()] = {
    let mut names = [""; SCENES.len()];
    let mut i = 0;
    while i < SCENES.len() {
        names[i] = SCENES[i].0;
        i += 1;
    }
    names
};
/// Default scenes of an experiment.
pub const CLASSICS: [&str; 4] = ["castle", "crane", "knot", "orrery"];
/// Scenes like photographs: no coverage, no background, a surface in every pixel. `room` is seen from within by
/// hand-held cameras that look one way; on `table` there is a still life before a wall, seen from an arc. [`object_mask`] returns
/// the pixels that show the subject.
pub const CAPTURES: [&str; 2] = ["room", "table"];
/// Image side in pixels of a request without one.
pub const DEFAULT_SIZE: u32 = 200;
/// Min distance of content from a camera, scene units; [`CAPTURES`] have their own.
const NEAR: f32 = 2.0;
/// Max distance of content from a camera, scene units; [`CAPTURES`] have their own.
const FAR: f32 = 6.0;
/// A box that holds every procedural scene but [`CAPTURES`].
const BOUNDS: Aabb = Aabb { min: Vec3::splat(-1.3), max: Vec3::splat(1.3) };

/// Image and depth of a procedural scene from one camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendering {
    /// Colours and coverage, anti-aliased.
    pub rgba: Rgba8,
    /// Exact distance along the unit ray through each pixel's centre, row-major, scene units; `f32::INFINITY` if
    /// nothing is hit. Through translucent matter, the distance at which half of the light from behind is hidden.
    pub depth: Vec<f32>,
}

/// Renders the scene `name` for one camera, which may be anywhere outside the object.
///
/// # Errors
/// There is no scene `name`.
pub fn render(name: &str, camera: &Camera) -> Result<Rendering, SceneError> {
    let model = model(name)?;
    Ok(Rendering { rgba: render::render(&model, camera), depth: render::fronts(&model, camera).0 })
}

/// Returns whether each pixel of `camera` shows the subject at its centre, row-major, and not background or surroundings: in
/// `room` the furniture without walls, floor and wall decoration, on `table` the still life, elsewhere any object. Through
/// translucent matter, the object at [`Rendering::depth`] counts.
///
/// # Errors
/// There is no scene `name`.
pub fn object_mask(name: &str, camera: &Camera) -> Result<Vec<bool>, SceneError> {
    Ok(render::fronts(&model(name)?, camera).1)
}

/// Returns points of the exact surface of the scene `name`, scene units: the ends of the rays through the pixels' centres of
/// all its training cameras, at `size`² pixels ([`Rendering::depth`]).
///
/// Surfaces that no training camera sees (the underside, the inside) have no points.
///
/// # Errors
/// There is no scene `name`.
pub fn surface_points(name: &str, size: u32) -> Result<Vec<Vec3>, SceneError> {
    let model = model(name)?;
    let of_camera = |camera: &Camera| -> Vec<Vec3> {
        let pixels = (0..camera.height).flat_map(|y| (0..camera.width).map(move |x| (x as f32 + 0.5, y as f32 + 0.5)));
        let distances = render::fronts(&model, camera).0;
        let hits = pixels.zip(distances).filter(|(_, distance)| distance.is_finite());
        hits.map(|((x, y), distance)| camera.ray(x, y).at(distance)).collect()
    };
    Ok(cameras::layout(name, size).train.par_iter().flat_map_iter(of_camera).collect())
}

/// Returns whether the scene `name` shows a body.
pub fn has_body(name: &str) -> bool {
    name == "figure"
}

/// Returns the body of the scene `name`, if it has one: points of its exact surface, as many as SMPL has vertices.
///
/// # Errors
/// There is no scene `name`.
pub fn body(name: &str) -> Result<Option<Body>, SceneError> {
    const VERTICES: usize = 6890;
    if !has_body(name) {
        return Ok(None);
    }
    let points = surface_points(name, 64)?;
    let step = points.len() as f64 / VERTICES as f64;
    let chosen = (0..VERTICES).filter_map(|i| points.get((i as f64 * step) as usize).copied());
    Ok(Some(Body::unposed(chosen.collect())))
}

/// Returns the training and the test cameras of the scene `name` for `size`² images.
///
/// The training cameras of castle, crane, knot, orrery and `random-<seed>` are [`train_cameras`], whose seed was
/// chosen. The cameras of all other scenes are drawn by the same law from the FNV-1a hash (64 bits) of the scene's name.
///
/// # Errors
/// There is no scene `name`.
pub fn cameras(name: &str, size: u32) -> Result<(Vec<Camera>, Vec<Camera>), SceneError> {
    check_name(name)?;
    let layout = cameras::layout(name, size);
    Ok((layout.train, layout.test))
}

/// Returns the min and max distance of any surface from any camera of the scene `name`, and a box that contains the scene.
///
/// # Errors
/// There is no scene `name`.
pub fn extent(name: &str) -> Result<(f32, f32, Aabb), SceneError> {
    check_name(name)?;
    let layout = cameras::layout(name, DEFAULT_SIZE);
    Ok((layout.near, layout.far, layout.bounds))
}

/// Returns the arrangement of the cameras of the scene `name`.
pub fn layout(name: &str) -> infonerf_scene::Layout {
    if name == "room" { infonerf_scene::Layout::Forward } else { infonerf_scene::Layout::Object }
}

/// Returns the ids of the training and of the test views that `request` chooses.
fn choose(name: &str, cameras: &SceneCameras, request: &SceneRequest) -> Result<(Vec<usize>, Vec<usize>), SceneError> {
    request.check()?;
    let SceneCameras { train, test, .. } = cameras;
    let ids = |n: usize| (0..n).collect::<Vec<_>>();
    let named =
        if CAPTURES.contains(&name) { published::forward_facing(train.len()) } else { published::synthetic(train) };
    let train = pool::train(&request.train, train, &ids(train.len()), &named)?;
    let test = match request.test {
        TestProtocol::Training => train.clone(),
        _ => pool::test(&request.test, &ids(test.len()), None, &Vec::new())?,
    };
    Ok((train, test))
}

/// Counts the pixels that [`load`] would render.
///
/// # Errors
/// Errors of [`load`].
pub fn count_pixels(name: &str, request: &SceneRequest) -> Result<PixelCount, SceneError> {
    check_name(name)?;
    let size = request.image_size.unwrap_or(DEFAULT_SIZE);
    let (train, test) = choose(name, &cameras::layout(name, size), request)?;
    Ok(PixelCount::new((size, size), train.len(), test.len()))
}

/// Renders the views of the scene `name` that `request` asks for, and no other.
///
/// # Errors
/// There is no scene `name`, or it cannot satisfy the request.
pub fn load(name: &str, request: &SceneRequest) -> Result<Scene, SceneError> {
    let model = model(name)?;
    let cameras = cameras::layout(name, request.image_size.unwrap_or(DEFAULT_SIZE));
    let (train_ids, test_ids) = choose(name, &cameras, request)?;
    let SceneCameras { train, test, near, far, bounds } = cameras;
    let is_capture = CAPTURES.contains(&name);
    let centre = if is_capture { bounds.centre() } else { Vec3::ZERO };
    let pixels = |camera: &Camera| RgbaImage { has_alpha: !is_capture, ..render::render(&model, camera).to_f32() };
    let view = |split: &str, id: usize, camera: &Camera| View {
        depth: Some(render::fronts(&model, camera).0.into()),
        ..View::new(id, format!("{split}/r_{id}"), camera.clone(), pixels(camera).composite(request.background))
    };
    let views = |split: &str, ids: &[usize], cameras: &[Camera]| -> Vec<View> {
        ids.iter().map(|&id| view(split, id, &cameras[id])).collect()
    };
    let learned = views("train", &train_ids, &train);
    let tested = match request.test {
        TestProtocol::Training => learned.clone(),
        _ => views("test", &test_ids, &test),
    };
    Ok(Scene {
        name: name.into(),
        train: learned,
        test: tested,
        background: request.background,
        backdrop: if is_capture { Backdrop::Unknown } else { Backdrop::Colour },
        space: Space {
            near,
            far,
            range: Range::Distance { near, far },
            bounds,
            layout: layout(name),
            body: body(name)?,
            ..Space::default()
        }
        .centred(centre, &train),
        all_train_cameras: train,
        ..Scene::default()
    }
    .with_guessed_background())
}

/// Returns an error unless there is a scene `name`: one of [`NAMES`], or `random-<seed>`.
pub fn check_name(name: &str) -> Result<(), SceneError> {
    if NAMES.contains(&name) || random_seed(name).is_some() {
        return Ok(());
    }
    let known = format!("{}, random-<seed>", NAMES.join(", "));
    Err(SceneError::UnknownScene { name: name.into(), known })
}

/// Parses the seed in `random-<seed>`, written without sign or leading zeros.
fn random_seed(name: &str) -> Option<u64> {
    let text = name.strip_prefix("random-")?;
    text.parse().ok().filter(|seed: &u64| seed.to_string() == text)
}

fn model(name: &str) -> Result<SceneModel, SceneError> {
    check_name(name)?;
    let mut scene = Builder::default();
    if let Some((_, add, scale, rise)) = SCENES.into_iter().find(|(known, ..)| *known == name) {
        add(&mut scene);
        return Ok(scene.build(scale, rise));
    }
    if let Some(seed) = random_seed(name) {
        scenes::random(&mut scene, seed);
    }
    Ok(scene.build(1.0, 0.05))
}

#[cfg(test)]
mod tests;
