use std::fmt::Debug;
use std::path::PathBuf;

use burn::tensor::{Device, Tensor};
use infonerf_scene::Scene;
use infonerf_schedule::{Moment, Schedule};
use thiserror::Error;

use crate::{Need, Renders};

/// A term of the objective, ready to be evaluated.
pub trait Term: Debug + Send + Sync {
    /// Its unweighted value, a scalar `[1]`, differentiable in the field's parameters.
    fn value(&self, renders: &Renders) -> Tensor<1>;

    /// Whether it is evaluated in the step at `at` if its weight is above 0.
    fn is_due(&self, _at: Moment) -> bool {
        true
    }
}

/// The scheduled weight of a term, implemented by the list of terms. A term of weight 0 is off: nothing is rendered or computed
/// for it.
pub trait Weighted {
    /// The weight.
    fn weight(&self) -> &Schedule;

    /// The same, mutable.
    fn weight_mut(&mut self) -> &mut Schedule;
}

/// The config of a term.
pub trait TermSpec: Weighted {
    /// What it needs in addition to density along the seen rays.
    fn needs(&self) -> Vec<Need> {
        Vec::new()
    }

    /// Builds the term for a scene, with everything that it reads or computes once.
    ///
    /// # Errors
    /// If the scene or a file lacks what the term needs.
    fn build(&self, setup: &TermSetup<'_>) -> Result<Box<dyn Term>, LossError>;

    /// Checks every number but the weight.
    ///
    /// # Errors
    /// The first key that is out of range.
    fn validate(&self) -> Result<(), LossError> {
        Ok(())
    }

    /// Why the term does not apply to `scene` and is left out; none if it applies.
    fn skip_reason(&self, _scene: &Scene) -> Option<&'static str> {
        None
    }

    /// What the term uses of a scene besides the colours of its training images, for reports.
    fn privilege(&self) -> Option<&'static str> {
        None
    }

    /// The file of network weights that the term reads, if any: its key within the term's table, and its path.
    fn weights_file(&mut self) -> Option<(&'static str, &mut PathBuf)> {
        None
    }
}

/// What a term is built for.
#[derive(Clone, Copy, Debug)]
pub struct TermSetup<'a> {
    /// The scene that is learned.
    pub scene: &'a Scene,
    /// Where the field is.
    pub device: &'a Device,
}

/// A key of a term that is out of range, or a missing requirement.
#[derive(Debug, Error, PartialEq)]
#[error("{key}: expected {expected}, found {found}")]
pub struct LossError {
    /// The key; within the term's table until [`Self::within`] is called.
    pub key: String,
    /// What is accepted.
    pub expected: String,
    /// What was found.
    pub found: String,
}

impl LossError {
    /// A fault at `key` of a term's table.
    pub fn new(key: &str, expected: impl Into<String>, found: impl ToString) -> Self {
        Self { key: key.into(), expected: expected.into(), found: found.to_string() }
    }

    /// The same with the whole path of its key, in the term called `name`.
    #[must_use]
    pub fn within(self, name: &str) -> Self {
        Self { key: format!("loss.{name}.{}", self.key), ..self }
    }
}

/// Refuses a number outside of a range.
pub(crate) fn in_range(key: &str, value: f64, low: f64, high: f64) -> Result<(), LossError> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(LossError::new(key, format!("a number from {low} to {high}"), value))
    }
}
