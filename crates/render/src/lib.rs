//! From rays to pictures.
//!
//! ```text
//! rays ─► sampler (candidate distances) ─► occupancy grid (drops what is empty or hidden) ─► field ─► compositing
//! ```

mod config;
mod ensemble;
mod image;
mod march;
mod noise;
mod occupancy;
mod render;
mod sampler;
mod samples;

pub use config::{ConfigError, LastInterval, OccupancyConfig, Placement, RenderConfig};
pub use image::{Learned, RenderedImage, render_image};
pub use noise::Noise;
pub use occupancy::OccupancyGrid;
pub use render::{Counts, Level, Model, Renderer, Want};
pub use samples::Samples;
