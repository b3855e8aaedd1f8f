//! From rays to pictures.
//!
//! ```text
//! rays ─► sampler (candidate distances) ─► occupancy grid (drops what is empty or hidden) ─► field ─► compositing
//! ```

mod config;
mod distances;
mod ensemble;
mod image;
mod march;
mod model;
mod noise;
mod occupancy;
mod output;
mod renderer;
mod sampler;
mod samples;
mod warp;

pub use config::{Compositing, ConfigError, LastInterval, OccupancyConfig, Placement, RenderConfig};
pub use image::{RenderedImage, render_image};
pub use model::{Model, TrainedModel};
pub use noise::{Noise, Stream};
pub use occupancy::OccupancyGrid;
pub use output::{Counts, Passes, RenderOutput, RenderRequest};
pub use renderer::Renderer;
pub use samples::Samples;
pub use warp::{Space, Warp};
