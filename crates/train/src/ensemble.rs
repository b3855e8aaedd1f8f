//! Several fields of one scene, each from other random numbers, whose pictures are averaged.
//!
//! Four photographs leave much of a scene open, and each field fills it in another way. What they agree on stays in the
//! mean of their pictures, what one of them made up fades (deep ensembles, Lakshminarayanan et al. 2017).

use std::time::Instant;

use infonerf_field::Field;
use infonerf_render::{Noise, RandomStream};
use rayon::prelude::*;

use crate::config::{EnsembleConfig, LARGEST_ENSEMBLE, TrainConfig};
use crate::{Event, Outcome, TrainError, Trainer};

impl EnsembleConfig {
    /// How many fields a run trains: `size`, or with a budget of `budget` seconds as many as have `seconds_per_member`
    /// each if those are more.
    pub fn members(&self, budget: Option<f64>) -> usize {
        let seconds = self.seconds_per_member;
        let affordable = budget.filter(|_| seconds > 0.0).map_or(0, |budget| (budget / seconds) as usize);
        self.size.max(affordable.min(LARGEST_ENSEMBLE))
    }
}

impl TrainConfig {
    /// How each of `members` fields is trained. Where there are several, their weights are not averaged over the end of the
    /// run: the mean of their pictures evens out the same noise, and the fields stay sharper.
    pub fn of_member(&self, members: usize) -> Self {
        let weight_averaging = if members > 1 { 0.0 } else { self.weight_averaging };
        Self { weight_averaging, ..self.clone() }
    }
}

/// A step of one field: what happened, and what came of it.
pub type Stepped = (Vec<Event>, Result<Outcome, TrainError>);

/// Takes a step of each of `trainers` at once, a thread each: faster than threads that share every operation of one field
/// and wait for each other. Each step counts as its share of the time that all took together, so that the times of all fields
/// add up to that of the run. No field's numbers depend on the others.
pub fn step_side_by_side<F: Field>(trainers: &mut [&mut Trainer<F>]) -> Vec<Stepped> {
    let start = Instant::now();
    let taken: Vec<_> = match trainers {
        // A device may know its work by the thread that asks for it.
        [only] => vec![only.take_drawn_step()],
        _ => trainers.par_iter_mut().map(|trainer| trainer.take_drawn_step()).collect(),
    };
    let share = start.elapsed().as_secs_f64() / trainers.len() as f64;
    let count = |(trainer, taken): (&mut &mut Trainer<F>, bool)| {
        let mut events = Vec::new();
        let outcome = trainer.count_step(taken, share, &mut |event| events.push(event));
        (events, outcome)
    };
    trainers.iter_mut().zip(taken).map(count).collect()
}

/// The fields of a run that pictures are made of, and how many are left out because they went empty; all of them if there
/// are no others.
pub fn without_collapsed<F: Field>(trainers: Vec<Trainer<F>>) -> (Vec<Trainer<F>>, usize) {
    let (collapsed, good): (Vec<_>, Vec<_>) = trainers.into_iter().partition(Trainer::has_collapsed);
    if good.is_empty() { (collapsed, 0) } else { (good, collapsed.len()) }
}

/// The seed of a run's `index`th field: the run's own for the first.
pub fn member_seed(seed: u64, index: usize) -> u64 {
    if index == 0 { seed } else { Noise::new(seed, index as u64, RandomStream::EnsembleMember).bits() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Config, Preset};

    #[test]
    fn a_budget_buys_members() {
        let mut train = Config::from_table(Preset::Paper.table()).unwrap().train;
        let mut ensemble = EnsembleConfig { size: 2, seconds_per_member: 0.0 };
        assert_eq!((ensemble.members(None), ensemble.members(Some(1e4))), (2, 2));
        ensemble.seconds_per_member = 75.0;
        assert_eq!(
            [60.0, 149.0, 150.0, 300.0, 1e9].map(|budget| ensemble.members(Some(budget))),
            [2, 2, 2, 4, LARGEST_ENSEMBLE]
        );
        train.weight_averaging = 0.3;
        assert_eq!([1, 2].map(|members| train.of_member(members).weight_averaging), [0.3, 0.0]);
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
