use glam::Vec3;
use infonerf_scene::{Aabb, Ray, View};
use rayon::prelude::*;

use crate::{Noise, OccupancyConfig};

/// Points at which a field is asked at a time: bounds the memory of an update.
const CHUNK: usize = 1 << 16;
/// Points of a cell at which [`OccupancyGrid::refined`] asks.
const PROBES: usize = 8;

/// Remembers in which cells of the scene's box there is something.
///
/// A cell's density is a decaying maximum of what the field answered at random points of it:
/// d ← max(decay · d, σ(x)), x uniform in the cell. A cell is empty while 1 − exp(−d · step) stays below
/// `alpha_threshold`, or below the opacity of the mean cell while the whole field is still faint. A sample can therefore be
/// dropped wrongly only where the field rises within a cell faster than the updates see it.
#[derive(Clone, Debug)]
pub struct OccupancyGrid {
    config: OccupancyConfig,
    bounds: Aabb,
    cells_per_unit: Vec3,
    density: Vec<f32>,
    occupied: Vec<bool>,
    carved: Vec<bool>,
    asked_before: bool,
    /// The smallest box around all occupied cells.
    tight: Aabb,
}

impl OccupancyGrid {
    /// A grid over `bounds` in which nothing is known to be empty.
    pub fn new(config: &OccupancyConfig, bounds: Aabb) -> Self {
        let cells = config.resolution.pow(3);
        Self {
            config: config.clone(),
            bounds,
            cells_per_unit: config.resolution as f32 / bounds.size(),
            density: vec![0.0; cells],
            occupied: vec![true; cells],
            carved: vec![false; cells],
            asked_before: false,
            tight: bounds,
        }
    }

    /// Marks as empty for good every cell that a view with alpha shows to be background.
    ///
    /// A cell stays if, in every view, any pixel within one pixel of the cell's projected sphere has alpha above 0 or
    /// the cell is out of the picture. Views without alpha carve nothing.
    pub fn carve(&mut self, views: &[View]) {
        let radius = 0.5 * self.cell_size().length();
        let carved: Vec<bool> = (0..self.density.len())
            .into_par_iter()
            .map(|cell| views.iter().any(|view| sees_background(view, self.centre(cell), radius)))
            .collect();
        for ((occupied, known), carved) in self.occupied.iter_mut().zip(&mut self.carved).zip(carved) {
            *known |= carved;
            *occupied &= !*known;
        }
        self.tighten();
    }

    /// Whether an update is due at `step`.
    pub fn is_due(&self, step: usize) -> bool {
        self.config.enabled
            && step >= self.config.warmup
            && (step - self.config.warmup).is_multiple_of(self.config.every)
    }

    /// Asks the field again. `sigma` maps positions `[M, 3]` to densities `[M]`; `step_length` is the length of one
    /// sample's interval. Returns whether anything is left; if nothing is, the grid starts over with all cells open.
    pub fn update(&mut self, noise: Noise, step_length: f32, mut sigma: impl FnMut(&[f32]) -> Vec<f32>) -> bool {
        let open: Vec<usize> = (0..self.density.len()).filter(|&cell| !self.carved[cell]).collect();
        let asked: Vec<usize> = open.iter().copied().filter(|&cell| self.is_asked(cell, noise)).collect();
        for cells in asked.chunks(CHUNK) {
            let points: Vec<f32> = cells.par_iter().flat_map_iter(|&cell| self.random_point(cell, noise, 0)).collect();
            for (&cell, sigma) in cells.iter().zip(sigma(&points)) {
                self.density[cell] = (self.density[cell] * self.config.decay).max(sigma);
            }
        }
        let mean = open.iter().map(|&cell| f64::from(self.density[cell])).sum::<f64>() / open.len().max(1) as f64;
        let threshold = self.config.threshold(step_length).min(mean as f32);
        self.asked_before = true;
        for &cell in &open {
            self.occupied[cell] = self.density[cell] > threshold;
        }
        self.dilate();
        let alive = self.occupied.iter().any(|&occupied| occupied);
        if !alive {
            for &cell in &open {
                self.occupied[cell] = true;
            }
        }
        self.tighten();
        alive
    }

