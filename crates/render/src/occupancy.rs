//! Occupancy grid, which records the cells of space that are empty.

use std::sync::OnceLock;

use burn::tensor::{Device, Tensor};
use glam::Vec3;
use infonerf_ops::sampling::march::Cells;
use infonerf_ops::upload;
use infonerf_scene::{Aabb, Ray};
use rayon::prelude::*;

use crate::cell_state::{CellState, cell_states, widen};
use crate::config::OccupancyConfig;
use crate::noise::Noise;

/// Maximal number of points evaluated at a time, which bounds the memory of an update.
const CHUNK: usize = 1 << 16;
/// Number of points of a cell at which [`OccupancyGrid::refined`] evaluates the field.
const PROBES: usize = 8;

/// Occupancy grid: empty and occupied cells of the scene's box.
///
/// A cell's density is a decaying maximum of the field's density at random points in it:
/// d ← max(decay · d, σ(x)), x uniform in the cell. A cell is empty while 1 − exp(−d · step) stays below
/// `alpha_threshold`, or below the opacity of the mean cell while the whole field is still faint. A sample is
/// dropped wrongly only if the field varies within a cell and the random points miss its maximum.
#[derive(Clone, Debug)]
pub struct OccupancyGrid {
    config: OccupancyConfig,
    bounds: Aabb,
    cells_per_unit: Vec3,
    density: Vec<f32>,
    occupied: Vec<bool>,
    updated: bool,
    /// The smallest box around all occupied cells.
    pub(crate) tight: Aabb,
    states: Vec<CellState>,
    /// Density of each cell on the first GPU that asked for it; −1 marks an empty cell.
    on_device: OnceLock<Tensor<1>>,
}

impl OccupancyGrid {
    /// Returns a grid over `bounds` with all cells occupied.
    pub fn new(config: &OccupancyConfig, bounds: Aabb) -> Self {
        let cells = config.resolution.pow(3);
        Self {
            config: config.clone(),
            bounds,
            cells_per_unit: config.resolution as f32 / bounds.size(),
            density: vec![0.0; cells],
            occupied: vec![true; cells],
            updated: false,
            tight: bounds,
            states: vec![CellState::UNKNOWN; cells],
            on_device: OnceLock::new(),
        }
    }

    /// Returns whether training uses the grid in `step`: from its first update, after the warm-up, on.
    pub fn is_used_in(&self, step: usize) -> bool {
        step >= self.config.warmup
    }

    /// Whether an update is due at `step`.
    pub fn is_due(&self, step: usize) -> bool {
        let OccupancyConfig { enabled, warmup, every, .. } = self.config;
        enabled && step >= warmup && (step - warmup).is_multiple_of(every)
    }

    /// Updates densities and occupancy. `sigma` maps positions `[M, 3]` to densities `[M]`; `step_length` is the length
    /// of a sample's interval. If no cell is occupied then, all cells are marked as occupied.
    pub fn update(&mut self, noise: Noise, step_length: f32, mut sigma: impl FnMut(Vec<f32>) -> Vec<f32>) {
        let cells = 0..self.density.len();
        let evaluated: Vec<usize> = cells.into_par_iter().filter(|&cell| self.is_evaluated(cell, noise)).collect();
        for cells in evaluated.chunks(CHUNK) {
            let points: Vec<f32> = cells.par_iter().flat_map_iter(|&cell| self.random_point(cell, noise, 0)).collect();
            for (&cell, sigma) in cells.iter().zip(sigma(points)) {
                self.density[cell] = (self.density[cell] * self.config.decay).max(sigma);
            }
        }
        let threshold = self.config.threshold(step_length).min(self.mean_density());
        self.updated = true;
        self.occupied = self.density.iter().map(|density| *density > threshold).collect();
        self.dilate();
        if !self.occupied.contains(&true) {
            self.occupied.fill(true);
        }
        self.derive(None);
    }

    fn mean_density(&self) -> f32 {
        (self.density.iter().map(|density| f64::from(*density)).sum::<f64>() / self.density.len() as f64) as f32
    }

    /// Returns whether an update evaluates a cell: all at first, then at random half of the occupied and an eighth of the others.
    fn is_evaluated(&self, cell: usize, noise: Noise) -> bool {
        let share = if self.occupied[cell] { 0.5 } else { 0.125 };
        !self.updated || noise.uniform(cell, 3) < share
    }

