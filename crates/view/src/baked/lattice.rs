use glam::Vec3;
use infonerf_scene::Aabb;

/// Number of voxels along a brick.
pub(super) const CELLS: usize = 8;
/// Number of points along a brick: the corners of its voxels.
pub(super) const POINTS: usize = CELLS + 1;
pub(super) const VOLUME: usize = POINTS * POINTS * POINTS;

/// Corners of cubic voxels that fill a box, in cells of a brick's size. Points and cells are numbered, x fastest.
#[derive(Clone, Debug)]
pub(super) struct Lattice {
    /// First point.
    pub(super) low: Vec3,
    /// Edge of a voxel.
    pub(super) voxel: f32,
    pub(super) cells: [usize; 3],
}

impl Lattice {
    /// Makes a lattice from the first corner of the box to its last one or beyond.
    pub(super) fn over(bounds: &Aabb, voxel: f32) -> Self {
        // A side that is a whole number of cells keeps this number in spite of rounding.
        let cells = (bounds.size() / (voxel * CELLS as f32) - 1e-3).ceil().max(Vec3::ONE);
        Self { low: bounds.min, voxel, cells: cells.to_array().map(|n| n as usize) }
    }

    pub(super) fn cell_count(&self) -> usize {
        self.cells.iter().product()
    }

    pub(super) fn cell(&self, cell: usize) -> [usize; 3] {
        coordinates(cell, self.cells)
    }

    fn sides(&self) -> [usize; 3] {
        self.cells.map(|n| n * CELLS + 1)
    }

    /// Returns the points of a cell's brick, [`VOLUME`] of them.
    pub(super) fn points(&self, cell: usize) -> impl Iterator<Item = usize> + use<> {
        let first = self.cell(cell).map(|c| c * CELLS);
        let [nx, ny, _] = self.sides();
        (0..VOLUME).map(move |index| {
            let [x, y, z] = coordinates(index, [POINTS; 3]);
            first[0] + x + nx * (first[1] + y + ny * (first[2] + z))
        })
    }

    pub(super) fn position(&self, point: usize) -> Vec3 {
        self.low + self.voxel * Vec3::from_array(coordinates(point, self.sides()).map(|c| c as f32))
    }
}

/// Returns the coordinates of element `index` of an array with `nx` × `ny` elements per layer, x fastest.
pub(super) fn coordinates(index: usize, [nx, ny, _]: [usize; 3]) -> [usize; 3] {
    [index % nx, index / nx % ny, index / (nx * ny)]
}
