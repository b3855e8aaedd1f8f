//! Extraction of triangles from densities, and their simplification.

use fast_surface_nets::ndshape::{RuntimeShape, Shape};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};
use glam::Vec3;
use meshopt::{SimplifyOptions, simplify_decoder};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::ExportError;
use crate::components::without_small;
use crate::grid::DensityGrid;

/// Closed surface of triangles, counter-clockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Vertices, scene units.
    pub positions: Vec<Vec3>,
    /// Outward unit normal of each vertex: the area-weighted mean over its triangles.
    pub normals: Vec<Vec3>,
    /// Vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Edge of the grid's voxels, scene units.
    pub voxel: f32,
    /// Number of small components that were left out.
    pub dropped: usize,
}

impl Surface {
    /// Extracts the surface on which `grid` has the density σ = [`DensityGrid::level`], by naive surface nets (Gibson 1998)
    /// on the opacity `1 − 2^(−σ/level)`, which is bounded and so places the surface between voxels better than σ does.
    ///
    /// The surface is closed at the grid's border. Cavities that cannot be reached from outside are filled, as no
    /// camera sees into them, and components with less than a thousandth of the largest one's area are left out.
    ///
    /// # Errors
    /// If no voxel reaches that density.
    pub fn extract(grid: &DensityGrid) -> Result<Self, ExportError> {
        let shape = RuntimeShape::<u32, 3>::new((grid.size + 2).to_array());
        let mut values = padded(grid, &shape);
        if values.iter().all(|&value| value >= 0.0) {
            let densest = grid.density.iter().copied().fold(0.0, f32::max);
            return Err(ExportError(format!(
                "the field has no surface: expected a voxel of density {:.3}, found at most {densest:.3}; \
                 a higher resolution or a longer training may give it one",
                grid.level
            )));
        }
        fill_cavities(&mut values, grid);
        let mut net = SurfaceNetsBuffer::default();
        surface_nets(&values, &shape, [0; 3], (grid.size + 1).to_array(), &mut net);
        let place = |p: &[f32; 3]| grid.origin + grid.voxel * (Vec3::from_array(*p) - 1.0);
        Ok(Self::of_large_components(net.positions.iter().map(place).collect(), &net.indices, grid.voxel))
    }

    /// Makes a surface of triangles, given as three vertices each, without small components.
    fn of_large_components(positions: Vec<Vec3>, vertices: &[u32], voxel: f32) -> Self {
        let (positions, triangles, dropped) = without_small(positions, vertices.as_chunks().0.to_vec());
        let normals = normals(&positions, &triangles);
        Self { positions, normals, triangles, voxel, dropped }
    }

    /// Simplifies the surface to at most `triangles` triangles if its shape allows, by collapsing the edges that change
    /// it least (quadric error metrics, Garland and Heckbert 1997, by meshoptimizer). The surface stays closed. A surface with
    /// no more triangles is returned unchanged.
    #[must_use]
    pub fn simplified(self, triangles: usize) -> Self {
        if self.triangles.len() <= triangles {
            return self;
        }
        let vertices: Vec<[f32; 3]> = self.positions.iter().map(Vec3::to_array).collect();
        // Any error is allowed: the number of triangles decides.
        let (indices, options) = (self.triangles.as_flattened(), SimplifyOptions::None);
        let indices = simplify_decoder(indices, &vertices, 3 * triangles, f32::MAX, options, None);
        let surface = Self::of_large_components(self.positions, &indices, self.voxel);
        Self { dropped: self.dropped + surface.dropped, ..surface }
    }

    /// Draws `count` points, evenly by area and at random within triangles, from a fixed seed; none without any area.
    pub fn sample(&self, count: usize) -> Vec<Vec3> {
        let mut total = 0.0;
        let mut ends = Vec::with_capacity(self.triangles.len());
        for [a, b, c] in self.corners() {
            total += f64::from((b - a).cross(c - a).length());
            ends.push(total);
        }
        if total <= 0.0 {
            return Vec::new();
        }
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let point = |i: usize| {
            let place = total * (i as f64 + 0.5) / count as f64;
            let triangle = ends.partition_point(|&end| end <= place).min(ends.len() - 1);
            let [a, b, c] = self.triangles[triangle].map(|vertex| self.positions[vertex as usize]);
            let (u, v) = (rng.random::<f32>().sqrt(), rng.random::<f32>());
            (1.0 - u) * a + u * (1.0 - v) * b + u * v * c
        };
        (0..count).map(point).collect()
    }

