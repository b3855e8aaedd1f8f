//! Scenes from folders of posed photographs, in the formats of published data sets.
//!
//! A [`SceneSource`] (a folder, or the name of a built-in scene) and a [`SceneRequest`](infonerf_scene::SceneRequest)
//! (which views, at which size, on which background) give a [`Scene`](infonerf_scene::Scene) through [`load`]. [`info`]
//! and [`check_folder`] look at a folder before training, [`export()`] writes built-in scenes in the same formats, and
//! [`from_images`] finds the poses of photographs.
//!
//! ```
//! use infonerf_dataset::{SceneSource, load};
//! use infonerf_scene::{SceneRequest, TestProtocol, ViewSelection};
//!
//! let train = ViewSelection::Seed { seed: 0, count: 4 };
//! let request = SceneRequest { train, test: TestProtocol::First(1), image_size: Some(16), ..Default::default() };
//! let scene = load(&SceneSource::Procedural("knot".into()), &request)?;
//! assert_eq!(scene.train.iter().map(|v| v.id).collect::<Vec<_>>(), [26, 86, 2, 55]);
//! # Ok::<(), infonerf_scene::SceneError>(())
//! ```

mod camera_path;
mod capture;
pub mod colmap;
mod export;
mod files;
mod frame;
#[doc(hidden)]
pub mod fuzzing;
mod info;
mod loaders;
mod photographs;
mod refined_cameras;
mod source;

pub use camera_path::CameraPath;
pub use export::{export, transforms};
pub use info::{Info, check_folder, info, info_page, outline};
pub use infonerf_sfm::max_matched_pairs;
pub use photographs::{
    PoseSearch, PoseSolver, changed_photographs, from_images, photograph_folder, video_folder, video_frames,
};
pub use refined_cameras::with_refined_cameras;
pub use source::{SceneSource, count_pixels, load};
