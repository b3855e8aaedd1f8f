//! Scenes: what a loader gives and what it is asked for.

use std::path::PathBuf;
use std::sync::Arc;

use crate::{
    Backdrop, Camera, Format, Image, Ray, SceneError, Space, TestProtocol, ViewSelection, loaders, procedural,
    resized_dimensions,
};

/// The longest image side that can be asked for, in pixels.
const LARGEST_SIZE: u32 = 16_384;

/// One photograph with its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Index in its pool: the frames of the file for split data sets, all training (or all held-out)
    /// views in order for captures split here. DTU and ZJU-MoCap number their views themselves.
    pub id: usize,
    /// The image's path within the scene, without extension, such as `train/r_26`.
    pub name: String,
    /// Intrinsics for `image` and the pose.
    pub camera: Camera,
    /// The photograph, composited on the scene's background.
    pub image: Arc<Image>,
    /// Exact distance along the unit ray through each pixel's centre, row-major, scene units;
    /// `f32::INFINITY` where nothing is hit. `None` where the scene does not know it, or where the
    /// image was resized: distances cannot be averaged.
    pub depth: Option<Arc<[f32]>>,
    /// Which pixels count in evaluation, row-major: the object's in DTU, the person's in ZJU-MoCap, those that a
    /// `mask_path` leaves in. `None` where all do.
    pub mask: Option<Arc<[bool]>>,
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
            image: Arc::new(self.image.resized(width, height)),
            depth: None,
            mask: self.mask.as_ref().map(|mask| {
                crate::image::resized_mask(mask, (self.image.width, self.image.height), (width, height)).into()
            }),
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
    /// Where it came from.
    pub format: Format,
    /// The colour of a ray that meets nothing, display-encoded RGB in `[0, 1]`: what transparent pixels were composited on,
    /// or, of photographs without a known backdrop, the mean colour of the training views.
    pub background: [f32; 3],
    /// Whether `background` is what lies behind the content.
    pub backdrop: Backdrop,
    /// Where the content lies, and how the cameras stand to it.
    pub space: Space,
    /// The cameras of every training view there is, chosen or not, at the scene's image size. Only
    /// their poses: no image of an unchosen view is read.
    pub all_train_cameras: Vec<Camera>,
    /// What a person should know of the data, one line each.
    pub warnings: Vec<String>,
}

impl Default for Scene {
    /// No views, and the space of NeRF's synthetic scenes.
    fn default() -> Self {
        Self {
            name: String::new(),
            train: Vec::new(),
            test: Vec::new(),
            format: Format::default(),
            background: [1.0; 3],
            backdrop: Backdrop::default(),
            space: Space::default(),
            all_train_cameras: Vec::new(),
            warnings: Vec::new(),
        }
    }
}

impl Scene {
    /// The distances `(near, far)` between which content lies along `ray`, `0 ≤ near < far`; `None` where none does.
    pub fn interval(&self, ray: &Ray) -> Option<(f32, f32)> {
        self.space.range.along(ray)
    }
}

/// Where a scene comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneSource {
    /// A built-in scene, one of [`procedural::NAMES`] or `random-<seed>`.
    Procedural(String),
    /// A folder in one of the known formats, told apart by its files, in this order:
    /// `transforms_train.json` (Blender), `transforms.json` (nerfstudio, instant-ngp), `poses_bounds.npy` (LLFF),
    /// `cameras_sphere.npz` or `cameras.npz` (DTU), `annots.npy` (ZJU-MoCap), a reconstruction of COLMAP.
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
    /// The longest side of the images in pixels, reached with a box filter, which enlarges none; `None` for the size they
    /// have (for procedural scenes, [`procedural::DEFAULT_SIZE`]).
    pub image_size: Option<u32>,
    /// Colour behind transparent pixels, display-encoded RGB in `[0, 1]`.
    pub background: [f32; 3],
    /// Which frame of a film (ZJU-MoCap); `None` for the first.
    pub frame: Option<usize>,
}