    /// Returns the corners of each triangle.
    fn corners(&self) -> impl Iterator<Item = [Vec3; 3]> {
        self.triangles.iter().map(|triangle| triangle.map(|vertex| self.positions[vertex as usize]))
    }
}

/// Returns ½ − opacity of every voxel, negative inside, with a border of empty voxels.
fn padded(grid: &DensityGrid, shape: &RuntimeShape<u32, 3>) -> Vec<f32> {
    const EMPTY: f32 = 0.5;
    let mut values = vec![EMPTY; shape.usize()];
    let row = grid.size.x as usize;
    for (index, row_start) in (0..grid.count()).step_by(row).enumerate() {
        let (y, z) = (index as u32 % grid.size.y, index as u32 / grid.size.y);
        let start = shape.linearize([1, y + 1, z + 1]) as usize;
        for (x, value) in values[start..start + row].iter_mut().enumerate() {
            *value = EMPTY - grid.opacity(row_start + x);
        }
    }
    values
}

/// Fills every voxel that cannot be reached from the border through empty voxels (6-connected).
fn fill_cavities(values: &mut [f32], grid: &DensityGrid) {
    const SOLID: f32 = -0.5;
    let size = (grid.size + 2).to_array().map(|n| n as usize);
    let strides = [1, size[0], size[0] * size[1]];
    let mut outside = vec![false; values.len()];
    outside[0] = true;
    let mut next = vec![0];
    while let Some(cell) = next.pop() {
        for axis in 0..3 {
            let at = cell / strides[axis] % size[axis];
            let before = (at > 0).then(|| cell - strides[axis]);
            let after = (at + 1 < size[axis]).then(|| cell + strides[axis]);
            for neighbour in [before, after].into_iter().flatten() {
                if !outside[neighbour] && values[neighbour] >= 0.0 {
                    outside[neighbour] = true;
                    next.push(neighbour);
                }
            }
        }
    }
    let cavities = values.iter_mut().zip(outside).filter(|(value, outside)| !outside && **value >= 0.0);
    cavities.for_each(|(value, _)| *value = SOLID);
}

