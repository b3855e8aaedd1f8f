//! Rendering: rays, their samples, occupancy grids, compositing, and whole images.
//!
//! ```text
//! rays ─► sampler (candidate distances) ─► occupancy grid (drops what is empty or hidden) ─► field ─► compositing
//! ```
//!
//! Rendering an image of a user-defined field, here a uniform blue fog:
//!
//! ```
//! use burn::module::Module;
//! use burn::tensor::{Device, Tensor};
//! use glam::{DMat4, DVec3};
//! use infonerf_field::{Field, Points, FieldOutput};
//! use infonerf_render::{Model, Placement, RenderConfig, Renderer, TrainedModel, render_image};
//! use infonerf_scene::{Camera, Scene};
//! use infonerf_schedule::Moment;
//!
//! #[derive(Module, Debug)]
//! struct Fog {
//!     density: Tensor<1>,
//! }
//!
//! impl Field for Fog {
//!     fn evaluate(&self, points: &Points, color: bool, _at: Moment) -> FieldOutput {
//!         let sigma = self.density.clone().expand([points.segments.samples()]);
//!         let blue = Tensor::<2>::from_floats([[0.0, 0.0, 1.0]], &self.device());
//!         FieldOutput { color: color.then(|| blue.expand([points.segments.samples(), 3])), sigma }
//!     }
//! }
//!
//! let camera = Camera::from_fov(8, 8, 0.6, DMat4::from_translation(DVec3::new(0.0, 0.0, 4.0)));
//! let config = RenderConfig { samples: 16.0.into(), fine_samples: 0, placement: Placement::Mid, ..RenderConfig::default() };
//! let fog = Fog { density: Tensor::from_floats([100.0], &Device::flex()) };
//! let trained = TrainedModel::of(Model::of(fog), Moment::START);
//! let picture = render_image(&Renderer::new(&config, &Scene::default()), &[trained], &camera);
//! assert_eq!((picture.width, picture.rgb[0]), (8, [0.0, 0.0, 1.0]));
//! ```

mod cell_state;
mod config;
mod exposure;
mod fill;
mod image;
mod march;
mod model;
mod noise;
mod normals;
mod occupancy;
mod output;
mod rays;
mod refinement;
mod renderer;
mod residuals;
mod sampler;
mod steps;
mod warp;

pub use config::{Compositing, OccupancyConfig, RenderConfig};
pub use exposure::Exposure;
pub use image::{RenderedImage, render_image, render_tested};
pub use infonerf_ops::sampling::{LastInterval, Placement};
pub use model::{Model, ModelFrame, TrainedModel};
pub use noise::{Noise, RandomStream};
pub use normals::render_normals;
pub use occupancy::OccupancyGrid;
pub use output::{Counts, Passes, RenderOutput, RenderRequest, Samples};
pub use rays::RayBatch;
pub use refinement::{CameraRefinement, Focal, Pivot};
pub use renderer::{Renderer, evaluate_at};
pub use residuals::Residuals;
pub use warp::{SpaceChoice, Warp};
