//! Choice of the points whose colours are visible.

use rayon::prelude::*;

use super::bricks::{Bricks, NEARLY_OPAQUE};
use super::lattice::{POINTS, VOLUME, coordinates};

/// Distance, in points, within which a point is hidden by nearly opaque ones: less than 1 % of the light reaches it.
const COVER: usize = 2;
/// Number of points along a brick together with `COVER` points on both sides.
const WIDE: usize = POINTS + 2 * COVER;

/// Returns the points, ascending, whose colour is visible: those of voxels with density that nearly opaque ones do not hide.
pub(super) fn points(bricks: &Bricks) -> Vec<usize> {
    let of_brick = |(number, &cell): (usize, &usize)| -> Vec<usize> {
        let shown = shown(bricks, number, cell);
        bricks.lattice.points(cell).zip(shown).filter(|(_, shown)| *shown).map(|(point, _)| point).collect()
    };
    let mut points: Vec<usize> = bricks.cells.par_iter().enumerate().flat_map_iter(of_brick).collect();
    points.par_sort_unstable();
    points.dedup();
    points
}

/// Returns for each point of a brick whether its colour is visible.
fn shown(bricks: &Bricks, number: usize, cell: usize) -> Vec<bool> {
    let filled = bricks.brick(number).iter().map(|&root| root > 0).collect();
    let near = spread(filled, POINTS, 1);
    let offset = |index: usize| coordinates(index, [WIDE; 3]).map(|c| c as isize - COVER as isize);
    let open = (0..WIDE.pow(3)).map(|index| bricks.root(cell, offset(index)) < NEARLY_OPAQUE).collect();
    let uncovered = spread(open, WIDE, COVER);
    let is_open = |index: usize| {
        let [x, y, z] = coordinates(index, [POINTS; 3]).map(|c| c + COVER);
        uncovered[x + WIDE * (y + WIDE * z)]
    };
    (0..VOLUME).map(|index| near[index] && is_open(index)).collect()
}

/// Sets each flag of a cube of `side`³ if any flag at most `reach` away along each axis is set.
fn spread(mut flags: Vec<bool>, side: usize, reach: usize) -> Vec<bool> {
    for stride in [1, side, side * side] {
        let any = |index: usize| {
            let c = index / stride % side;
            let (first, last) = (c.saturating_sub(reach), (c + reach).min(side - 1));
            (first..=last).any(|other| flags[index + other * stride - c * stride])
        };
        flags = (0..flags.len()).map(any).collect();
    }
    flags
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_spread_along_all_axes() {
        let mut flags = vec![false; 125];
        flags[2 + 5 * (2 + 5 * 2)] = true;
        let found = spread(flags, 5, 1);
        for (index, flag) in found.iter().enumerate() {
            let near = coordinates(index, [5; 3]).iter().all(|c| (1..=3).contains(c));
            assert_eq!(*flag, near, "{index}");
        }
    }
}
