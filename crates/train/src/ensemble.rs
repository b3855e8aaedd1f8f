//! Ensembles: several fields of one scene, each trained with its own random numbers, whose pictures are averaged.
//!
//! Few photographs leave much of a scene undetermined, and each field completes it differently. In the mean of their
//! pictures, content that all share stays, and artefacts of one field fade (deep ensembles, Lakshminarayanan et al. 2017).

use std::time::Instant;

use infonerf_field::Field;
use infonerf_render::{Noise, RandomStream};
use rayon::prelude::*;

use crate::error::TrainError;
use crate::event::Event;
use crate::trainer::{Outcome, Trainer};

/// Events of a step of one field, and its outcome.
pub type MemberStep = (Vec<Event>, Result<Outcome, TrainError>);

/// Takes a step of each of `trainers` at once, a thread each. This is faster than sharing every operation of one field
/// among all threads. Each step counts as an equal share of the time that all took together, so that the times of all
/// fields add up to the time of the run. The values of a field do not depend on the others.
pub fn step_side_by_side<F: Field>(trainers: &mut [&mut Trainer<F>]) -> Vec<MemberStep> {
    let start = Instant::now();
    let steps: Vec<_> = match trainers {
        // A single trainer stays in this thread, as a device may tie its work to the calling thread.
        [only] => vec![only.take_step(None)],
        _ => trainers.par_iter_mut().map(|trainer| trainer.take_step(None)).collect(),
    };
    let share = start.elapsed().as_secs_f64() / trainers.len() as f64;
    let counted = trainers.iter_mut().zip(steps).map(|(trainer, step)| {
        let mut events = Vec::new();
        let outcome = trainer.count_step(step, share, &mut |event| events.push(event));
        (events, outcome)
    });
    counted.collect()
}

/// Returns the fields that have not collapsed, or all if all have, and the number of fields that are left out.
pub fn without_collapsed<F: Field>(trainers: Vec<Trainer<F>>) -> (Vec<Trainer<F>>, usize) {
    let (collapsed, good): (Vec<_>, Vec<_>) =
        trainers.into_iter().partition(|trainer| trainer.progress().has_collapsed());
    if good.is_empty() { (collapsed, 0) } else { (good, collapsed.len()) }
}

/// Returns the seed of a run's `index`th field: the run's own for the first.
pub fn member_seed(seed: u64, index: usize) -> u64 {
    if index == 0 { seed } else { Noise::new(seed, index as u64, RandomStream::EnsembleMember).bits() }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::config::{Config, EnsembleConfig, Preset};

    #[test]
    fn budget_sets_the_number_of_members() {
        let mut train = Config::from_table(Preset::Paper.table()).unwrap().train;
        let mut ensemble = EnsembleConfig { size: 2, seconds_per_member: 0.0, max_steps: 0, max_steps_per_view: 200 };
        assert_eq!((ensemble.members(None), ensemble.members(Some(1e4))), (2, 2));
        ensemble.seconds_per_member = 75.0;
        assert_eq!([60.0, 149.0, 150.0, 300.0, 1e9].map(|budget| ensemble.members(Some(budget))), [2, 2, 2, 4, 8]);
        assert_eq!([1, 100].map(|views| ensemble.step_limit(views)), [None, None]);
        ensemble.max_steps = 1500;
        assert_eq!([1, 7, 8].map(|views| ensemble.step_limit(views)), [1500, 1500, 1600].map(Some));
        train.weight_averaging = 0.3;
        assert_eq!([1, 2].map(|members| train.of_member(members).weight_averaging), [0.3, 0.0]);
    }

    #[test]
    fn members_have_seeds_of_their_own() {
        let seeds: BTreeSet<u64> = (0..3).flat_map(|seed| (0..4).map(move |index| member_seed(seed, index))).collect();
        assert_eq!((member_seed(0, 0), member_seed(1, 0), seeds.len()), (0, 1, 12));
    }
}
