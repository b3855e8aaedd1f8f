//! Bricks that are not empty, with their densities in 8 bits.
//!
//! A byte is `255 √(α/α_max)` of a voxel's opacity `α = 1 − exp(−σ · voxel)`. Opacities lie between 0 and 1 whatever σ
//! is; their root has finer steps for small opacities: the smallest above 0 is 1.5e-5, a step in the middle is 0.8 %, and
//! errors of nearly opaque voxels are not visible.

use glam::Vec3;
use rayon::prelude::*;

use super::domain::Domain;
use super::lattice::{CELLS, Lattice, POINTS, VOLUME, coordinates};
use super::probe::FieldProbe;

/// Maximum opacity of a voxel, that of optical depth 8.
pub(super) const MAX_OPACITY: f32 = 0.999_664_5;
/// Minimum byte of a voxel that transmits less than a tenth of the light.
pub(super) const NEARLY_OPAQUE: u8 = 242;
/// Maximum number of bricks: 46 MB at 13 bytes per point, which graphics cards can hold and a page can contain.
pub(super) const MAX_BRICKS: usize = 4900;
/// Distance in voxels between the points that find occupied bricks. Smaller details of a sharp density may be missed.
const COARSE: usize = 4;
/// Minimum number of voxels along the longest side that is tried.
const MIN_RESOLUTION: usize = 16;

/// Cells of a lattice in which a field is not empty.
pub(super) struct Bricks {
    pub(super) lattice: Lattice,
    /// Indices of the cells, ascending. The position of a cell in this list is the number of its brick.
    pub(super) cells: Vec<usize>,
    /// [`byte`] of each point of each brick.
    pub(super) roots: Vec<u8>,
    /// Number of each cell's brick, if it has one.
    numbers: Vec<Option<u32>>,
}

impl Bricks {
    /// Finds the bricks at `resolution` voxels along the domain's side, or fewer for at most [`MAX_BRICKS`]; returns it too.
    pub(super) fn find(probe: &FieldProbe<'_>, domain: &Domain, mut resolution: usize) -> (usize, Self) {
        loop {
            let lattice = Lattice::over(&domain.bounds, domain.side / resolution as f32);
            let cells = candidates(probe, domain, &lattice);
            if cells.len() <= MAX_BRICKS || resolution <= MIN_RESOLUTION {
                return (resolution, Self::of(probe, domain, lattice, &cells));
            }
            // A volume then has few enough bricks; a surface may need another round.
            let fewer = resolution as f32 * (MAX_BRICKS as f32 / cells.len() as f32).cbrt();
            resolution = (fewer as usize).min(resolution * 15 / 16).max(MIN_RESOLUTION);
        }
    }

    /// Keeps the `candidates` that are not empty at every point.
    fn of(probe: &FieldProbe<'_>, domain: &Domain, lattice: Lattice, candidates: &[usize]) -> Self {
        let mut points: Vec<usize> = candidates.par_iter().flat_map_iter(|&cell| lattice.points(cell)).collect();
        points.par_sort_unstable();
        points.dedup();
        let wanted: Vec<usize> =
            points.into_par_iter().filter(|&point| domain.holds(lattice.position(point), lattice.voxel)).collect();
        let positions: Vec<Vec3> = wanted.par_iter().map(|&point| lattice.position(point)).collect();
        let densities = probe.densities(&positions, lattice.voxel);
        let least = domain.least_density();
        let root = |point: usize| {
            let density = wanted.binary_search(&point).map_or(0.0, |index| densities[index]);
            if density < least { 0 } else { byte(density, lattice.voxel) }
        };
        let of_cell = |&cell: &usize| {
            let roots: Vec<u8> = lattice.points(cell).map(root).collect();
            roots.iter().any(|&root| root > 0).then_some((cell, roots))
        };
        let found: Vec<(usize, Vec<u8>)> = candidates.par_iter().filter_map(of_cell).collect();
        let mut numbers = vec![None; lattice.cell_count()];
        for (number, (cell, _)) in (0..).zip(&found) {
            numbers[*cell] = Some(number);
        }
        let (cells, roots): (Vec<usize>, Vec<Vec<u8>>) = found.into_iter().unzip();
        Self { lattice, cells, roots: roots.concat(), numbers }
    }

    /// Returns the byte of the point at `offset` from the first point of a cell's brick; 0 where there is no brick.
    pub(super) fn root(&self, cell: usize, offset: [isize; 3]) -> u8 {
        let (mut place, mut local) = (self.lattice.cell(cell), [0; 3]);
        for axis in 0..3 {
            let at = (place[axis] * CELLS) as isize + offset[axis];
            let Ok(at) = usize::try_from(at) else { return 0 };
            // The last point along an axis belongs to the last cell alone.
            place[axis] = (at / CELLS).min(self.lattice.cells[axis] - 1);
            local[axis] = at - place[axis] * CELLS;
        }
        let ([nx, ny, _], [x, y, z]) = (self.lattice.cells, local);
        let number =
            self.numbers[place[0] + nx * (place[1] + ny * place[2])].filter(|_| local.iter().all(|&c| c < POINTS));
        number.map_or(0, |number| self.brick(number as usize)[x + POINTS * (y + POINTS * z)])
    }

    pub(super) fn brick(&self, number: usize) -> &[u8] {
        &self.roots[number * VOLUME..][..VOLUME]
    }
}

/// Finds the cells with at least one point of a coarse lattice that is not empty.
fn candidates(probe: &FieldProbe<'_>, domain: &Domain, lattice: &Lattice) -> Vec<usize> {
    const PER_CELL: usize = CELLS / COARSE;
    const ALONG: usize = PER_CELL + 1;
    let spacing = COARSE as f32 * lattice.voxel;
    let [nx, ny, nz] = lattice.cells.map(|n| n * PER_CELL + 1);
    let mut dense = vec![false; nx * ny * nz];
    for (z, layer) in dense.chunks_mut(nx * ny).enumerate() {
        let position = |i: usize| lattice.low + spacing * Vec3::new((i % nx) as f32, (i / nx) as f32, z as f32);
        let wanted: Vec<usize> = (0..layer.len()).filter(|&index| domain.holds(position(index), spacing)).collect();
        let positions: Vec<Vec3> = wanted.iter().map(|&index| position(index)).collect();
        for (index, density) in wanted.into_iter().zip(probe.densities(&positions, spacing)) {
            layer[index] = density >= domain.least_density();
        }
    }
    let is_dense = |&cell: &usize| {
        let first = lattice.cell(cell).map(|c| c * PER_CELL);
        let at = |[x, y, z]: [usize; 3]| dense[first[0] + x + nx * (first[1] + y + ny * (first[2] + z))];
        (0..ALONG.pow(3)).map(|index| coordinates(index, [ALONG; 3])).any(at)
    };
    (0..lattice.cell_count()).into_par_iter().filter(is_dense).collect()
}

/// Encodes a density, 1/length, as the byte of a voxel of length `voxel`.
fn byte(density: f32, voxel: f32) -> u8 {
    let opacity = -(-density * voxel).exp_m1() / MAX_OPACITY;
    (opacity.clamp(0.0, 1.0).sqrt() * 255.0).round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faulty_densities_are_bytes() {
        assert_eq!([0.0, f32::INFINITY, f32::NAN].map(|density| byte(density, 0.01)), [0, 255, 0]);
        assert!((0.9 - MAX_OPACITY * (f32::from(NEARLY_OPAQUE) / 255.0).powi(2)).abs() < 5e-3);
    }
}
