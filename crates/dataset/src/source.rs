//! Sources of scenes, and loading from them.

use std::path::PathBuf;

use infonerf_procedural as procedural;
use infonerf_scene::{Backdrop, Layout, PixelCount, Scene, SceneError, SceneRequest};

use crate::{capture, info, loaders};

/// Source of a scene: built in, or a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SceneSource {
    /// A built-in scene, one of [`infonerf_procedural::NAMES`] or `random-<seed>`.
    Procedural(String),
    /// Folder in a known format. The first of these files that it has shows which:
    /// `transforms_train.json` (Blender), `transforms.json` (nerfstudio, instant-ngp), `poses_bounds.npy` (LLFF),
    /// `cameras_sphere.npz` or `cameras.npz` (DTU), `annots.npy` (ZJU-MoCap), a reconstruction of COLMAP.
    Folder {
        /// Folder that has that file.
        path: PathBuf,
    },
}

impl SceneSource {
    /// Whether the source is in a known format, or built in.
    pub fn is_scene(&self) -> bool {
        match self {
            Self::Procedural(name) => procedural::check_name(name).is_ok(),
            Self::Folder { path } => loaders::is_scene(path),
        }
    }

    /// Whether the scene has the vertices of a body, judged by the names of its files.
    pub fn has_body(&self) -> bool {
        match self {
            Self::Procedural(name) => procedural::has_body(name),
            Self::Folder { path } => loaders::zju::has_body(path),
        }
    }

    /// Returns the background in the first image, the only one that is read, if it exists, and the layout of the cameras.
    ///
    /// # Errors
    /// Errors of [`load`] about poses, or that image cannot be read.
    pub fn setting(&self) -> Result<(Option<Backdrop>, Layout), SceneError> {
        match self {
            Self::Procedural(name) => {
                let is_capture = procedural::CAPTURES.contains(&name.as_str());
                let backdrop = if is_capture { Backdrop::Unknown } else { Backdrop::Colour };
                Ok((Some(backdrop), procedural::layout(name)))
            }
            Self::Folder { path } => info(path).map(|info| (info.backdrop, info.space.layout)),
        }
    }
}

/// Loads the views that `request` asks for, and no other image, from `source`.
///
/// Images are decoded or rendered in parallel; the result does not depend on the number of threads.
///
/// # Errors
/// Every fault of the data or of the request, as a [`SceneError`] of one line: a missing folder,
/// file or field, a broken image, a pose that is not a rigid transform, an image of other proportions than its camera,
/// no views, ids out of range or given twice.
pub fn load(source: &SceneSource, request: &SceneRequest) -> Result<Scene, SceneError> {
    match source {
        SceneSource::Procedural(name) => procedural::load(name, request),
        SceneSource::Folder { path } => capture::assemble(loaders::read(path, request)?, request, true),
    }
}

/// Counts the pixels that [`load`] would hold, from the headers of image files: nothing is decoded or rendered.
///
/// # Errors
/// Errors of [`load`], except for faults within images.
pub fn count_pixels(source: &SceneSource, request: &SceneRequest) -> Result<PixelCount, SceneError> {
    match source {
        SceneSource::Procedural(name) => procedural::count_pixels(name, request),
        SceneSource::Folder { path } => capture::count_pixels(loaders::read(path, request)?, request),
    }
}

#[cfg(test)]
mod tests {
    use infonerf_scene::{TestProtocol, ViewSelection};

    use super::*;

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
        for source in [SceneSource::Procedural("knot".into()), SceneSource::Folder { path: dir }] {
            for image_size in [Some(6), None] {
                let train = ViewSelection::Ids { ids: vec![1, 3] };
                let request = SceneRequest { train, test: TestProtocol::First(3), image_size, ..Default::default() };
                let counted = count_pixels(&source, &request).unwrap();
                assert_eq!(counted, load(&source, &request).unwrap().pixels(), "{source:?}");
                assert_eq!(2 * counted.test, 3 * counted.train);
                let nothing = SceneRequest { image_size: Some(0), ..request };
                assert!(load(&source, &nothing).unwrap_err().to_string().contains("image_size"));
            }
        }
    }
}
