//! Selection of the few training views, and of the views to evaluate on.

pub mod pool;
pub mod published;
mod spread;
mod test;
mod text;

pub use test::TestProtocol;

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_mt::Mt;
use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::error::SceneError;

/// Rule for choosing training views among all of a scene.
///
/// Every rule depends only on its fields and the cameras, so a selection is reproducible. Angles are between directions from
/// the scene's centre (the point nearest to all optical axes) to cameras, or between viewing directions where they look outwards.
///
/// As text ([`std::fmt::Display`], [`std::str::FromStr`]): `all`, `26,86,2,55`, `seed-4@0`, `farthest-4@0`,
/// `wide-4@0`, `narrow-4/30@0` (degrees), a published selection's name, or names of images such as `image006,image008`.
/// A config holds a table with the rule's name as `kind`, without the seed, which is the run's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum ViewSelection {
    /// `count` views as NumPy's `RandomState(seed).choice(n, count, replace=False)` draws them.
    ///
    /// With 100 views, seeds 0 to 4 give the five published few-shot sets; seed 0 starts
    /// 26, 86, 2, 55. `seed` is at most 2³² − 1, as in NumPy.
    Seed {
        /// NumPy's seed.
        #[serde(skip)]
        seed: u64,
        /// Number of views.
        count: usize,
    },
    /// Views by their ids, in this order.
    Ids {
        /// Ids of training views.
        ids: Vec<usize>,
    },
    /// `count` views, the first drawn from `seed`, each next one with the camera farthest from all chosen so far.
    Farthest {
        /// Number of views.
        count: usize,
        /// Seed of the first view.
        #[serde(skip)]
        seed: u64,
    },
    /// `count` random views of which each is within `angle_deg` of each other.
    Narrow {
        /// Number of views.
        count: usize,
        /// Max angle between any two views, in degrees.
        angle_deg: f64,
        /// Seed of the set, where there are several.
        #[serde(skip)]
        seed: u64,
    },
    /// `count` random views that surround the scene: of 256 random sets the one with the largest min angle between two views.
    Wide {
        /// Number of views.
        count: usize,
        /// Seed of the random sets.
        #[serde(skip)]
        seed: u64,
    },
    /// A published selection by its name, such as `regnerf-3` for LLFF and DTU, or names of images between commas.
    #[serde(rename = "published")]
    Named {
        /// Name of the selection, or names of images.
        name: String,
    },
    /// Every view.
    All,
}

impl ViewSelection {
    /// Returns the number of views; `None` if it depends on the scene.
    pub fn count(&self) -> Option<usize> {
        match self {
            Self::Ids { ids } => Some(ids.len()),
            Self::Named { .. } | Self::All => None,
            Self::Seed { count, .. }
            | Self::Farthest { count, .. }
            | Self::Narrow { count, .. }
            | Self::Wide { count, .. } => Some(*count),
        }
    }

    /// Returns the rule with another seed, if it has one.
    pub fn with_seed(mut self, new: u64) -> Self {
        use ViewSelection::{Farthest, Narrow, Seed, Wide};
        if let Seed { seed, .. } | Farthest { seed, .. } | Narrow { seed, .. } | Wide { seed, .. } = &mut self {
            *seed = new;
        }
        self
    }

    /// Returns the indices of the chosen views in `cameras`, in the order in which they were chosen.
    ///
    /// # Errors
    /// `cameras` is empty; no view is asked for, or more than there are; an id is out of range or given twice; a NumPy seed
    /// above 2³² − 1; an angle that is not positive; no `count` views within it; or a name, which only its scene can resolve.
    pub fn select(&self, cameras: &[Camera]) -> Result<Vec<usize>, SceneError> {
        let n = cameras.len();
        let count = self.count().unwrap_or(n);
        let random = |seed: &u64| ChaCha8Rng::seed_from_u64(*seed);
        match self {
            _ if n == 0 => Err(error("a scene with at least one training view", "none")),
            Self::Ids { ids } => check_ids("train", ids, n).map(|()| ids.clone()),
            Self::All => Ok((0..n).collect()),
            Self::Named { name } => Err(error("a selection that this scene knows", format!("`{name}`"))),
            _ if !(1..=n).contains(&count) => Err(error(format!("a number of views from 1 to {n}"), count)),
            Self::Seed { seed, .. } => {
                let seed = u32::try_from(*seed).map_err(|_| error("a NumPy seed of at most 4294967295", seed))?;
                Ok(numpy_permutation(seed, n)[..count].to_vec())
            }
            Self::Farthest { seed, .. } => Ok(spread::farthest_point(cameras, count, &mut random(seed))),
            Self::Wide { seed, .. } => Ok(spread::wide(cameras, count, &mut random(seed))),
            Self::Narrow { angle_deg, .. } if !(angle_deg.is_finite() && *angle_deg > 0.0) => {
                Err(error("a positive angle in degrees", angle_deg))
            }
            Self::Narrow { angle_deg, seed, .. } => {
                spread::narrow(cameras, count, angle_deg.to_radians(), &mut random(seed))
                    .ok_or_else(|| error(format!("{count} views within {angle_deg}° of each other"), "fewer"))
            }
        }
    }
}