/// Averages the normals of each vertex's triangles, weighted by area.
fn normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut normals = vec![Vec3::ZERO; positions.len()];
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| positions[vertex as usize]);
        let twice_area = (b - a).cross(c - a);
        for &vertex in triangle {
            normals[vertex as usize] += twice_area;
        }
    }
    normals.into_iter().map(|normal| normal.normalize_or(Vec3::Z)).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;

    use glam::UVec3;

    use super::*;
    use crate::volume::testing::Ball;

    /// Asserts that triangles traverse every edge in opposite directions, in one pair (or in two where voxels touch at the edge).
    fn assert_closed(surface: &Surface) {
        let mut edges: HashMap<(u32, u32), i32> = HashMap::new();
        for &[a, b, c] in &surface.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *edges.entry((from.min(to), from.max(to))).or_default() += if from < to { 1 } else { -1 };
            }
        }
        assert!(edges.values().all(|&sum| sum == 0));
    }

    fn grid(size: u32, density: impl Fn(UVec3) -> f32) -> DensityGrid {
        let cell = |index: u32| UVec3::new(index % size, index / size % size, index / (size * size));
        let density = (0..size.pow(3)).map(|index| density(cell(index))).collect();
        DensityGrid { origin: Vec3::ZERO, voxel: 1.0, size: UVec3::splat(size), density, level: 1.0 }
    }

    #[test]
    fn a_ball_is_met_within_half_a_voxel() {
        for (resolution, sharpness) in [(24, 10.0), (48, 40.0), (64, 200.0)] {
            let surface = Ball { radius: 1.0, sharpness }.surface(resolution);
            for (p, normal) in surface.positions.iter().zip(&surface.normals) {
                assert!((p.length() - 1.0).abs() < 0.5 * surface.voxel, "{p}");
                assert!(normal.dot(p.normalize()) > 0.9, "{normal} at {p}");
            }
            assert_closed(&surface);
            assert_eq!(surface.dropped, 0);
            // The surface covers all of the sphere: its area is 4πr² to a few per cent.
            let area: f32 = surface.corners().map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum();
            let exact = 4.0 * std::f32::consts::PI;
            assert!((area / exact - 1.0).abs() < 0.04, "{area} for {exact}");
        }
    }

    #[test]
    fn a_simplified_ball_stays_a_ball() {
        let whole = Ball { radius: 1.0, sharpness: 40.0 }.surface(48);
        let before = whole.triangles.len();
        let surface = whole.clone().simplified(before / 10);
        assert!(surface.triangles.len() <= before / 10 && surface.triangles.len() > before / 12);
        assert_eq!(surface.normals.len(), surface.positions.len());
        for p in surface.sample(2000) {
            assert!((p.length() - 1.0).abs() < 0.5 * whole.voxel, "{p}");
        }
        assert_closed(&surface);
        assert_eq!(whole.clone().simplified(before).triangles, whole.triangles);
    }

    #[test]
    fn samples_are_even_by_area() {
        // Two triangles in the plane z = 0, one of three times the other's area.
        let surface = Surface {
            positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::X * 5.0, Vec3::X * 8.0, Vec3::new(5.0, 1.0, 0.0)],
            triangles: vec![[0, 1, 2], [3, 4, 5]],
            ..Surface::default()
        };
        let points = surface.sample(1000);
        assert_eq!(points.len(), 1000);
        assert_eq!(points.iter().filter(|p| p.x <= 1.0).count(), 250);
        assert!(points.iter().all(|p| p.z == 0.0 && p.y >= 0.0 && p.y <= 1.0));
        // The mean of a triangle's points is its centre.
        let mean = points[..250].iter().sum::<Vec3>() / 250.0;
        assert!((mean - Vec3::new(1.0, 1.0, 0.0) / 3.0).length() < 0.05, "{mean}");
        assert_eq!(points, surface.sample(1000));
        assert!(Surface::default().sample(10).is_empty());
    }

    #[test]
    fn matter_at_the_border_is_closed() {
        let surface = Surface::extract(&grid(4, |_| 5.0)).unwrap();
        assert_closed(&surface);
        let [low, high] = [Vec3::min, Vec3::max].map(|pick| surface.positions.iter().copied().reduce(pick).unwrap());
        assert!(low.max_element() < 0.0 && low.min_element() > -1.0, "{low}");
        assert!(high.min_element() > 3.0 && high.max_element() < 4.0, "{high}");
    }

    #[test]
    fn cavities_are_filled_and_bays_are_not() {
        let shell = |cell: UVec3| if (cell.min_element() >= 1) && cell.max_element() <= 7 { 5.0 } else { 0.0 };
        let within = |cell: UVec3| (cell.as_ivec3() - 4).abs().max_element() <= 1;
        let hollow = |cell: UVec3| if within(cell) { 0.0 } else { shell(cell) };
        let solid = Surface::extract(&grid(9, shell)).unwrap();
        let filled = Surface::extract(&grid(9, hollow)).unwrap();
        assert_eq!((solid.positions.len(), solid.triangles.len()), (filled.positions.len(), filled.triangles.len()));
        let tunnel = |cell: UVec3| if cell.x == 4 && cell.y == 4 { 0.0 } else { shell(cell) };
        let bay = Surface::extract(&grid(9, tunnel)).unwrap();
        assert!(bay.triangles.len() > solid.triangles.len());
    }

    #[test]
    fn nothing_dense_enough_is_an_error() {
        let text = Surface::extract(&grid(3, |_| 0.25)).unwrap_err().to_string();
        assert!(text.contains("density 1.000") && text.contains("0.250") && !text.contains('\n'), "{text}");
    }
}
