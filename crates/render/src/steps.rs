//! Steps of one length along a ray.

use std::ops::Range;

use glam::Vec3;
use infonerf_scene::Ray;

use crate::cell_state::CellState;
use crate::occupancy::OccupancyGrid;
use crate::renderer::Renderer;
use crate::warp::WarpedRay;

/// Number of steps whose cells are looked up at a time, so that their arithmetic shares vector registers.
const BLOCK: usize = 8;

/// Samples along a ray, front to back: steps of one length, without those in empty cells of a grid. Two or four steps
/// share one sample where [`Self::join`] allows it.
#[derive(Clone, Debug)]
pub(crate) struct UniformSteps<'a> {
    /// The ray in the space of the grid.
    line: WarpedRay<'a>,
    grid: Option<&'a OccupancyGrid>,
    /// Number of steps in which the ray passes at most one cell of the grid along each axis.
    steps_per_cell: f32,
    /// Coordinate where the first step begins.
    near: f32,
    /// Length of a step, in coordinates.
    length: f32,
    /// Position of the sample within a step, 0 to 1.
    shift: f32,
    /// States of cells: two steps share one sample if both are below the first, four steps if all are below the second.
    joined: [CellState; 2],
    block: Block,
    next: usize,
    last: usize,
}

/// A sample along a ray.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Step {
    /// Distance along the ray.
    pub(crate) t: f32,
    /// Length of the sample's interval, in coordinates.
    pub(crate) delta: f32,
    /// Point at which a field is evaluated.
    pub(crate) point: Vec3,
}

/// Distances and axes of the points of consecutive steps, and the states of their cells.
#[derive(Clone, Debug)]
struct Block {
    range: Range<usize>,
    t: [f32; BLOCK],
    points: [[f32; BLOCK]; 3],
    states: [CellState; BLOCK],
}

impl<'a> UniformSteps<'a> {
    /// Returns the steps between `ends`, coordinates of near and far, each at most `step` long and with its sample at the share
    /// `shift` of it. If `renderer` clips rays to the grid's box, steps before and behind all occupied cells are left out.
    pub(crate) fn new(
        renderer: &'a Renderer,
        ray: &Ray,
        [near, far]: [f32; 2],
        (step, shift): (f32, f32),
        grid: Option<&'a OccupancyGrid>,
    ) -> Self {
        let joined = [CellState::of_density(0.0); 2];
        let count = ((far - near) / step).ceil().max(1.0);
        let length = (far - near) / count;
        let (line, last) = (renderer.warp.along(ray), count as usize);
        let block = Block { range: 0..0, t: [0.0; BLOCK], points: [[0.0; BLOCK]; 3], states: [joined[0]; BLOCK] };
        let all = Self { line, grid, steps_per_cell: 0.0, near, length, shift, joined, block, next: 0, last };
        let Some(grid) = grid else { return all };
        // The factor 0.999 allows for the rounding of cells and steps.
        let steps_per_cell = 0.999 / grid.cells_along(line.max_speed([near, far]) * length).max_element();
        let all = Self { steps_per_cell, ..all };
        if renderer.clip.is_none() {
            return all;
        }
        let Some((enter, leave)) = grid.tight.intersect(ray) else { return Self { last: 0, ..all } };
        let index = |t: f32| ((t - near) / length).max(0.0);
        let (first, last) = (index(enter).floor() as usize, index(leave).ceil() as usize + 1);
        Self { next: first.saturating_sub(1), last: last.min(all.last), ..all }
    }

    /// Lets two steps of optical depths below `depths[0]` share one sample from here on, and four below `depths[1]`.
    pub(crate) fn join(&mut self, depths: [f32; 2]) {
        self.joined = depths.map(|depth| CellState::of_density(depth / self.length));
    }

    /// Returns the distances and the axes of the points of `N` steps from `first` on, which may lie between two steps.
    #[inline]
    fn points<const N: usize>(&self, first: f32) -> ([f32; N], [[f32; N]; 3]) {
        self.line.points(std::array::from_fn(|ahead| self.near + (first + ahead as f32 + self.shift) * self.length))
    }

    /// Returns the sample of step `at`, which may lie between two steps, with an interval of `count` steps.
    #[inline]
    fn step(&self, at: f32, count: usize) -> Step {
        let ([t], point) = self.points(at);
        Step { t, delta: count as f32 * self.length, point: point.map(|[x]| x).into() }
    }

    /// Returns the sample of step `index`, one of the next four, and the state of its cell, looked up with those that follow.
    #[inline]
    fn look_up(&mut self, grid: &OccupancyGrid, index: usize) -> (Step, CellState) {
        if !self.block.range.contains(&index) {
            let (t, points) = self.points(self.next as f32);
            self.block = Block { range: self.next..self.next + BLOCK, t, points, states: grid.states_at(points) };
        }
        let place = index - self.block.range.start;
        let point = self.block.points.map(|axis| axis[place]).into();
        (Step { t: self.block.t[place], delta: self.length, point }, self.block.states[place])
    }