/// Returns the result of `np.random.permutation(n)` after `np.random.seed(seed)`: Fisher–Yates from the end. Draws of
/// MT19937 are masked to the bits of the max index and repeated while they exceed it.
fn numpy_permutation(seed: u32, n: usize) -> Vec<usize> {
    let mut rng = Mt::new(seed);
    let mut order: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        let mask = u32::MAX >> (i as u32).leading_zeros();
        let j = std::iter::repeat_with(|| (rng.next_u32() & mask) as usize).find(|&j| j <= i).unwrap_or(i);
        order.swap(i, j);
    }
    order
}

/// Returns an error if `ids` are empty, not below `n` or given twice.
pub(crate) fn check_ids(field: &'static str, ids: &[usize], n: usize) -> Result<(), SceneError> {
    if ids.is_empty() {
        return Err(SceneError::request(field, "at least one view id", "none"));
    }
    let mut seen = std::collections::HashSet::new();
    for &id in ids {
        if id >= n {
            return Err(SceneError::request(field, format!("view ids from 0 to {}", n.saturating_sub(1)), id));
        }
        if !seen.insert(id) {
            return Err(SceneError::request(field, "each view id once", format!("{id} twice")));
        }
    }
    Ok(())
}

fn error(expected: impl Into<String>, found: impl std::fmt::Display) -> SceneError {
    SceneError::request("train", expected, found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::train_cameras;

    #[test]
    fn seeds_repeat_numpy() {
        let known: [(u32, &[usize]); 5] = [
            (0, &[26, 86, 2, 55, 75, 93, 16, 73]),
            (1, &[80, 84, 33, 81]),
            (2, &[83, 30, 56, 24]),
            (3, &[93, 67, 6, 64]),
            (4, &[20, 10, 96, 16]),
        ];
        for (seed, expected) in known {
            assert_eq!(numpy_permutation(seed, 100)[..expected.len()], *expected, "seed {seed}");
        }
        assert_eq!((numpy_permutation(0, 0), numpy_permutation(0, 1)), (vec![], vec![0]));
    }

    #[test]
    fn bad_requests_say_what_is_wrong() {
        let narrow = |angle_deg| ViewSelection::Narrow { count: 4, angle_deg, seed: 0 };
        for (selection, expected) in [
            (ViewSelection::Ids { ids: vec![] }, "at least one view id"),
            (ViewSelection::Ids { ids: vec![1, 100] }, "0 to 99, found 100"),
            (ViewSelection::Ids { ids: vec![1, 2, 1] }, "1 twice"),
            (ViewSelection::Seed { seed: 0, count: 101 }, "found 101"),
            (ViewSelection::Seed { seed: 0, count: 0 }, "found 0"),
            (ViewSelection::Seed { seed: 1 << 32, count: 1 }, "NumPy seed"),
            (narrow(f64::NAN), "positive angle"),
            (narrow(1e-6), "within 0.000001°"),
        ] {
            let message = selection.select(&train_cameras()).unwrap_err().to_string();
            assert!(message.contains(expected), "{message}");
        }
        assert!(ViewSelection::All.select(&[]).is_err());
    }

    #[test]
    fn every_rule_gives_distinct_views_and_repeats() {
        let rules = [
            ViewSelection::Seed { seed: 3, count: 8 },
            ViewSelection::Farthest { count: 8, seed: 3 },
            ViewSelection::Narrow { count: 4, angle_deg: 40.0, seed: 3 },
            ViewSelection::Wide { count: 8, seed: 3 },
            ViewSelection::All,
        ];
        for rule in rules {
            let ids = rule.select(&train_cameras()).unwrap();
            check_ids("train", &ids, 100).unwrap();
            assert_eq!(ids, rule.select(&train_cameras()).unwrap());
        }
    }
}
