//! Radiance fields as meshes, point clouds and gaussian splats that other programs read.
//!
//! ```text
//! Volume ─► DensityGrid ─► Surface (triangles) ─► Mesh (with colours) ─► ply, glb, points
//!    └─► surface_density ─►┘             └─► Gaussian ─► refine ─► splat
//! ```
//!
//! A field is anything that implements [`Volume`]: density and colour at points of the world. Writers are pure
//! functions that return the bytes of the file.
//!
//! ```
//! use glam::{DVec3, Vec3};
//! use infonerf_export::{DensityGrid, Mesh, Surface, Volume, ply_mesh};
//! use infonerf_scene::Aabb;
//!
//! /// A red ball of radius 1.
//! struct Ball;
//!
//! impl Volume for Ball {
//!     fn bounds(&self) -> Aabb {
//!         Aabb::cube(Vec3::ZERO, 1.5)
//!     }
//!
//!     fn density(&self, points: &[Vec3]) -> Vec<f32> {
//!         points.iter().map(|p| if p.length() < 1.0 { 100.0 } else { 0.0 }).collect()
//!     }
//!
//!     fn color(&self, points: &[Vec3], _directions: &[Vec3]) -> Vec<[f32; 3]> {
//!         vec![[1.0, 0.0, 0.0]; points.len()]
//!     }
//! }
//!
//! let grid = DensityGrid::sample(&Ball, 64, 50.0)?;
//! let mesh = Mesh::new(Surface::extract(&grid)?, &Ball);
//! std::fs::write(std::env::temp_dir().join("ball.ply"), ply_mesh(&mesh, DVec3::ZERO)).unwrap();
//! # Ok::<(), infonerf_export::ExportError>(())
//! ```

mod chamfer;
mod components;
mod glb;
mod grid;
mod level;
mod mesh;
mod ply;
mod refine;
mod shading;
mod splat;
mod splatter;
mod surface;
mod volume;

pub use chamfer::{Chamfer, chamfer};
pub use glb::glb;
pub use grid::DensityGrid;
pub use level::surface_density;
pub use mesh::Mesh;
pub use ply::{ply_mesh, ply_points};
pub use refine::{SplatTarget, refine};
pub use splat::{Gaussian, gaussians, ply_splats};
pub use splatter::splat_image;
pub use surface::Surface;
pub use volume::Volume;

/// Reason, in one line, why a field cannot be exported.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct ExportError(String);