    /// All cells the first time; then half of the occupied ones and an eighth of the others, at random.
    fn is_asked(&self, cell: usize, noise: Noise) -> bool {
        let share = if self.occupied[cell] { 0.5 } else { 0.125 };
        !self.asked_before || noise.uniform(cell, 3) < share
    }

    /// Opens the six neighbours of every occupied cell: a surface moves by less than a cell between updates.
    fn dilate(&mut self) {
        let n = self.config.resolution;
        let before = std::mem::take(&mut self.occupied);
        let carved = &self.carved;
        self.occupied = (0..before.len())
            .into_par_iter()
            .map(|cell| {
                let (x, y, z) = (cell % n, cell / n % n, cell / (n * n));
                let near = (x > 0 && before[cell - 1])
                    || (x + 1 < n && before[cell + 1])
                    || (y > 0 && before[cell - n])
                    || (y + 1 < n && before[cell + n])
                    || (z > 0 && before[cell - n * n])
                    || (z + 1 < n && before[cell + n * n]);
                !carved[cell] && (before[cell] || near)
            })
            .collect();
    }

    /// A grid of `factor` times the resolution, for a field that no longer changes: each part of an occupied cell is asked
    /// at eight random points, and is occupied if one sample at any of them would be as opaque as `alpha_threshold`.
    ///
    /// Finer and not dilated, it follows surfaces more closely, and pictures evaluate fewer samples.
    pub fn refined(
        &self,
        factor: usize,
        noise: Noise,
        step_length: f32,
        mut sigma: impl FnMut(&[f32]) -> Vec<f32>,
    ) -> Self {
        let coarse = self.config.resolution;
        let config = OccupancyConfig { resolution: coarse * factor, ..self.config.clone() };
        let mut fine = Self::new(&config, self.bounds);
        let n = config.resolution;
        let whole =
            |cell: usize| cell % n / factor + coarse * (cell / n % n / factor + coarse * (cell / (n * n) / factor));
        let asked: Vec<usize> = (0..fine.density.len()).filter(|&cell| self.occupied[whole(cell)]).collect();
        for cells in asked.chunks(CHUNK / PROBES) {
            let grid = &fine;
            let of_cell = |&cell: &usize| (0..PROBES).flat_map(move |probe| grid.random_point(cell, noise, probe));
            let points: Vec<f32> = cells.par_iter().flat_map_iter(of_cell).collect();
            for (&cell, sigma) in cells.iter().zip(sigma(&points).chunks_exact(PROBES)) {
                fine.density[cell] = sigma.iter().copied().fold(0.0, f32::max);
            }
        }
        let threshold = self.config.threshold(step_length);
        fine.occupied = fine.density.iter().map(|density| *density > threshold).collect();
        fine.asked_before = true;
        fine.tighten();
        fine
    }

    /// Whether there may be something at `p`. Points outside the box are kept: the grid knows nothing of them.
    pub fn is_occupied(&self, p: Vec3) -> bool {
        self.cell(p).is_none_or(|cell| self.occupied[cell])
    }

    /// Cells along each axis.
    pub fn resolution(&self) -> usize {
        self.config.resolution
    }

    /// The box that is divided into cells.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// A box that holds every occupied cell: outside it, but inside the grid's bounds, there is nothing.
    pub fn tight_bounds(&self) -> Aabb {
        self.tight
    }

    fn tighten(&mut self) {
        let occupied = (0..self.occupied.len()).filter(|&cell| self.occupied[cell]).map(|cell| self.coordinates(cell));
        let corners = occupied.fold(None, |corners: Option<(Vec3, Vec3)>, cell| {
            let (low, high) = corners.unwrap_or((cell, cell));
            Some((low.min(cell), high.max(cell)))
        });
        self.tight = corners.map_or(self.bounds, |(low, high)| Aabb {
            min: self.bounds.min + low * self.cell_size(),
            max: self.bounds.min + (high + 1.0) * self.cell_size(),
        });
    }

