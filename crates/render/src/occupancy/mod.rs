//! Occupancy grid: knowledge of which space is empty.

mod grid;
mod lookup;

pub use self::grid::OccupancyGrid;
pub(crate) use self::lookup::{CellState, fixed};