    /// Returns how many steps, from the next one on, share a sample; `first` is the state of the next step's cell.
    fn joined_steps(&mut self, grid: &OccupancyGrid, first: CellState) -> usize {
        let ([two, four], left) = (self.joined, self.last - self.next);
        let mut thin = |ahead: usize, most: CellState| self.look_up(grid, self.next + ahead).1 < most;
        match left {
            4.. if first < four && (1..4).all(|ahead| thin(ahead, four)) => 4,
            2.. if first < two && thin(1, two) => 2,
            _ => 1,
        }
    }
}

impl Iterator for UniformSteps<'_> {
    type Item = Step;

    fn next(&mut self) -> Option<Step> {
        while self.next < self.last {
            let at = self.next;
            let Some(grid) = self.grid else {
                self.next += 1;
                return Some(self.step(at as f32, 1));
            };
            let (step, state) = self.look_up(grid, at);
            if let Some(away) = state.distance().checked_sub(1) {
                // Many steps through wide empty space are skipped at a time.
                self.next += 1 + (f32::from(away) * self.steps_per_cell) as usize;
                continue;
            }
            let count = self.joined_steps(grid, state);
            self.next += count;
            return Some(if count == 1 { step } else { self.step(at as f32 + 0.5 * (count - 1) as f32, count) });
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use infonerf_ops::sampling::Placement;
    use infonerf_scene::Scene;

    use super::*;
    use crate::config::{OccupancyConfig, RenderConfig};
    use crate::image::tests::config;
    use crate::noise::{Noise, RandomStream};

    /// Ends of 50 steps of a ray within the box, and their length.
    const ENDS: [f32; 2] = [2.75, 5.25];
    const LENGTH: f32 = 0.05;

    fn ray() -> Ray {
        Ray::new(Vec3::new(0.3, -0.2, 4.0), Vec3::new(0.05, 0.1, -1.0).normalize())
    }

    /// Compares the steps through grids of 16³ cells with all steps, of which those in empty cells are left out.
    #[test]
    fn steps_in_occupied_cells_are_kept() {
        let scene = Scene::default();
        let sets: [fn(usize) -> bool; 4] =
            [|_| true, |cell| cell / 256 < 3, |cell| cell / 256 > 12, |cell| cell % 7 == 0];
        for (clip_to_bounds, is_occupied) in [false, true].into_iter().flat_map(|clip| sets.map(|set| (clip, set))) {
            let config = RenderConfig { clip_to_bounds, ..config(Placement::Mid) };
            let renderer = Renderer::new(&config, &scene);
            let (ray, length) = (ray(), (LENGTH, 0.5));
            let all: Vec<Step> = UniformSteps::new(&renderer, &ray, ENDS, length, None).collect();
            assert_eq!(all.len(), 50);
            let occupancy = OccupancyConfig { resolution: 16, ..config.occupancy.clone() };
            let mut grid = OccupancyGrid::new(&occupancy, scene.space.bounds);
            grid.restore(vec![1.0; 4096], (0..4096).map(is_occupied).collect(), true).unwrap();
            let found: Vec<f32> = UniformSteps::new(&renderer, &ray, ENDS, length, Some(&grid)).map(|s| s.t).collect();
            let kept = all.iter().filter(|step| grid.is_occupied(step.point));
            assert_eq!(found, kept.map(|step| step.t).collect::<Vec<_>>());
            assert!(found.len() >= 3, "{}", found.len());
        }
    }

    /// Checks the samples of one, two and four steps of fog, in which a step has an optical depth of 0.02.
    #[test]
    fn shared_samples_lie_in_the_middle_of_their_steps() {
        let (scene, config) = (Scene::default(), config(Placement::Mid));
        let renderer = Renderer::new(&config, &scene);
        let mut grid = OccupancyGrid::new(&config.occupancy, scene.space.bounds);
        grid.restore(vec![1.0; 8], vec![true; 8], true).unwrap();
        let noise = Noise::new(0, 0, RandomStream::RefinedOccupancy);
        let grid = grid.refined(8, noise, LENGTH, |points| vec![0.4; points.len() / 3]);
        let fours = [vec![4; 12], vec![2]].concat();
        for (depths, counts) in [([0.01; 2], vec![1; 50]), ([0.03, 0.01], vec![2; 25]), ([0.03; 2], fours)] {
            let mut steps = UniformSteps::new(&renderer, &ray(), ENDS, (LENGTH, 0.5), Some(&grid));
            steps.join(depths);
            let (steps, mut start) = (steps.collect::<Vec<Step>>(), ENDS[0]);
            assert_eq!(steps.len(), counts.len());
            for (step, count) in steps.iter().zip(counts) {
                let length = LENGTH * count as f32;
                approx::assert_relative_eq!(step.delta, length, max_relative = 1e-5);
                approx::assert_relative_eq!(step.t, start + 0.5 * length, max_relative = 1e-5);
                start += length;
            }
        }
    }
}
