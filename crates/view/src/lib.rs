//! The scene in a browser.
//!
//! ```text
//! run ─► field ─► 8-bit tables, MLP, occupancy grid ─► shader ─► one page, or a server on this machine
//!           └──► baked: bricks of 8-bit voxels ──────────┘
//! ```
//!
//! A factored field ([`infonerf_ops::factored`]) is so small that a browser can evaluate it as it is: planes and lines go
//! into textures of 8 bits with a scale and an offset per channel, the MLP into a block of uniforms, and one WebGL2
//! fragment shader marches along rays as [`infonerf_render::render_image`] does, under the same [`Warp`]. What differs
//! is the tables' rounding (half of 1/255 of each channel's range).
//!
//! Any other field is *baked*: density and colour, in spherical harmonics of degree 1, on a sparse grid of voxels, through
//! which the same shader marches. The page says so, and how many voxels there are.
//!
//! - [`page`]: a run's field as one HTML file that needs nothing else.
//! - [`Server`]: the same for all runs in a folder, with curves and test views, following runs while they train, and pausing or
//!   stopping them where they heed its [`TrainingControl`].
//!
//! ```no_run
//! use infonerf_experiment::{DeviceName, RunPlan, Trained, open};
//!
//! let folder = std::path::Path::new("runs/synthetic-4view/crane/infonerf+/seed0");
//! let run = Trained::read(RunPlan::of_run(folder)?, folder, &open(DeviceName::Auto)?)?;
//! std::fs::write("crane.html", infonerf_view::page(&run, None)?)?;
//! # Ok::<(), anyhow::Error>(())
//! ```
//!
//! [`Warp`]: infonerf_render::Warp

mod baked;
mod blob;
#[cfg(test)]
mod decode;
mod factored;
mod network;
mod package;
mod page;
mod photographs;
mod server;
mod shader;
mod tables;

pub use server::{Server, TrainingControl};

use anyhow::Result;
use infonerf_experiment::Trained;
use infonerf_field::FieldConfig;

/// Whether a page holds fields of this kind as they are. Others are baked, which takes seconds to minutes; so is a factored
/// field whose MLP has no room among a shader's uniforms.
pub fn holds(field: &FieldConfig) -> bool {
    matches!(field, FieldConfig::Factored(_))
}

/// The run's field as a page, whole in itself: orbit, pan and zoom, depth and normals, and the training cameras with their
/// photographs. Of several fields it is the first, and the page says so. A field that is baked has `voxels` along the longest
/// side of its box at most; without a number 256, or 128 if the field is slow, and fewer where so much is filled that they would be
/// too many.
///
/// # Errors
/// If a photograph cannot be encoded.
pub fn page(run: &Trained, voxels: Option<usize>) -> Result<String> {
    let trained = run.trainers[0].trained();
    let voxels = voxels.unwrap_or_else(|| baked::resolution(&run.plan.config.field));
    Ok(page::of_package(&package::of_run(run, &trained, voxels)?, &package::poster(run, &trained)?))
}
