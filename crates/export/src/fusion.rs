//! Depth maps fused into a grid.

use std::f32::consts::LN_2;

use infonerf_scene::{Aabb, Camera};
use rayon::prelude::*;

use crate::{ExportError, Grid};

/// Truncation distance μ of the signed distance, in voxels.
const TRUNCATION: f32 = 3.0;
/// The greatest opacity of a voxel, so that its density is finite.
const MOST_OPAQUE: f32 = 0.999;

/// The depth that a camera sees.
#[derive(Clone, Debug)]
pub struct DepthMap {
    /// The camera.
    pub camera: Camera,
    /// Distance along each pixel's ray in scene units, row by row; infinite where it hits nothing.
    pub depth: Vec<f32>,
}

impl DepthMap {
    /// The distance along the camera's ray from `point` to the surface that it sees: positive in front of the surface, negative
    /// behind it, infinite where the ray hits nothing. `None` outside the picture.
    fn signed_distance(&self, point: glam::Vec3) -> Option<f32> {
        let pixel = self.camera.project(point)?;
        let within = pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < self.camera.width as f32;
        if !within || pixel.y >= self.camera.height as f32 {
            return None;
        }
        let index = pixel.y as usize * self.camera.width as usize + pixel.x as usize;
        Some(self.depth[index] - point.distance(self.camera.position()))
    }
}

impl Grid {
    /// Fuses `maps` at `resolution` voxels along the longest side of `bounds` (Curless and Levoy 1996): the signed distance d
    /// of a voxel is the mean of `min(dᵢ, μ)` over the maps with `dᵢ ≥ −μ`, where μ is three voxels. A voxel without such a map,
    /// which is hidden or outside every picture, is solid.
    ///
    /// The density has the opacity `½ − d/2μ` over one scene unit, so the surface (σ = ln 2) is where d = 0.
    ///
    /// # Errors
    /// If the resolution is out of [`crate::RESOLUTIONS`].
    ///
    /// # Panics
    /// If a map does not have one depth per pixel.
    pub fn fuse(bounds: Aabb, resolution: usize, maps: &[DepthMap]) -> Result<Self, ExportError> {
        for map in maps {
            let pixels = map.camera.width as usize * map.camera.height as usize;
            assert_eq!(map.depth.len(), pixels, "a distance for every pixel");
        }
        let mut grid = Self::empty(bounds, resolution, LN_2)?;
        let reach = TRUNCATION * grid.voxel;
        let distance = |index: usize| {
            let point = grid.point(index);
            let seen = maps.iter().filter_map(|map| map.signed_distance(point)).filter(|d| *d >= -reach);
            let (sum, count) = seen.fold((0.0, 0), |(sum, count), d| (sum + d.min(reach), count + 1));
            if count == 0 { -reach } else { sum / count as f32 }
        };
        let density = |index| {
            let opacity = (0.5 - 0.5 * distance(index) / reach).clamp(0.0, MOST_OPAQUE);
            -(-opacity).ln_1p()
        };
        grid.density = (0..grid.len()).into_par_iter().map(density).collect();
        Ok(grid)
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;
    use infonerf_procedural::train_cameras;

    use super::*;
    use crate::Surface;

    /// What a camera sees of a ball of radius 1 about the origin.
    fn ball(camera: Camera) -> DepthMap {
        let depth = |index: u32| {
            let (x, y) = (index % camera.width, index / camera.width);
            let (origin, direction) = camera.ray_f64(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let (b, c) = (origin.dot(direction), origin.length_squared() - 1.0);
            let root = b * b - c;
            if root < 0.0 { f32::INFINITY } else { (-b - root.sqrt()) as f32 }
        };
        let depth = (0..camera.width * camera.height).map(depth).collect();
        DepthMap { camera, depth }
    }

    #[test]
    fn a_ball_that_is_seen_from_all_sides_is_met_within_a_voxel() {
        let maps: Vec<DepthMap> = train_cameras(96).into_iter().map(ball).collect();
        let above = maps.iter().filter(|map| map.camera.position().z > 0.0).count();
        assert!(above > 0 && maps.iter().all(|map| map.camera.forward().dot(map.camera.position()) < 0.0));
        let grid = Grid::fuse(Aabb::cube(Vec3::ZERO, 1.3), 32, &maps).unwrap();
        let surface = Surface::extract(&grid).unwrap();
        let seen: Vec<f32> = surface.positions.iter().filter(|p| p.z > 0.0).map(|p| p.length()).collect();
        assert!(seen.len() > 1000, "{}", seen.len());
        for radius in &seen {
            assert!((radius - 1.0).abs() < grid.voxel, "{radius}");
        }
        let mean = seen.iter().sum::<f32>() / seen.len() as f32;
        assert!((mean - 1.0).abs() < 0.3 * grid.voxel, "{mean}");
    }

    #[test]
    fn what_nothing_sees_is_solid_and_what_is_seen_through_is_empty() {
        let bounds = Aabb::cube(Vec3::ZERO, 0.5);
        let nowhere = Grid::fuse(bounds, 4, &[]).unwrap();
        assert!((0..nowhere.len()).all(|index| nowhere.opacity(index) > 0.99));
        let camera = train_cameras(16).remove(0);
        let depth = vec![f32::INFINITY; 256];
        let through = Grid::fuse(bounds, 4, &[DepthMap { camera: camera.clone(), depth }]).unwrap();
        assert!((0..through.len()).all(|index| through.opacity(index) == 0.0));
        // Behind a wall it is solid again.
        let wall = vec![camera.position().length(); 256];
        let half = Grid::fuse(bounds, 8, &[DepthMap { camera: camera.clone(), depth: wall }]).unwrap();
        for index in 0..half.len() {
            let before = camera.position().length() - half.point(index).distance(camera.position());
            if before.abs() > half.voxel {
                assert_eq!(half.opacity(index) < 0.5, before > 0.0, "{before}");
            }
        }
    }
}