    /// The remembered density at `p` if there may be something, else none. Outside the box it is 0.
    pub fn occupied_density(&self, p: Vec3) -> Option<f32> {
        match self.cell(p) {
            Some(cell) => self.occupied[cell].then(|| self.density[cell]),
            None => Some(0.0),
        }
    }

    /// The mean of what is remembered along `ray` from `near` to `far`, if there may be something anywhere between; looked
    /// up at least once a cell's width. Outside the box it is 0.
    pub fn density_between(&self, ray: &Ray, near: f32, far: f32) -> Option<f32> {
        let looks = ((far - near) / self.cell_size().min_element()).ceil().max(1.0);
        let at = |i: usize| ray.at(near + (far - near) * (i as f32 + 0.5) / looks);
        let seen = (0..looks as usize).filter_map(|i| self.occupied_density(at(i)));
        let (count, sum) = seen.fold((0, 0.0), |(count, sum), density| (count + 1, sum + density));
        (count > 0).then(|| sum / looks)
    }

    /// Variance along an axis of a point that is anywhere in a cell, the mean of the three, scene units².
    pub fn cell_variance(&self) -> f32 {
        self.cell_size().length_squared() / (3.0 * 12.0)
    }

    /// Share of the cells that are not known to be empty.
    pub fn fraction(&self) -> f64 {
        self.occupied.iter().filter(|&&occupied| occupied).count() as f64 / self.occupied.len() as f64
    }

    /// What a checkpoint has to keep: density and occupancy of each cell, x fastest.
    pub fn state(&self) -> (&[f32], &[bool]) {
        (&self.density, &self.occupied)
    }

    /// Puts a checkpoint's state back.
    ///
    /// # Errors
    /// Gives the expected number of cells if the state is of another size.
    pub fn restore(&mut self, density: Vec<f32>, occupied: Vec<bool>) -> Result<(), usize> {
        if density.len() != self.density.len() || occupied.len() != self.occupied.len() {
            return Err(self.density.len());
        }
        self.asked_before = density.iter().any(|d| *d > 0.0);
        (self.density, self.occupied) = (density, occupied);
        self.tighten();
        Ok(())
    }

    fn cell_size(&self) -> Vec3 {
        self.bounds.size() / self.config.resolution as f32
    }

    fn coordinates(&self, cell: usize) -> Vec3 {
        let n = self.config.resolution;
        Vec3::new((cell % n) as f32, (cell / n % n) as f32, (cell / (n * n)) as f32)
    }

    fn centre(&self, cell: usize) -> Vec3 {
        self.bounds.min + (self.coordinates(cell) + 0.5) * self.cell_size()
    }

    /// The `index`th random point of a cell.
    fn random_point(&self, cell: usize, noise: Noise, index: usize) -> [f32; 3] {
        let jitter = Vec3::from_array([0, 1, 2].map(|axis| noise.uniform(cell, 4 * index + axis)));
        (self.bounds.min + (self.coordinates(cell) + jitter) * self.cell_size()).to_array()
    }

    fn cell(&self, p: Vec3) -> Option<usize> {
        let n = self.config.resolution;
        let c = (p - self.bounds.min) * self.cells_per_unit;
        // Written so that NaN is outside.
        let inside = c.cmpge(Vec3::ZERO).all() && c.cmplt(Vec3::splat(n as f32)).all();
        inside.then(|| c.x as usize + n * (c.y as usize + n * c.z as usize))
    }
}

