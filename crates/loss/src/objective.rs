use burn::tensor::Tensor;
use infonerf_schedule::{Moment, Schedule};

use crate::term::in_range;
use crate::{LossConfig, LossError, Need, Renders, Term, TermSetup};

/// The terms of a run that are on at some time.
#[derive(Debug)]
pub struct Objective {
    terms: Vec<Entry>,
}

#[derive(Debug)]
struct Entry {
    name: &'static str,
    weight: Schedule,
    term: Box<dyn Term>,
}

/// A term that takes part in a step.
#[derive(Clone, Copy, Debug)]
pub struct DueTerm<'a> {
    /// Its name.
    pub name: &'static str,
    /// Its weight in this step.
    pub weight: f32,
    term: &'a dyn Term,
}

/// What the terms of a step came to.
#[derive(Clone, Debug)]
pub struct LossValues {
    /// Σ weight · value, a scalar.
    pub total: Tensor<1>,
    /// Each term by name, without its weight, a scalar.
    pub values: Vec<(&'static str, Tensor<1>)>,
}

impl LossConfig {
    /// Checks every number of every term.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), LossError> {
        for (name, spec) in self.specs() {
            let weight = spec.weight();
            in_range("weight", weight.least(), 0.0, 1e6)
                .and_then(|()| in_range("weight", weight.largest(), 0.0, 1e6))
                .and_then(|()| spec.validate())
                .map_err(|error| error.within(name))?;
        }
        Ok(())
    }
}

impl Objective {
    /// Builds the terms that are on at some time, without those that say nothing about the scene
    /// ([`crate::TermSpec::left_out`]).
    ///
    /// # Errors
    /// If a term lacks what it needs.
    pub fn new(config: &LossConfig, setup: &TermSetup<'_>) -> Result<Self, LossError> {
        let entry = |(name, spec): (&'static str, &dyn crate::TermSpec)| {
            let term = spec.build(setup).map_err(|error| error.within(name))?;
            Ok(Entry { name, weight: spec.weight().clone(), term })
        };
        let taking_part = config.active().filter(|(_, spec)| spec.left_out(setup.scene).is_none());
        Ok(Self { terms: taking_part.map(entry).collect::<Result<_, _>>()? })
    }

    /// The terms that take part in the step at `at`.
    pub fn due(&self, at: Moment) -> Vec<DueTerm<'_>> {
        let due = |entry: &Entry| {
            let weight = entry.weight.at(at) as f32;
            (weight > 0.0 && entry.term.is_due(at)).then_some((entry.name, weight))
        };
        let terms = self.terms.iter().filter_map(|entry| Some((due(entry)?, entry)));
        terms.map(|((name, weight), entry)| DueTerm { name, weight, term: entry.term.as_ref() }).collect()
    }
}

/// What has to be rendered for `terms`, each thing once.
pub fn needs(terms: &[DueTerm<'_>]) -> Vec<Need> {
    let mut union: Vec<Need> = Vec::new();
    for need in terms.iter().flat_map(|due| due.term.needs()) {
        if !union.contains(&need) {
            union.push(need);
        }
    }
    union
}

impl LossValues {
    /// Evaluates `terms` on what was rendered for them.
    pub fn of(terms: &[DueTerm<'_>], renders: &Renders) -> Self {
        let mut total = renders.zero();
        let mut values = Vec::with_capacity(terms.len());
        for due in terms {
            let value = due.term.value(renders);
            total = total + value.clone() * due.weight;
            values.push((due.name, value));
        }
        Self { total, values }
    }
}
