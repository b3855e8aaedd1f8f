//! Cameras, rays, loaders and procedural scenes: everything a radiance field is trained *from*.
//!
//! A [`SceneSource`] (a folder of photographs or the name of a built-in procedural scene) and a
//! [`SceneRequest`] (which views, at which size, on which background) give a [`Scene`] through
//! [`load`]. Nothing here knows about tensors or networks.
//!
//! # Conventions
//! - World: right-handed. Built-in and Blender scenes have z up.
//! - Camera-to-world matrices are OpenGL's: the camera looks along its −z axis, +y is up, +x right.
//!   Loaders convert to that once.
//! - Pixel `(i, j)` is column `i`, row `j`, row 0 at the top; its centre is at `(i + 0.5, j + 0.5)`.
//! - Ray directions have unit length, so that `t` is a metric distance along the ray.
//! - Lengths are in scene units, angles in radians unless a name ends in `_deg`.
//!
//! ```
//! use infonerf_scene::{load, SceneRequest, SceneSource, TestProtocol, ViewSelection};
//!
//! let request = SceneRequest {
//!     train: ViewSelection::Seed { seed: 0, count: 4 },
//!     test: TestProtocol::First(1),
//!     image_size: Some(16),
//!     ..Default::default()
//! };
//! let scene = load(&SceneSource::Procedural("knot".into()), &request)?;
//! assert_eq!(scene.train.iter().map(|v| v.id).collect::<Vec<_>>(), [26, 86, 2, 55]);
//! # Ok::<(), infonerf_scene::SceneError>(())
//! ```

mod body;
mod bounds;
mod camera;
mod camera_path;
pub mod colmap;
mod error;
mod export;
mod format;
mod image;
mod info;
mod layout;
mod lens;
mod loaders;
mod photographs;
pub mod poses;
pub mod procedural;
mod range;
mod ray;
mod scene;
pub mod select;
mod space;
mod transforms;

pub use body::Body;
pub use bounds::Aabb;
pub use camera::Camera;
pub use camera_path::CameraPath;
pub use error::SceneError;
pub use export::export;
pub use format::{Backdrop, Format};
pub use image::{Image, Rgba8, RgbaImage, resized_dimensions, round_to_u8};
pub use info::{Concern, Info, Warning, check, info, info_page, outline};
pub use layout::Layout;
pub use lens::{Lens, LensModel};
#[doc(hidden)]
pub use loaders::fuzzing;
pub use photographs::from_images;
pub use poses::{
    Keyframe, ViewRegion, figure_eight, interpolate_keyframes, interpolate_views, near_pose, near_pose_about, orbit,
    spiral, unseen_pose,
};
pub use range::Range;
pub use ray::Ray;
pub use scene::{PixelCount, Scene, SceneRequest, SceneSource, View, count_pixels, load};
pub use select::{TestProtocol, ViewSelection};
pub use space::Space;
pub use transforms::transforms;
