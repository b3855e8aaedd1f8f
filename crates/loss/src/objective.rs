use burn::tensor::Tensor;
use infonerf_ops::means::weighted_sum;
use infonerf_schedule::{Fault, Moment, Schedule};

use crate::renders::union;
use crate::{LossConfig, Need, Renders, Term, TermSetup};

/// The active terms of a run, built for a scene.
#[derive(Debug)]
pub struct Objective {
    terms: Vec<Entry>,
}

#[derive(Debug)]
struct Entry {
    name: &'static str,
    weight: Schedule,
    needs: Vec<Need>,
    term: Box<dyn Term>,
}

impl Entry {
    fn due(&self, at: Moment) -> Option<DueTerm<'_>> {
        let Self { name, weight, needs, term } = self;
        let weight = weight.at(at) as f32;
        (weight > 0.0 && term.is_due(at)).then_some(DueTerm { name, weight, needs, term: term.as_ref() })
    }
}

/// A term that takes part in a step.
#[derive(Clone, Copy, Debug)]
pub struct DueTerm<'a> {
    /// Its name.
    pub name: &'static str,
    /// Its weight in this step.
    pub weight: f32,
    needs: &'a [Need],
    term: &'a dyn Term,
}

/// Values of the terms of a step.
#[derive(Clone, Debug)]
pub struct LossValues {
    /// Σ weight · value, a scalar.
    pub total: Tensor<1>,
    /// Unweighted value of each term by name, scalars.
    pub values: Vec<(&'static str, Tensor<1>)>,
}

impl LossConfig {
    /// Checks every number of every term.
    ///
    /// # Errors
    /// The first key that is out of range.
    pub fn validate(&self) -> Result<(), Fault> {
        for (name, spec) in self.specs() {
            let weight = spec.weight();
            Fault::unless_always_within(0.0..=1e6, "weight", weight)
                .and_then(|()| spec.validate())
                .map_err(|fault| fault.within(&format!("loss.{name}")))?;
        }
        Ok(())
    }
}

impl Objective {
    /// Builds the active terms, except those that skip the scene ([`crate::TermSpec::skip_reason`]).
    ///
    /// # Errors
    /// If a term lacks what it needs.
    pub fn new(config: &LossConfig, setup: &TermSetup<'_>) -> Result<Self, Fault> {
        let entry = |(name, spec): (&'static str, &dyn crate::TermSpec)| {
            let term = spec.build(setup).map_err(|fault| fault.within(&format!("loss.{name}")))?;
            Ok(Entry { name, weight: spec.weight().clone(), needs: spec.needs(), term })
        };
        let taking_part = config.active().filter(|(_, spec)| spec.skip_reason(setup.scene).is_none());
        Ok(Self { terms: taking_part.map(entry).collect::<Result<_, _>>()? })
    }

    /// The terms that take part in the step at `at`.
    pub fn due(&self, at: Moment) -> Vec<DueTerm<'_>> {
        self.terms.iter().filter_map(|entry| entry.due(at)).collect()
    }
}

/// The union of what `terms` need rendered.
pub fn needs(terms: &[DueTerm<'_>]) -> Vec<Need> {
    union(terms.iter().flat_map(|due| due.needs).copied())
}

impl LossValues {
    /// Evaluates `terms` on the renders that they need.
    pub fn of(terms: &[DueTerm<'_>], renders: &Renders) -> Self {
        let values: Vec<(&'static str, Tensor<1>)> =
            terms.iter().map(|due| (due.name, due.term.value(renders))).collect();
        let weighted = values.iter().zip(terms).map(|((_, value), due)| (value.clone(), due.weight));
        let total = weighted_sum(weighted.collect()).unwrap_or_else(|| renders.zero());
        Self { total, values }
    }
}

/// `value` times a `factor` that often is 1: each product is a kernel to launch on a GPU, and one more on the way back.
pub(crate) fn scaled(value: Tensor<1>, factor: f32) -> Tensor<1> {
    if factor == 1.0 { value } else { value * factor }
}
