//! Scenes: what a loader gives and what it is asked for.

use std::path::PathBuf;

use crate::{Aabb, Camera, Image, SceneError, ViewSelection, loaders, procedural, resized_dimensions, select};

/// The longest image side that can be asked for, in pixels.
const LARGEST_SIZE: u32 = 16_384;

/// One photograph with its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Index in its pool: the frames of the file for split data sets, all training (or all held-out)
    /// views in order for captures split here.
    pub id: usize,
    /// The image's path within the scene, without extension, such as `train/r_26`.
    pub name: String,
    /// Intrinsics for `image` and the pose.
    pub camera: Camera,
    /// The photograph, composited on the scene's background.
    pub image: Image,
    /// Exact distance along the unit ray through each pixel's centre, row-major, scene units;
    /// `f32::INFINITY` where nothing is hit. `None` where the scene does not know it, or where the
    /// image was resized: distances cannot be averaged.
    pub depth: Option<Vec<f32>>,
}

impl View {
    /// The view with pixels `factor` times as wide, each the mean over the area that it covers, and without depth:
    /// distances cannot be averaged.
    pub fn reduced(&self, factor: u32) -> Self {
        let (width, height) = (self.image.width, self.image.height);
        let longest = (width.max(height) / factor.max(1)).max(1);
        let (width, height) = resized_dimensions(width, height, longest);
        Self {
            id: self.id,
            name: self.name.clone(),
            camera: self.camera.resized(width, height),
            image: self.image.resized(width, height),
            depth: None,
        }
    }
}

/// Training and test views with what is known of the space between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// The folder's or the procedural scene's name.
    pub name: String,
    /// The chosen training views, in the order of the selection. All have one size.
    pub train: Vec<View>,
    /// The chosen test views, of the same size.
    pub test: Vec<View>,
    /// What transparent pixels were composited on, display-encoded RGB in `[0, 1]`.
    pub background: [f32; 3],
    /// Distance along a ray before which there is nothing, scene units, ≥ 0.
    pub near: f32,
    /// Distance along a ray beyond which there is nothing, scene units, > `near`.
    pub far: f32,
    /// A box that holds what is to be reconstructed.
    pub bounds: Aabb,
    /// The cameras of every training view there is, chosen or not, at the scene's image size. Only
    /// their poses: no image of an unchosen view is read.
    pub all_train_cameras: Vec<Camera>,
}

/// Where a scene comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneSource {
    /// A built-in scene, one of [`procedural::NAMES`] or `random-<seed>`.
    Procedural(String),
    /// A folder in one of the known formats, told apart by its files, in this order:
    /// `transforms_train.json` (Blender), `transforms.json` (nerfstudio), `poses_bounds.npy` (LLFF).
    Folder {
        /// The folder that holds that file.
        path: PathBuf,
    },
}

/// What to load of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneRequest {
    /// Which training views.
    pub train: ViewSelection,
    /// Which test views.
    pub test: TestProtocol,
    /// The longest side of the images in pixels, reached with a box filter; `None` for the size they
    /// have (for procedural scenes, [`procedural::DEFAULT_SIZE`]).
    pub image_size: Option<u32>,
    /// Colour behind transparent pixels, display-encoded RGB in `[0, 1]`.
    pub background: [f32; 3],
}

impl Default for SceneRequest {
    /// Four views of seed 0, every 8th test view, native size, white.
    fn default() -> Self {
        Self {
            train: ViewSelection::Seed { seed: 0, count: 4 },
            test: TestProtocol::Every(8),
            image_size: None,
            background: [1.0; 3],
        }
    }
}

/// Which of a scene's test views to evaluate on.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TestProtocol {
    /// All of them.
    All,
    /// Every n-th, starting with the first: `Every(8)` takes 25 of Blender's 200.
    Every(usize),
    /// The first n, or all where there are fewer.
    First(usize),
    /// These, in this order.
    Ids(Vec<usize>),
}

