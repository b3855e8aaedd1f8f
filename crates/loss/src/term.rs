use std::fmt::Debug;
use std::path::PathBuf;

use burn::tensor::{Device, Tensor};
use infonerf_scene::Scene;
use infonerf_schedule::{Moment, Schedule};
use thiserror::Error;

use crate::{Need, Renders};

/// A term of the objective, ready to be evaluated.
pub trait Term: Debug + Send + Sync {
    /// What has to be rendered for it.
    fn needs(&self) -> Vec<Need>;

    /// Its value without its weight, a scalar `[1]`, differentiable in the field's parameters.
    fn value(&self, renders: &Renders) -> Tensor<1>;

    /// Whether it takes part in the step at `at`, its weight apart.
    fn is_due(&self, _at: Moment) -> bool {
        true
    }
}

/// What a config file says of a term.
pub trait TermSpec {
    /// Its weight over the run; 0 switches it off, and nothing is rendered or computed for it.
    fn weight(&self) -> &Schedule;

    /// The same, to be changed.
    fn weight_mut(&mut self) -> &mut Schedule;

    /// The term for a scene. What it reads or computes once is read here.
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

    /// Why the term says nothing about `scene`, and so is left out; none if it takes part.
    fn left_out(&self, _scene: &Scene) -> Option<&'static str> {
        None
    }

    /// What the term knows of a scene beside the colours of its training images, for reports; none if nothing.
    fn privilege(&self) -> Option<&'static str> {
        None
    }

    /// The file of weights that the term reads, if it reads one: its key within the term's table, and its path.
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

/// A key of a term out of range, or something that it needs and lacks.
#[derive(Debug, Error, PartialEq)]
#[error("{key}: expected {expected}, found {found}")]
pub struct LossError {
    /// The key; within the term's table until [`Self::within`] is called.
    pub key: String,
    /// What would have been accepted.
    pub expected: String,
    /// What was given.
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