impl Default for SceneRequest {
    /// Four views of seed 0, every 8th test view, native size, white.
    fn default() -> Self {
        Self {
            train: ViewSelection::Seed { seed: 0, count: 4 },
            test: TestProtocol::Every(8),
            image_size: None,
            background: [1.0; 3],
            frame: None,
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
    let mut scene = match source {
        SceneSource::Procedural(name) => procedural::load(name, request)?,
        SceneSource::Folder { path } => loaders::load(path, request)?,
    };
    if scene.backdrop == Backdrop::Unknown {
        scene.background = mean_color(&scene.train);
    }
    Ok(scene)
}

/// The mean colour of all pixels of `views`, which is nearest to them all in squared error; white where there are none.
fn mean_color(views: &[View]) -> [f32; 3] {
    let mut sum = [0.0f64; 3];
    let mut count = 0usize;
    for pixel in views.iter().flat_map(|view| &view.image.rgb) {
        count += 1;
        sum.iter_mut().zip(pixel).for_each(|(sum, value)| *sum += f64::from(*value));
    }
    if count == 0 { [1.0; 3] } else { sum.map(|sum| (sum / count as f64) as f32) }
}

/// How many pixels the chosen views of a scene have, which decides how much memory it takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelCount {
    /// Of all training views together.
    pub train: u64,
    /// Of all test views together.
    pub test: u64,
}

impl PixelCount {
    pub(crate) fn new((width, height): (u32, u32), train: usize, test: usize) -> Self {
        let each = u64::from(width) * u64::from(height);
        Self { train: each.saturating_mul(train as u64), test: each.saturating_mul(test as u64) }
    }
}

impl Scene {
    /// How many pixels its views have.
    pub fn pixels(&self) -> PixelCount {
        let of = |views: &[View]| views.iter().map(|view| view.image.rgb.len() as u64).sum();
        PixelCount { train: of(&self.train), test: of(&self.test) }
    }
}

/// How many pixels [`load`] would hold, from the headers of image files: nothing is decoded or rendered.
///
/// # Errors
/// As [`load`], faults within images apart.
pub fn count_pixels(source: &SceneSource, request: &SceneRequest) -> Result<PixelCount, SceneError> {
    check(request)?;
    match source {
        SceneSource::Procedural(name) => procedural::count_pixels(name, request),
        SceneSource::Folder { path } => loaders::count_pixels(path, request),
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

    /// What no photograph shows is best guessed by their mean.
    #[test]
    fn an_unknown_backdrop_is_the_mean_of_the_photographs() {
        let request = SceneRequest { image_size: Some(8), test: TestProtocol::First(1), ..Default::default() };
        let scene = load(&SceneSource::Procedural("room".into()), &request).unwrap();
        assert_eq!(scene.backdrop, Backdrop::Unknown);
        let pixels: Vec<[f32; 3]> = scene.train.iter().flat_map(|view| view.image.rgb.clone()).collect();
        for channel in 0..3 {
            let error = |guess: f32| pixels.iter().map(|pixel| (pixel[channel] - guess).powi(2)).sum::<f32>();
            let mean = scene.background[channel];
            assert!(error(mean) < error(mean + 0.01) && error(mean) < error(mean - 0.01));
        }
        assert_eq!(load(&SceneSource::Procedural("knot".into()), &request).unwrap().background, [1.0; 3]);
    }

    #[test]
    fn pixels_are_counted_before_they_are_loaded() {
        let guard = tempfile::tempdir().unwrap();
        let dir = guard.path().join("toy");
        loaders::testing::blender(&dir, 5, 3);
        let sources = [SceneSource::Procedural("knot".into()), SceneSource::Folder { path: dir }];
        for source in sources {
            for image_size in [Some(6), None] {
                let train = ViewSelection::Ids(vec![1, 3]);
                let request = SceneRequest { train, test: TestProtocol::First(3), image_size, ..Default::default() };
                let counted = count_pixels(&source, &request).unwrap();
                assert_eq!(counted, load(&source, &request).unwrap().pixels(), "{source:?}");
                assert_eq!(2 * counted.test, 3 * counted.train);
            }
        }
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
            image: image.into(),
            depth: Some(vec![1.0; 8].into()),
            mask: Some(vec![true, true, false, false, true, false, false, true].into()),
        };
        let half = view.reduced(2);
        assert_eq!(half.image.rgb, [[0.4375, 0.25, 0.25], [0.25; 3]]);
        assert_eq!(half.mask.unwrap()[..], [true, false], "a pixel counts if half of it does");
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
