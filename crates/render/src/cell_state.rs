//! States of the cells of an occupancy grid, in 16 bits.

/// Maximal distance to occupied cells that is known exactly.
const MAX_DISTANCE: u16 = 16;

/// State of a cell. Occupied: the max density near it, as the upper half of an `f32`, which orders values that are not
/// negative. Empty: [`Self::EMPTY`] plus the number of cells to the nearest occupied one.
#[derive(Clone, Copy, Debug, PartialEq, PartialOrd)]
pub(crate) struct CellState(u16);

impl CellState {
    const EMPTY: u16 = 1 << 15;
    pub(crate) const UNKNOWN: Self = Self(Self::EMPTY - 1);

    /// Returns the state of an occupied cell; ordered like the density.
    pub(crate) fn of_density(density: f32) -> Self {
        Self((density.to_bits() >> 16) as u16)
    }

    /// Returns the number of cells to the nearest occupied one, at most [`MAX_DISTANCE`]; 0 if occupied or outside the box.
    pub(crate) fn distance(self) -> u16 {
        self.0.saturating_sub(Self::EMPTY)
    }
}

/// Returns the states of the cells of a cube of n³, x fastest, with the maximal density near each if it is known.
pub(crate) fn cell_states(n: usize, occupied: &[bool], nearby: Option<&[f32]>) -> Vec<CellState> {
    let mut near: Vec<u8> = occupied.iter().map(|&occupied| u8::from(occupied)).collect();
    let mut distance = vec![0u8; near.len()];
    for _ in 0..MAX_DISTANCE {
        distance.iter_mut().zip(&near).for_each(|(distance, near)| *distance += 1 - near);
        widen(&mut near, n);
    }
    let state = |(cell, distance)| match (distance, nearby) {
        (0, Some(density)) => CellState::of_density(density[cell]),
        (0, None) => CellState::UNKNOWN,
        _ => CellState(CellState::EMPTY + u16::from(distance)),
    };
    distance.into_iter().enumerate().map(state).collect()
}

/// Gives each cell of n³ the maximum over itself and its neighbours, including those across an edge or a corner.
pub(crate) fn widen<T: Copy + PartialOrd>(values: &mut [T], n: usize) {
    for stride in [1, n, n * n] {
        let before = values.to_vec();
        let pairs = |from: &[T], to: &mut [T]| {
            to.iter_mut().zip(from).for_each(|(to, from)| *to = if from > to { *from } else { *to });
        };
        for (before, values) in before.chunks_exact(stride * n).zip(values.chunks_exact_mut(stride * n)) {
            pairs(&before[stride..], &mut values[..(n - 1) * stride]);
            pairs(&before[..(n - 1) * stride], &mut values[stride..]);
        }
    }
}
