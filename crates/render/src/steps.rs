//! Steps of one length along a ray.

use glam::I64Vec3;
use infonerf_scene::Ray;

use crate::occupancy::{CellState, OccupancyGrid, fixed};
use crate::warp::Warp;

/// `(distance, length)` of samples along a ray, front to back: steps of one length, less those in empty cells of a grid. Two or
/// four steps are one sample where [`Self::join`] allows it.
#[derive(Clone, Debug)]
pub(crate) struct UniformSteps<'a> {
    ray: &'a Ray,
    warp: &'a Warp,
    grid: Option<&'a OccupancyGrid>,
    /// Coordinate where the first step begins.
    near: f32,
    /// Length of a step, in coordinates.
    length: f32,
    /// Position of the sample within a step, 0 to 1.
    shift: f32,
    /// The ray among the cells of the grid, unless space is warped.
    cells: Option<CellLine>,
    /// Two steps are one sample where both cells are below the first of these, four where all are below the second.
    joined: [CellState; 2],
    next: usize,
    last: usize,
}

/// A ray among a grid's cells, in fixed point.
#[derive(Clone, Copy, Debug)]
struct CellLine {
    /// Place of the first sample.
    from: I64Vec3,
    /// Displacement of one step.
    step: I64Vec3,
    /// Steps in the width of a cell, along the axis on which the ray passes cells fastest; rounded down a little.
    steps_per_cell: f32,
}

impl<'a> UniformSteps<'a> {
    /// Returns the steps between `ends`, coordinates of near and far, each at most `step` long and with its sample at
    /// the share `shift` of it. If the ray `is_clipped` to the box of the grid, steps before and behind all occupied
    /// cells are left out at once.
    pub(crate) fn new(
        ray: &'a Ray,
        warp: &'a Warp,
        [near, far]: [f32; 2],
        (step, shift): (f32, f32),
        grid: Option<&'a OccupancyGrid>,
        is_clipped: bool,
    ) -> Self {
        let joined = [CellState::of_density(0.0); 2];
        let count = ((far - near) / step).ceil().max(1.0);
        let length = (far - near) / count;
        let all = Self { ray, warp, grid, cells: None, near, length, shift, joined, next: 0, last: count as usize };
        let Some(grid) = grid else { return all };
        let cells = warp.is_identity().then(|| {
            let [from, step] = [grid.in_cells(ray.at(near)), grid.cells_along(ray.direction * length)];
            let steps_per_cell = 0.999 / step.abs().max_element();
            CellLine { from: fixed(from + shift * step), step: fixed(step), steps_per_cell }
        });
        if !is_clipped {
            return Self { cells, ..all };
        }
        let Some((enter, leave)) = grid.tight_bounds().intersect(ray) else { return Self { last: 0, ..all } };
        let index = |t: f32| ((t - near) / length).max(0.0);
        let (first, last) = (index(enter).floor() as usize, index(leave).ceil() as usize + 1);
        Self { cells, next: first.saturating_sub(1), last: last.min(all.last), ..all }
    }

    /// Makes one sample, from here on, of two steps of optical depths below `depths[0]`, and of four below `depths[1]`.
    pub(crate) fn join(&mut self, depths: [f32; 2]) {
        self.joined = depths.map(|depth| CellState::of_density(depth / self.length));
    }

    fn distance(&self, at: f32) -> f32 {
        self.warp.distance(self.near + at * self.length)
    }

    /// Returns the state of the cell at the sample of a step.
    #[inline]
    fn state(&self, grid: &OccupancyGrid, step: usize) -> CellState {
        match self.cells {
            Some(line) => grid.state_at(line.from + step as i64 * line.step),
            None => {
                let t = self.distance(step as f32 + self.shift);
                grid.state_at(fixed(grid.in_cells(self.warp.point(self.ray.at(t)))))
            }
        }
    }

    /// Returns the number of steps from the next on, whose cell has state `first`, that are one sample.
    fn together(&self, grid: &OccupancyGrid, first: CellState) -> usize {
        let [two, four] = self.joined;
        let thin = |ahead: usize, most: CellState| self.state(grid, self.next + ahead) < most;
        match self.last - self.next {
            4.. if first < four && (1..4).all(|ahead| thin(ahead, four)) => 4,
            2.. if first < two && thin(1, two) => 2,
            _ => 1,
        }
    }
}

impl Iterator for UniformSteps<'_> {
    type Item = (f32, f32);

    fn next(&mut self) -> Option<(f32, f32)> {
        while self.next < self.last {
            let mut count = 1;
            if let Some(grid) = self.grid {
                let state = self.state(grid, self.next);
                if let Some(away) = state.distance().checked_sub(1) {
                    // Steps through wide empty space are passed over many at a time.
                    let pace = self.cells.map_or(0.0, |line| line.steps_per_cell);
                    self.next += 1 + (f32::from(away) * pace) as usize;
                    continue;
                }
                count = self.together(grid, state);
            }
            let at = self.next as f32 + self.shift + 0.5 * (count - 1) as f32;
            self.next += count;
            return Some((self.distance(at), count as f32 * self.length));
        }
        None
    }
}