impl TestProtocol {
    /// The indices of the chosen views among `n`.
    ///
    /// # Errors
    /// There are no test views; `Every(0)` or `First(0)`; an id is out of range or given twice.
    pub fn select(&self, n: usize) -> Result<Vec<usize>, SceneError> {
        let error = |expected: &str, found: &str| SceneError::request("test", expected, found);
        match self {
            _ if n == 0 => Err(error("a scene with at least one test view", "none")),
            Self::Every(0) => Err(error("a positive step", "0")),
            Self::First(0) => Err(error("a positive number of views", "0")),
            Self::All => Ok((0..n).collect()),
            Self::Every(step) => Ok((0..n).step_by(*step).collect()),
            Self::First(count) => Ok((0..n.min(*count)).collect()),
            Self::Ids(ids) => select::check_ids("test", ids, n).map(|()| ids.clone()),
        }
    }
}

/// Loads the views that `request` asks for, and no other image, from `source`.
///
/// Images are decoded or rendered in parallel; the result does not depend on the number of threads.
///
/// # Errors
/// Every fault of the data or of the request, as a [`SceneError`] of one line: a missing folder,
/// file or field, a broken image, a pose that is not a rigid transform, images of different sizes,
/// no views, ids out of range or given twice.
pub fn load(source: &SceneSource, request: &SceneRequest) -> Result<Scene, SceneError> {
    check(request)?;
    match source {
        SceneSource::Procedural(name) => procedural::load(name, request),
        SceneSource::Folder { path } => loaders::load(path, request),
    }
}

fn check(request: &SceneRequest) -> Result<(), SceneError> {
    if let Some(size) = request.image_size
        && (size == 0 || size > LARGEST_SIZE)
    {
        let expected = format!("a size from 1 to {LARGEST_SIZE} pixels");
        return Err(SceneError::request("image_size", expected, size));
    }
    if !request.background.iter().all(|v| (0.0..=1.0).contains(v)) {
        let found = format!("{:?}", request.background);
        return Err(SceneError::request("background", "three numbers from 0 to 1", found));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn test_protocols() {
        assert_eq!(TestProtocol::All.select(3).unwrap(), [0, 1, 2]);
        assert_eq!(TestProtocol::Every(8).select(200).unwrap().len(), 25);
        assert_eq!(TestProtocol::Every(8).select(20).unwrap(), [0, 8, 16]);
        assert_eq!(TestProtocol::First(2).select(3).unwrap(), [0, 1]);
        assert_eq!(TestProtocol::First(9).select(3).unwrap().len(), 3);
        assert_eq!(TestProtocol::Ids(vec![2, 0]).select(3).unwrap(), [2, 0]);
        for bad in [
            TestProtocol::Every(0),
            TestProtocol::First(0),
            TestProtocol::Ids(vec![3]),
            TestProtocol::Ids(vec![1, 1]),
            TestProtocol::Ids(vec![]),
        ] {
            assert!(bad.select(3).unwrap_err().to_string().contains("`test`"));
        }
        assert!(TestProtocol::All.select(0).is_err());
    }

    #[test]
    fn a_reduced_view_sees_the_same() {
        let pose = glam::DMat4::IDENTITY;
        let mut image = Image::filled(4, 2, [0.25; 3]);
        image.rgb[0] = [1.0, 0.25, 0.25];
        let view = View {
            id: 0,
            name: "a".into(),
            camera: Camera::from_fov(4, 2, 1.0, pose),
            image,
            depth: Some(vec![1.0; 8]),
        };
        let half = view.reduced(2);
        assert_eq!(half.image.rgb, [[0.4375, 0.25, 0.25], [0.25; 3]]);
        assert_eq!((half.camera, half.depth), (Camera::from_fov(2, 1, 1.0, pose), None));
        assert_eq!(view.reduced(100).image.rgb.len(), 1, "never less than a pixel");
    }

    #[test]
    fn bad_requests() {
        let source = SceneSource::Procedural("knot".into());
        for size in [0, 1 << 20] {
            let request = SceneRequest { image_size: Some(size), ..Default::default() };
            assert!(load(&source, &request).unwrap_err().to_string().contains("image_size"));
        }
        for bad in [f32::NAN, -0.1, 1.1] {
            let request = SceneRequest { background: [0.5, bad, 0.5], ..Default::default() };
            assert!(load(&source, &request).unwrap_err().to_string().contains("background"));
        }
    }
}
