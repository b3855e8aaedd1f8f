use std::ops::RangeInclusive;

use glam::{UVec3, Vec3};
use infonerf_scene::Aabb;

use crate::ExportError;
use crate::volume::Volume;

/// Range of voxels along the longest side of a grid. The largest grid takes 0.5 GB, its surface three times as much.
const RESOLUTIONS: RangeInclusive<usize> = 2..=512;

/// Number of points per query of a volume, which bounds the memory.
const CHUNK: usize = 1 << 18;

/// Densities at the centres of cubic voxels that fill a box.
#[derive(Clone, Debug)]
pub struct DensityGrid {
    /// Centre of the first voxel, scene units.
    pub origin: Vec3,
    /// Edge of a voxel, scene units.
    pub voxel: f32,
    /// Number of voxels along x, y and z.
    pub size: UVec3,
    /// Density σ ≥ 0 of each voxel, 1/scene unit; x runs fastest, z slowest.
    pub density: Vec<f32>,
    /// Density of the surface, 1/scene unit.
    pub level: f32,
}

impl DensityGrid {
    /// Samples `volume` at `resolution` voxels along the longest side of its box and as many as it takes along the
    /// others. Its surface has the density `level`, see [`surface_density`](crate::surface_density).
    ///
    /// # Errors
    /// If the resolution is not from 2 to 512.
    pub fn sample(volume: &dyn Volume, resolution: usize, level: f32) -> Result<Self, ExportError> {
        let mut grid = Self::empty(volume.bounds(), resolution, level)?;
        let count = grid.count();
        grid.density.reserve_exact(count);
        for start in (0..count).step_by(CHUNK) {
            let points: Vec<Vec3> = (start..(start + CHUNK).min(count)).map(|index| grid.point(index)).collect();
            grid.density.extend(volume.density(&points));
        }
        Ok(grid)
    }

    /// Makes the voxels of a box, without densities.
    fn empty(bounds: Aabb, resolution: usize, level: f32) -> Result<Self, ExportError> {
        if !RESOLUTIONS.contains(&resolution) {
            let (least, most) = RESOLUTIONS.into_inner();
            return Err(ExportError(format!("resolution: expected {least} to {most} voxels, found {resolution}")));
        }
        let sides = bounds.size();
        let voxel = sides.max_element() / resolution as f32;
        // A side that is a whole number of voxels keeps this number in spite of rounding.
        let size = (sides / voxel - 1e-3).ceil().as_uvec3().max(UVec3::ONE);
        let origin = bounds.centre() - 0.5 * voxel * (size.as_vec3() - 1.0);
        Ok(Self { origin, voxel, size, density: Vec::new(), level })
    }

    /// Returns the number of voxels.
    pub fn count(&self) -> usize {
        self.size.to_array().map(|n| n as usize).iter().product()
    }

    /// Returns the centre of the voxel `index`, scene units.
    pub fn point(&self, index: usize) -> Vec3 {
        let (nx, ny) = (self.size.x as usize, self.size.y as usize);
        let place = Vec3::new((index % nx) as f32, (index / nx % ny) as f32, (index / (nx * ny)) as f32);
        self.origin + self.voxel * place
    }

    /// Returns the opacity `1 − 2^(−σ/level)` of the voxel `index`, which is ½ at the surface's density.
    pub(crate) fn opacity(&self, index: usize) -> f32 {
        1.0 - (-self.density[index] / self.level).exp2()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::volume::testing::Ball;

    #[test]
    fn voxels_are_cubes_that_fill_the_box() {
        let bounds = Aabb { min: Vec3::new(-1.0, 0.0, 2.0), max: Vec3::new(1.0, 1.0, 2.3) };
        let grid = DensityGrid::empty(bounds, 8, 1.0).unwrap();
        assert_eq!((grid.voxel, grid.size), (0.25, UVec3::new(8, 4, 2)));
        assert_eq!(grid.point(0).truncate(), Vec3::new(-0.875, 0.125, 0.0).truncate());
        let last = grid.point(grid.count() - 1);
        assert!((last - Vec3::new(0.875, 0.875, 2.275)).length() < 1e-6, "{last}");
        assert_eq!(DensityGrid::empty(Aabb::cube(Vec3::ONE, 1.3), 200, 1.0).unwrap().size, UVec3::splat(200));
    }

    #[test]
    fn resolutions_out_of_range_are_refused() {
        for found in [0, 1, 513, usize::MAX] {
            let text = DensityGrid::sample(&Ball { radius: 1.0, sharpness: 20.0 }, found, 1.0).unwrap_err().to_string();
            assert_eq!(text, format!("resolution: expected 2 to 512 voxels, found {found}"));
        }
    }
}
