//! Cameras, rays, posed images and the choice of views: everything a radiance field is trained *from*.
//!
//! A [`Scene`] holds training and test [`View`]s and the [`Space`] between them. Scenes come from `infonerf-procedural`
//! (built in) or `infonerf-dataset` (folders in known formats), both of which answer a [`SceneRequest`]. Nothing here
//! knows about file formats, tensors or networks.
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
//! use glam::{DMat4, DVec3};
//! use infonerf_scene::{Camera, ViewSelection};
//!
//! let pose = |i: u32| DMat4::from_translation(DVec3::X * f64::from(i));
//! let cameras: Vec<_> = (0..100).map(|i| Camera::from_fov(8, 8, 0.7, pose(i))).collect();
//! let chosen = ViewSelection::Seed { seed: 0, count: 4 }.select(&cameras)?;
//! assert_eq!(chosen, [26, 86, 2, 55]);
//! # Ok::<(), infonerf_scene::SceneError>(())
//! ```

mod bounds;
mod camera;
mod error;
mod format;
pub mod image;
mod layout;
mod lens;
pub mod poses;
mod range;
mod ray;
mod request;
mod scene;
pub mod select;
mod space;
#[cfg(test)]
mod testing;

pub use bounds::Aabb;
pub use camera::{Camera, look_along};
pub use error::SceneError;
pub use format::{Backdrop, Format};
pub use image::{Image, Rgba8, RgbaImage, bilinear, resized_dimensions};
pub use layout::Layout;
pub use lens::{Lens, LensModel};
pub use poses::{
    Keyframe, PoseError, Similarity, ViewRegion, figure_eight, interpolate_keyframes, interpolate_views, near_pose,
    orbit, rotation_angle_deg, spiral,
};
pub use range::Range;
pub use ray::{PixelAt, Ray};
pub use request::{MaskUse, SceneRequest};
pub use scene::{PixelCount, Scene, View};
pub use select::{TestProtocol, ViewSelection};
pub use space::{Body, Space};