/// Whether every pixel that a sphere touches in `view` is fully transparent.
fn sees_background(view: &View, centre: Vec3, radius: f32) -> bool {
    let (Some(alpha), Some(pixel)) = (&view.image.alpha, view.camera.project(centre)) else { return false };
    let distance = (centre - view.camera.position()).dot(view.camera.forward());
    if distance <= radius {
        return false;
    }
    let reach = view.camera.fx.max(view.camera.fy) as f32 * radius / (distance - radius) + 1.0;
    let (width, height) = (view.image.width as f32, view.image.height as f32);
    if pixel.x < -reach || pixel.y < -reach || pixel.x > width + reach || pixel.y > height + reach {
        return false;
    }
    let span = |c: f32, size: f32| (c - reach).max(0.0) as usize..((c + reach).ceil().clamp(0.0, size) as usize);
    span(pixel.y, height).all(|y| span(pixel.x, width).all(|x| alpha[y * view.image.width as usize + x] == 0.0))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Stream;

    fn config() -> OccupancyConfig {
        OccupancyConfig {
            enabled: true,
            resolution: 16,
            warmup: 10,
            every: 4,
            alpha_threshold: 0.01,
            decay: 0.9,
            refine: 1,
            carve: false,
        }
    }

    #[test]
    fn keeps_a_ball_and_drops_the_rest() {
        let mut grid = OccupancyGrid::new(&config(), Aabb::cube(Vec3::ZERO, 1.0));
        let ball = |points: &[f32]| -> Vec<f32> {
            points.chunks(3).map(|p| if Vec3::from_slice(p).length() < 0.5 { 20.0 } else { 0.0 }).collect()
        };
        assert_eq!(grid.fraction(), 1.0);
        for step in 0..8 {
            assert!(grid.update(Noise::new(0, step, Stream::Occupancy), 0.02, ball));
        }
        assert!(grid.is_occupied(Vec3::ZERO) && grid.is_occupied(Vec3::new(0.45, 0.0, 0.0)));
        assert!(!grid.is_occupied(Vec3::splat(0.9)));
        assert!(grid.is_occupied(Vec3::splat(7.0)), "outside nothing is known");
        assert!(grid.is_occupied(Vec3::splat(f32::NAN)));
        assert!(grid.fraction() < 0.2);
    }

    proptest! {
        /// With a field that is even within each cell, no sample is dropped whose alpha reaches `alpha_threshold`.
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
                grid.update(Noise::new(seed, update, Stream::Occupancy), step, |points| {
                    points.chunks(3).map(|p| sigma(Vec3::from_slice(p))).collect()
                });
                let p = Vec3::from(at);
                let alpha = -(-sigma(p) * step).exp_m1();
                prop_assert!(alpha < alpha_threshold * (1.0 + 1e-5) || grid.is_occupied(p), "alpha {alpha} was dropped");
            }
        }
    }

    #[test]
    fn an_empty_field_reopens_everything() {
        let mut grid = OccupancyGrid::new(&config(), Aabb::cube(Vec3::ZERO, 1.0));
        assert!(!grid.update(Noise::new(0, 0, Stream::Occupancy), 0.02, |points| vec![0.0; points.len() / 3]));
        assert_eq!(grid.fraction(), 1.0);
    }

    /// A wall thinner than an interval: its middle is in the empty, the interval is not.
    #[test]
    fn an_interval_is_kept_for_any_part_of_it() {
        let mut grid = OccupancyGrid::new(&config(), Aabb::cube(Vec3::ZERO, 1.0));
        let wall = |points: &[f32]| -> Vec<f32> {
            points.chunks(3).map(|p| if p[0] > 0.5 && p[0] < 0.625 { 20.0 } else { 0.0 }).collect()
        };
        assert!(grid.update(Noise::new(0, 0, Stream::Occupancy), 0.02, wall));
        let ray = Ray::new(Vec3::new(-1.0, 0.1, 0.1), Vec3::X);
        assert_eq!(grid.occupied_density(ray.at(1.0)), None);
        // One of the sixteen cells is the wall.
        let mean = grid.density_between(&ray, 0.0, 2.0).unwrap();
        assert!((mean - 20.0 / 16.0).abs() < 1e-4, "{mean}");
        assert_eq!(grid.density_between(&ray, 0.0, 1.0), None);
        assert_eq!(grid.density_between(&ray, 1.56, 1.56), Some(20.0), "at least one look");
        assert_eq!(grid.density_between(&ray, 3.0, 4.0), Some(0.0), "outside nothing is known");
    }

    #[test]
    fn is_due_after_the_warmup() {
        let grid = OccupancyGrid::new(&config(), Aabb::cube(Vec3::ZERO, 1.0));
        let due: Vec<usize> = (0..20).filter(|&step| grid.is_due(step)).collect();
        assert_eq!(due, [10, 14, 18]);
    }
}
