//! Published selections of training views, by name.

use super::ViewSelection;
use super::pool::Named;
use crate::camera::Camera;

/// Returns InfoNeRF's selection for NeRF's synthetic scenes: four views of a hundred.
pub fn synthetic(cameras: &[Camera]) -> Named {
    let four = ViewSelection::Seed { seed: 0, count: 4 };
    four.select(cameras).map_or_else(|_| Vec::new(), |ids| vec![("infonerf-4".to_owned(), ids)])
}

/// Returns RegNeRF's selections for forward-facing captures, by name: 2, 3, 6 and 9 of `n` training views, spread evenly;
/// without those of more than `n` views.
pub fn forward_facing(n: usize) -> Named {
    let counts = [2, 3, 6, 9].into_iter().filter(|&count| count <= n);
    counts.map(|count| (format!("regnerf-{count}"), spread(n, count))).collect()
}

/// Returns RegNeRF's `count` training views of `n`, from 2 to `n`: evenly spaced from end to end, rounded as by NumPy.
fn spread(n: usize, count: usize) -> Vec<usize> {
    let step = (n - 1) as f64 / (count - 1) as f64;
    (0..count).map(|i| (i as f64 * step).round_ties_even() as usize).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regnerfs_views() {
        let whole = |n: usize, count| -> Vec<usize> {
            let train: Vec<usize> = (0..n).filter(|i| i % 8 != 0).collect();
            spread(train.len(), count).into_iter().map(|i| train[i]).collect()
        };
        // fern, flower, fortress, horns, leaves, orchids, room, trex
        let published = [
            (20, [1, 10, 19]),
            (34, [1, 17, 33]),
            (42, [1, 21, 41]),
            (62, [1, 30, 61]),
            (26, [1, 12, 25]),
            (25, [1, 12, 23]),
            (41, [1, 20, 39]),
            (55, [1, 28, 54]),
        ];
        for (n, views) in published {
            assert_eq!(whole(n, 3), views, "{n}");
        }
        assert_eq!(whole(20, 2), [1, 19]);
        assert_eq!(forward_facing(2), [("regnerf-2".to_owned(), vec![0, 1])]);
    }
}
