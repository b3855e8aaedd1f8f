//! Occupancy grid: knowledge of which space is empty.

mod grid;
mod state;

pub use self::grid::OccupancyGrid;
pub(crate) use self::state::CellState;
