//! Several fields of one scene, each from other random numbers, whose pictures are averaged.
//!
//! Four photographs leave much of a scene open, and each field fills it in another way. What they agree on stays in the
//! mean of their pictures, what one of them made up fades (deep ensembles, Lakshminarayanan et al. 2017).

use infonerf_render::Noise;

use crate::config::TrainConfig;

impl TrainConfig {
    /// How many fields a run trains: `members`, or with a budget of `budget` seconds as many as have `member_seconds` each
    /// if those are more.
    pub fn members_in(&self, budget: Option<f64>) -> usize {
        let affordable =
            budget.filter(|_| self.member_seconds > 0.0).map_or(0, |seconds| (seconds / self.member_seconds) as usize);
        self.members.max(affordable.min(MOST_MEMBERS))
    }

    /// How each of `members` fields is trained. Where there are several, their weights are not averaged over the end of the
    /// run: what that would even out, the mean of their pictures does, and the fields stay sharper.
    pub fn of_member(&self, members: usize) -> Self {
        let average = if members > 1 { 0.0 } else { self.average };
        Self { average, ..self.clone() }
    }
}

/// More than these change little and cost as much each.
pub(crate) const MOST_MEMBERS: usize = 8;

/// The seed of a run's `index`th field: the run's own for the first.
pub fn member_seed(seed: u64, index: usize) -> u64 {
    if index == 0 { seed } else { Noise::new(seed, index as u64, u64::from_le_bytes(*b"members\0")).bits() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Config, Preset};

    #[test]
    fn a_budget_buys_members() {
        let mut train = Config::from_table(Preset::Paper.table()).unwrap().train;
        (train.members, train.member_seconds) = (2, 0.0);
        assert_eq!((train.members_in(None), train.members_in(Some(1e4))), (2, 2));
        train.member_seconds = 75.0;
        assert_eq!(
            [60.0, 149.0, 150.0, 300.0, 1e9].map(|budget| train.members_in(Some(budget))),
            [2, 2, 2, 4, MOST_MEMBERS]
        );
        train.average = 0.3;
        assert_eq!([1, 2].map(|members| train.of_member(members).average), [0.3, 0.0]);
    }

    #[test]
    fn members_have_seeds_of_their_own() {
        let mut seeds: Vec<u64> = (0..3).flat_map(|seed| (0..4).map(move |index| member_seed(seed, index))).collect();
        assert_eq!((seeds[0], seeds[4]), (0, 1));
        seeds.sort_unstable();
        seeds.dedup();
        assert_eq!(seeds.len(), 12);
    }
}
