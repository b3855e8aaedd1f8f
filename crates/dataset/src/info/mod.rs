//! A summary of a scene, to be read before training on it.

mod check;
mod page;

pub use check::check_folder;
pub use page::info_page;

use std::fmt;
use std::path::Path;

use glam::Vec3;
use infonerf_scene::image::{dimensions, has_transparency};
use infonerf_scene::{Backdrop, Camera, Format, Image, Layout, Range, Scene, SceneError, SceneRequest, Space};
use serde::Serialize;

use crate::capture::{Capture, scene_name};
use crate::frame::{Frame, MaskRole};
use crate::loaders;

/// Focal lengths and principal points that differ by at most this, in pixels, belong to the same camera.
const SAME_PIXELS: f64 = 0.1;
/// Size at which fields of view are compared if no image is there.
const UNKNOWN_SIZE: (u32, u32) = (1000, 1000);

/// The summary of a scene's folder.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Info {
    /// The folder's name.
    pub name: String,
    /// Format of the folder.
    pub format: Format,
    /// Number of views in the training pool.
    pub train_views: usize,
    /// Number of views in the test pool; in some formats a view is in both pools.
    pub test_views: usize,
    /// Number of different sets of intrinsics.
    pub cameras: usize,
    /// The lens of the first camera, as text.
    pub lens: String,
    /// Horizontal field of view of the first camera, degrees, its lens included.
    pub field_of_view_deg: f32,
    /// Width and height of the first image, if it is there.
    pub image_size: Option<[u32; 2]>,
    /// Background of the content in the first image, if that is there.
    pub backdrop: Option<Backdrop>,
    /// Extent of the content, and arrangement of the cameras.
    #[serde(flatten)]
    pub space: Space,
    /// Number of known surface points.
    pub points: usize,
    /// Names for training views and how many views each chooses.
    pub selections: Vec<(String, usize)>,
    /// Names for test views and how many views each chooses; `split` is the format's own.
    pub protocols: Vec<(String, usize)>,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
}

/// Summarises the scene in the folder `path`. At most one image is read, and images may be missing.
///
/// # Errors
/// Errors of [`crate::load`] about poses.
pub fn info(path: &Path) -> Result<Info, SceneError> {
    let Capture { found, mut space, .. } = loaders::read(path, &SceneRequest::default())?.prepared()?;
    let frames = || found.train.iter().chain(&found.test);
    let first = frames().find(|frame| frame.image.is_file());
    let size = first.map(|frame| dimensions(&frame.image)).transpose()?;
    let backdrop = first.map(shown_backdrop).transpose()?;
    let camera = frames().next().map(|f| size.map_or_else(|| f.nominal_camera(), |(w, h)| f.camera(w, h)));
    let mut kinds: Vec<Camera> = Vec::new();
    for frame in frames() {
        let (width, height) = frame.stated_size().or(size).unwrap_or(UNKNOWN_SIZE);
        let camera = frame.camera(width, height);
        if !kinds.iter().any(|kind| is_alike(kind, &camera)) {
            kinds.push(camera);
        }
    }
    let counts = |named: &[(String, Vec<usize>)]| named.iter().map(|(name, ids)| (name.clone(), ids.len())).collect();
    let mut protocols: Vec<(String, usize)> = counts(&found.protocols);
    protocols.insert(0, ("split".into(), found.split.as_ref().map_or(found.test.len(), Vec::len)));
    space.bounded |= backdrop == Some(Backdrop::Colour) && space.layout == Layout::Object;
    Ok(Info {
        name: scene_name(path),
        format: found.format,
        train_views: found.train.len(),
        test_views: found.test.len(),
        cameras: kinds.len(),
        lens: camera.as_ref().map_or_else(String::new, |c| c.lens.to_string()),
        field_of_view_deg: camera.as_ref().map_or(0.0, field_of_view),
        image_size: size.map(|(width, height)| [width, height]),
        backdrop,
        points: space.points.len(),
        space,
        selections: counts(&found.selections),
        protocols,
        warnings: found.warnings,
    })
}

/// Tells from its matte, transparent pixels or white border whether an image shows its content on a known background.
fn shown_backdrop(frame: &Frame) -> Result<Backdrop, SceneError> {
    let white = SceneRequest::default().background;
    let is_matted = matches!(frame.mask, Some((_, MaskRole::Matte)));
    let shown = is_matted || has_transparency(&frame.image)? || Image::read(&frame.image, white)?.has_border(white);
    Ok(if shown { Backdrop::Colour } else { Backdrop::Unknown })
}

/// Returns the scene in the folder `path` without any view: its space and all training cameras, for [`info_page`].
///
/// # Errors
/// Errors of [`crate::load`] about poses.
pub fn outline(path: &Path) -> Result<Scene, SceneError> {
    let Capture { found, space, origin } = loaders::read(path, &SceneRequest::default())?.prepared()?;
    let all_train_cameras = found.train.iter().map(Frame::nominal_camera).collect();
    let (name, format, warnings) = (scene_name(path), found.format, found.warnings);
    Ok(Scene { name, format, space, origin, all_train_cameras, warnings, ..Scene::default() })
}