    /// Marks the six neighbours of every occupied cell: a surface moves by less than a cell between updates.
    fn dilate(&mut self) {
        let n = self.config.resolution;
        let before = std::mem::take(&mut self.occupied);
        let dilated = |cell: usize| {
            let is_near = |stride: usize| {
                let along = cell / stride % n;
                (along > 0 && before[cell - stride]) || (along + 1 < n && before[cell + stride])
            };
            before[cell] || [1, n, n * n].into_iter().any(is_near)
        };
        self.occupied = (0..before.len()).into_par_iter().map(dilated).collect();
    }

    /// Returns a grid of `factor` times the resolution for pictures: each part of an occupied cell is evaluated at
    /// eight random points, and is occupied if the opacity of a sample at any of them reaches `alpha_threshold`.
    ///
    /// The refined grid is not dilated, and follows surfaces more closely. As in [`Self::update`], the threshold of a
    /// faint field is relative: half the density of the mean cell, because the occupied cells of training are dilated.
    pub fn refined(&self, factor: usize, noise: Noise, step: f32, mut sigma: impl FnMut(Vec<f32>) -> Vec<f32>) -> Self {
        let threshold = self.config.threshold(step).min(0.5 * self.mean_density());
        let coarse = self.config.resolution;
        let config = OccupancyConfig { resolution: coarse * factor, ..self.config.clone() };
        let mut fine = Self::new(&config, self.bounds);
        let n = config.resolution;
        let whole = |c: usize| c % n / factor + coarse * (c / n % n / factor + coarse * (c / (n * n) / factor));
        let evaluated: Vec<usize> = (0..fine.density.len()).filter(|&cell| self.occupied[whole(cell)]).collect();
        for cells in evaluated.chunks(CHUNK / PROBES) {
            let grid = &fine;
            let of_cell = |&cell: &usize| (0..PROBES).flat_map(move |probe| grid.random_point(cell, noise, probe));
            let points: Vec<f32> = cells.par_iter().flat_map_iter(of_cell).collect();
            for (&cell, sigma) in cells.iter().zip(sigma(points).chunks_exact(PROBES)) {
                fine.density[cell] = sigma.iter().copied().fold(0.0, f32::max);
            }
        }
        fine.occupied = fine.density.iter().map(|density| *density > threshold).collect();
        fine.updated = true;
        let mut nearby = fine.density.clone();
        widen(&mut nearby, n);
        fine.derive(Some(&nearby));
        fine
    }

    /// Whether the cell at `p` is occupied; true outside the box.
    pub fn is_occupied(&self, p: Vec3) -> bool {
        self.occupied_density(p).is_some()
    }

    /// Returns the number of cells along each axis.
    pub fn resolution(&self) -> usize {
        self.config.resolution
    }

