//! Viewer of scenes in a browser.
//!
//! ```text
//! run ─► field ─► 8-bit tables, MLP, occupancy grid ─► shader ─► one page, or a server on this machine
//!           └──► baked: bricks of 8-bit voxels ──────────┘
//! ```
//!
//! A factored field ([`infonerf_ops::factored`]) is so small that a browser can evaluate it as it is: planes and lines
//! go into textures of 8 bits with a scale and an offset per channel, the MLP into a block of uniforms, and one WebGL2
//! fragment shader marches along rays as [`infonerf_render::render_image`] does, under the same [`Warp`]. Images differ by
//! the tables' rounding (half of 1/255 of each channel's range).
//!
//! Any other field is *baked* to a sparse grid of voxels with density and colour, in spherical harmonics of degree 1,
//! through which the same shader marches. The page notes this with the number of voxels.
//!
//! - [`page`]: one HTML file of a run's field, self-contained.
//! - [`Server`]: all runs below some folders, with curves and test views, or two of them under one camera. It follows runs while
//!   they train, and with a [`TrainingControl`] pauses or stops those of this process.
//!
//! ```no_run
//! use infonerf_experiment::{DeviceName, RunPlan, Trained, open};
//!
//! let folder = std::path::Path::new("runs/synthetic-4view/crane/infonerf+/seed0");
//! let run = Trained::read(RunPlan::of_run(folder)?, folder, &open(DeviceName::Auto)?)?;
//! std::fs::write("crane.html", infonerf_view::page(&run, folder, None)?)?;
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
mod server;
mod shader;

pub use factored::is_exact;
pub use server::{Server, TrainingControl};

use std::path::Path;

use anyhow::Result;
use infonerf_experiment::Trained;

/// Makes a self-contained page of the run in `folder`: orbit, pan and zoom, depth and normals, and the training cameras
/// with their images. The page shows and notes the first of several fields, without residuals. A baked field has
/// at most `voxels` along the longest side of its box, by default 256, or 128 if the field is slow; fewer if too many are filled.
pub fn page(run: &Trained, folder: &Path, voxels: Option<usize>) -> Result<String> {
    let trained = run.fields().swap_remove(0);
    let voxels = voxels.unwrap_or_else(|| baked::resolution(&run.plan.config.field));
    Ok(page::of_package(&package::of_run(run, folder, &trained, voxels)?, &package::poster(run, &trained)?))
}