/// Whether two cameras have one lens, up to rounding in files and in the decomposition of projections.
fn is_alike(a: &Camera, b: &Camera) -> bool {
    let intrinsics = |c: &Camera| [f64::from(c.width), f64::from(c.height), c.fx, c.fy, c.cx, c.cy];
    a.lens == b.lens && intrinsics(a).iter().zip(intrinsics(b)).all(|(a, b)| (a - b).abs() <= SAME_PIXELS)
}

/// Returns the angle between the rays at the middle of the left and the right border, degrees.
fn field_of_view(camera: &Camera) -> f32 {
    let (w, h) = (f64::from(camera.width), f64::from(camera.height));
    let middle = camera.forward_f64();
    let angle = |x: f64| camera.ray_f64(x, 0.5 * h).1.angle_between(middle);
    (angle(0.0) + angle(w)).to_degrees() as f32
}

impl fmt::Display for Info {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |named: &[(String, usize)]| {
            let each: Vec<String> = named.iter().map(|(name, count)| format!("{name} ({count})")).collect();
            if each.is_empty() { "none".to_owned() } else { each.join(", ") }
        };
        let space = &self.space;
        let vector = |v: Vec3| format!("({:.3}, {:.3}, {:.3})", v.x, v.y, v.z);
        writeln!(f, "{}: {}, cameras {}", self.name, self.format, space.layout)?;
        writeln!(f, "views       {} to train on, {} to test on", self.train_views, self.test_views)?;
        let size = self.image_size.map_or_else(|| "no image is there".into(), |[w, h]| format!("{w} × {h} pixels"));
        writeln!(f, "images      {size}")?;
        writeln!(f, "cameras     {} different, {:.1}° wide, {}", self.cameras, self.field_of_view_deg, self.lens)?;
        let range = match space.range {
            Range::Distance { .. } => "distances along the ray".to_owned(),
            Range::Depth { near, far } => format!("depths {near:.3} to {far:.3} along the viewing axis"),
            Range::Sphere { centre, radius } => format!("a sphere of {radius:.3} about {}", vector(centre)),
        };
        writeln!(f, "near, far   {:.3} to {:.3}: {range}", space.near, space.far)?;
        let bounded = if space.bounded { "nothing beyond" } else { "with more beyond" };
        writeln!(f, "box         {} to {}, {bounded}", vector(space.bounds.min), vector(space.bounds.max))?;
        writeln!(f, "centre      {}, cameras within {:.3}", vector(space.centre), space.radius)?;
        writeln!(f, "up          {}", vector(space.up))?;
        writeln!(f, "points      {}", self.points)?;
        let backdrop = self.backdrop.map_or_else(|| "no image to tell".into(), |b| b.to_string());
        writeln!(f, "background  {backdrop}")?;
        writeln!(f, "selections  {}", list(&self.selections))?;
        write!(f, "tests       {}", list(&self.protocols))?;
        self.warnings.iter().try_for_each(|warning| write!(f, "\nwarning     {warning}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::loaders::testing::{blender, moved, photographs};

    #[test]
    fn a_folder_is_described() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path().join("toy");
        blender(&dir, 5, 2);
        let found = info(&dir).unwrap();
        assert_eq!((found.name.as_str(), found.format), ("toy", Format::Blender));
        assert_eq!((found.train_views, found.test_views, found.cameras), (5, 2, 1));
        assert_eq!((found.image_size, found.backdrop), (Some([8, 8]), Some(Backdrop::Colour)));
        assert!((found.field_of_view_deg - 39.597).abs() < 0.01 && found.space.bounded);
        assert_eq!(found.protocols, [("split".to_owned(), 2)]);
        let text = found.to_string();
        assert!(text.contains("toy: Blender, cameras around an object") && text.contains("5 to train on"), "{text}");
        let json = serde_json::to_value(&found).unwrap();
        assert_eq!(json["format"], "blender");
        assert_eq!((&json["layout"], &json["near"]), (&"object".into(), &2.0.into()), "{json}");
        let camera = &infonerf_procedural::train_cameras(16)[0];
        let beside = |i: u32| moved(camera, |p| p + 0.1 * f64::from(i) * camera.to_world.x_axis.truncate());
        let captured = photographs(&[0, 1, 2, 3].map(beside));
        let space = info(captured.path()).unwrap().space;
        assert!(space.layout == Layout::Forward && !space.bounded, "more is seen than an object");
        // Images need not be there.
        std::fs::remove_dir_all(dir.join("train")).unwrap();
        std::fs::remove_dir_all(dir.join("test")).unwrap();
        assert_eq!(info(&dir).unwrap().image_size, None);
        assert_eq!(outline(&dir).unwrap().all_train_cameras.len(), 5);
        assert!(info(&guard.path().join("none")).is_err());
    }
}