    /// Returns the box that is divided into cells.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    pub(crate) fn cells_along(&self, displacement: Vec3) -> Vec3 {
        displacement * self.cells_per_unit
    }

    /// Returns the states of the cells at `N` points, given by their axes.
    #[inline(always)]
    pub(crate) fn states_at<const N: usize>(&self, points: [[f32; N]; 3]) -> [CellState; N] {
        self.cells_at(points).map(|cell| self.states.get(cell as usize).copied().unwrap_or(CellState::UNKNOWN))
    }

    /// Computes the box of the occupied cells and the state of each cell, which includes the density `nearby` if it is given.
    fn derive(&mut self, nearby: Option<&[f32]>) {
        self.on_device = OnceLock::new();
        let occupied = (0..self.occupied.len()).filter(|&cell| self.occupied[cell]).map(|cell| self.coordinates(cell));
        let corner = |cells: Vec3| self.bounds.min + cells * self.cell_size();
        let tight =
            Aabb::containing(occupied).map(|Aabb { min, max }| Aabb { min: corner(min), max: corner(max + 1.0) });
        self.tight = tight.unwrap_or(self.bounds);
        self.states = cell_states(self.config.resolution, &self.occupied, nearby);
    }

    /// Returns the density of the cell at `p`; `None` if it is empty, 0 outside the box.
    pub(crate) fn occupied_density(&self, p: Vec3) -> Option<f32> {
        let [cell] = self.cells_at(p.to_array().map(|x| [x])).map(|cell| cell as usize);
        self.occupied.get(cell).map_or(Some(0.0), |occupied| occupied.then(|| self.density[cell]))
    }

    /// Returns the mean density along `ray` from `near` to `far`, looked up at least once per cell width; `None` if all
    /// cells are empty. Outside the box it is 0.
    pub(crate) fn density_between(&self, ray: &Ray, near: f32, far: f32) -> Option<f32> {
        let lookups = ((far - near) / self.cell_size().min_element()).ceil().max(1.0);
        let at = |i: usize| ray.at(near + (far - near) * (i as f32 + 0.5) / lookups);
        let seen = (0..lookups as usize).filter_map(|i| self.occupied_density(at(i)));
        let (count, sum) = seen.fold((0, 0.0), |(count, sum), density| (count + 1, sum + density));
        (count > 0).then(|| sum / lookups)
    }

    /// Uploads the grid to `device`; cached until the grid changes.
    pub(crate) fn cells_on(&self, device: &Device) -> Cells {
        let moved = || {
            let known = self.density.iter().zip(&self.occupied);
            let density = known.map(|(density, occupied)| if *occupied { *density } else { -1.0 }).collect();
            upload(density, [self.density.len()], device)
        };
        let kept = self.on_device.get_or_init(moved);
        Cells {
            density: if kept.device() == *device { kept.clone() } else { moved() },
            resolution: self.config.resolution,
            corner: self.bounds.min.to_array(),
            per_unit: self.cells_per_unit.to_array(),
        }
    }

    /// Returns the variance per axis of a uniform point in a cell, mean of the three axes, scene units².
    pub fn cell_variance(&self) -> f32 {
        self.cell_size().length_squared() / (3.0 * 12.0)
    }

    /// Returns what a checkpoint keeps: the density and occupancy of each cell, x fastest, and whether there was an update.
    pub fn state(&self) -> (&[f32], &[bool], bool) {
        (&self.density, &self.occupied, self.updated)
    }

    /// Restores the [state](Self::state) that a checkpoint kept.
    ///
    /// # Errors
    /// The expected number of cells, if the state has another size.
    pub fn restore(&mut self, density: Vec<f32>, occupied: Vec<bool>, updated: bool) -> Result<(), usize> {
        if density.len() != self.density.len() || occupied.len() != self.occupied.len() {
            return Err(self.density.len());
        }
        (self.density, self.occupied, self.updated) = (density, occupied, updated);
        self.derive(None);
        Ok(())
    }

    fn cell_size(&self) -> Vec3 {
        self.bounds.size() / self.config.resolution as f32
    }

    fn coordinates(&self, cell: usize) -> Vec3 {
        let n = self.config.resolution;
        Vec3::new((cell % n) as f32, (cell / n % n) as f32, (cell / (n * n)) as f32)
    }

    fn random_point(&self, cell: usize, noise: Noise, index: usize) -> [f32; 3] {
        let jitter = Vec3::from_array([0, 1, 2].map(|axis| noise.uniform(cell, 4 * index + axis)));
        (self.bounds.min + (self.coordinates(cell) + jitter) * self.cell_size()).to_array()
    }

    /// Returns the cells at `N` points, given by their axes; `u32::MAX` outside the box.
    #[inline(always)]
    fn cells_at<const N: usize>(&self, [x, y, z]: [[f32; N]; 3]) -> [u32; N] {
        let (n, low, per_unit) = (self.config.resolution, self.bounds.min, self.cells_per_unit);
        // SAFETY: the number lies between 0 and `n`; of NaN and 0, `max` takes 0.
        #[allow(unsafe_code, reason = "a checked conversion is not vectorised")]
        let whole = |cell: f32| unsafe { cell.max(0.0).min(n as f32).to_int_unchecked::<i32>() } as u32;
        // Both comparisons are false for NaN, which is thus outside.
        let inside = |cell: f32| (cell >= 0.0) & (cell < n as f32);
        let mut cells = [0; N];
        for i in 0..N {
            let (x, y, z) = ((x[i] - low.x) * per_unit.x, (y[i] - low.y) * per_unit.y, (z[i] - low.z) * per_unit.z);
            let cell = whole(x) + n as u32 * (whole(y) + n as u32 * whole(z));
            cells[i] = if inside(x) & inside(y) & inside(z) { cell } else { u32::MAX };
        }
        cells
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::noise::RandomStream;

    fn config() -> OccupancyConfig {
        OccupancyConfig { enabled: true, resolution: 16, warmup: 10, every: 4, ..OccupancyConfig::default() }
    }

    fn grid() -> OccupancyGrid {
        OccupancyGrid::new(&config(), Aabb::cube(Vec3::ZERO, 1.0))
    }

    fn fraction(grid: &OccupancyGrid) -> f64 {
        grid.occupied.iter().filter(|&&occupied| occupied).count() as f64 / grid.occupied.len() as f64
    }

    fn noise(step: u64) -> Noise {
        Noise::new(0, step, RandomStream::Occupancy)
    }

    fn densities(sigma: impl Fn(Vec3) -> f32) -> impl Fn(Vec<f32>) -> Vec<f32> {
        move |points| points.chunks(3).map(|p| sigma(Vec3::from_slice(p))).collect()
    }

    #[test]
    fn keeps_a_ball_and_drops_the_rest() {
        let (mut grid, ball) = (grid(), densities(|p| if p.length() < 0.5 { 20.0 } else { 0.0 }));
        assert_eq!(fraction(&grid), 1.0);
        for step in 0..8 {
            grid.update(noise(step), 0.02, &ball);
        }
        assert!(grid.is_occupied(Vec3::ZERO) && grid.is_occupied(Vec3::new(0.45, 0.0, 0.0)));
        assert!(!grid.is_occupied(Vec3::splat(0.9)));
        let distance = |p: Vec3| grid.states_at(p.to_array().map(|x| [x]))[0].distance();
        assert!(distance(Vec3::splat(0.9)) > 1 && distance(Vec3::ZERO) == 0);
        assert!(grid.is_occupied(Vec3::splat(7.0)), "outside nothing is known");
        assert!(grid.is_occupied(Vec3::splat(f32::NAN)));
        let (share, mut asked) = (fraction(&grid), 0);
        assert!(share < 0.2);
        grid.update(noise(8), 0.02, |points| {
            asked += points.len() / 3;
            ball(points)
        });
        let expected = 4096.0 * (0.5 * share + 0.125 * (1.0 - share));
        assert!((asked as f64 - expected).abs() < 100.0, "{asked} cells are evaluated, {expected} expected");
    }

    /// Checks that an occupied cell marks its six neighbours, or the three that it has in a corner, and no others.
    #[test]
    fn occupied_cells_mark_their_neighbours() {
        for (centre, marked) in [(0.0625, 7.0), (-0.9375, 4.0), (0.9375, 4.0)] {
            let (mut grid, centre) = (grid(), Vec3::splat(centre));
            let is_inside = |p: Vec3| (p - centre).abs().max_element() < 0.0625;
            grid.update(noise(0), 0.02, densities(|p| if is_inside(p) { 20.0 } else { 0.0 }));
            assert_eq!(fraction(&grid), marked / 4096.0);
            let inwards = 0.125 * if centre.x > 0.0 { -1.0 } else { 1.0 };
            for axis in Vec3::AXES {
                assert!(grid.is_occupied(centre + inwards * axis), "{axis}");
                let away = centre + 5.0 * inwards * axis;
                assert_eq!(grid.states_at(away.to_array().map(|x| [x]))[0].distance(), 4, "{axis}");
            }
        }
    }

    proptest! {
        /// With a field that is constant within each cell, no sample is dropped whose alpha reaches `alpha_threshold`.
        #[test]
        fn no_sample_above_the_bound_is_dropped(
            seed in any::<u64>(),
            alpha_threshold in 1e-4f32..0.5,
            step in 1e-3f32..0.5,
            logs in prop::collection::vec(-6f32..3.0, 64),
            at in prop::array::uniform3(-0.999f32..0.999),
        ) {
            let config = OccupancyConfig { resolution: 4, alpha_threshold, ..config() };
            let mut grid = OccupancyGrid::new(&config, Aabb::cube(Vec3::ZERO, 1.0));
            let cell = |p: Vec3| {
                let c = ((p + 1.0) * 2.0).clamp(Vec3::ZERO, Vec3::splat(3.0));
                c.x as usize + 4 * (c.y as usize + 4 * c.z as usize)
            };
            let sigma = |p: Vec3| 10f32.powf(logs[cell(p)]);
            for update in 0..3 {
                grid.update(Noise::new(seed, update, RandomStream::Occupancy), step, densities(sigma));
                let p = Vec3::from(at);
                let alpha = -(-sigma(p) * step).exp_m1();
                prop_assert!(alpha < alpha_threshold * (1.0 + 1e-5) || grid.is_occupied(p), "alpha {alpha} was dropped");
            }
        }

        /// Every sample that is skipped lies in an empty cell.
        #[test]
        fn no_occupied_cell_is_within_the_distance(
            seed in any::<u64>(),
            share in 0.0f32..0.02,
            from in prop::array::uniform3(-1f32..1.0),
            to in prop::array::uniform3(-1f32..1.0),
        ) {
            let mut grid = OccupancyGrid::new(&config(), Aabb { min: Vec3::NEG_ONE, max: Vec3::new(1.0, 3.0, 2.0) });
            let noise = Noise::new(seed, 0, RandomStream::Occupancy);
            let occupied: Vec<bool> = (0..grid.occupied.len()).map(|cell| noise.uniform(cell, 0) < share).collect();
            let cells = occupied.len();
            grid.restore(vec![1.0; cells], occupied, true).unwrap();
            let direction = (Vec3::from(to) - Vec3::from(from)).normalize_or(Vec3::X);
            let ray = Ray::new(Vec3::from(from), direction);
            let distance = grid.states_at(ray.origin.to_array().map(|x| [x]))[0].distance();
            let pace = grid.cells_along(ray.direction).abs().max_element();
            let reach = 0.999 * f32::from(distance.saturating_sub(1)) / pace;
            for i in 0..=100 {
                let p = ray.at(reach * i as f32 / 100.0);
                prop_assert!(distance == 0 || grid.occupied_density(p) != Some(1.0));
            }
        }
    }

    /// Fog of which no single sample reaches the threshold, thicker towards one side.
    #[test]
    fn refined_grid_keeps_faint_fog() {
        let (step, threshold) = (0.02, config().threshold(0.02));
        // The opacity of a sample at the threshold is 0.01.
        approx::assert_relative_eq!(threshold, 0.502_516_8, max_relative = 1e-5);
        let thicker = Vec3::new(1.0, 0.7, -0.4);
        let (mut grid, fog) = (grid(), densities(|p| threshold * (0.9 + 0.04 * p.dot(thicker))));
        grid.update(noise(0), step, &fog);
        let refined = grid.refined(2, Noise::new(0, 0, RandomStream::RefinedOccupancy), step, fog);
        assert!((0.5..0.65).contains(&fraction(&grid)), "{}", fraction(&grid));
        for index in 0..1000 {
            let p = Vec3::from_array([0, 1, 2].map(|axis| 2.0 * noise(1).uniform(index, axis) - 1.0));
            assert_eq!(refined.is_occupied(p), grid.is_occupied(p), "{p}");
        }
    }

    /// Checks that a restored grid evaluates the same cells as the original, also after an update that found nothing.
    #[test]
    fn restored_grid_evaluates_the_same_cells() {
        let [mut first, mut second] = [grid(), grid()];
        first.update(noise(0), 0.02, densities(|_| 0.0));
        assert_eq!(fraction(&first), 1.0, "an empty field reopens everything");
        let (density, occupied, updated) = first.state();
        second.restore(density.to_vec(), occupied.to_vec(), updated).unwrap();
        let asked = [first, second].map(|mut grid| {
            let mut asked = Vec::new();
            grid.update(noise(1), 0.02, |points| {
                asked.extend_from_slice(&points);
                vec![0.0; points.len() / 3]
            });
            asked
        });
        assert_eq!(asked[0], asked[1]);
    }

    /// Checks intervals that contain a thin wall, while their midpoint lies in an empty cell.
    #[test]
    fn intervals_with_an_occupied_part_are_kept() {
        let mut grid = grid();
        grid.update(noise(0), 0.02, densities(|p| if p.x > 0.5 && p.x < 0.625 { 20.0 } else { 0.0 }));
        let ray = Ray::new(Vec3::new(-1.0, 0.1, 0.1), Vec3::X);
        assert_eq!(grid.occupied_density(ray.at(1.0)), None);
        assert_eq!(fraction(&grid), 3.0 / 16.0, "the wall and the cells next to it");
        // One of the sixteen cells is the wall.
        let mean = grid.density_between(&ray, 0.0, 2.0).unwrap();
        assert!((mean - 20.0 / 16.0).abs() < 1e-4, "{mean}");
        assert_eq!(grid.density_between(&ray, 0.0, 1.0), None);
        assert_eq!(grid.density_between(&ray, 1.56, 1.56), Some(20.0), "at least one look");
        assert_eq!(grid.density_between(&ray, 3.0, 4.0), Some(0.0), "outside nothing is known");
        let (density, occupied, _) = grid.state();
        let (density, occupied) = (density.to_vec(), occupied.to_vec());
        grid.restore(density, occupied, false).unwrap();
        grid.update(noise(1), 0.02, densities(|_| 0.0));
        assert_eq!(grid.density_between(&ray, 1.56, 1.56), Some(20.0 * 0.8), "densities decay");
        assert_eq!(fraction(&grid), 3.0 / 16.0);
    }

    #[test]
    fn points_of_a_cell_have_the_variance_of_a_uniform_distribution() {
        let grid = OccupancyGrid::new(&config(), Aabb { min: Vec3::ZERO, max: 16.0 * Vec3::new(1.0, 2.0, 3.0) });
        approx::assert_relative_eq!(grid.cell_variance(), (1.0 + 4.0 + 9.0) / 36.0, max_relative = 1e-6);
    }

    #[test]
    fn is_due_after_the_warmup() {
        let due: Vec<usize> = (0..20).filter(|&step| grid().is_due(step)).collect();
        assert_eq!(due, [10, 14, 18]);
    }
}
