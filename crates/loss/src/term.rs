use std::path::PathBuf;

use burn::tensor::{Device, Tensor};
use infonerf_scene::Scene;
use infonerf_schedule::{Fault, Moment, Schedule};

use crate::renders::{Need, Renders};

/// A term of the objective, ready to be evaluated.
pub trait Term: Send + Sync {
    /// Computes the unweighted value, a scalar `[1]`, differentiable in the field's parameters.
    fn value(&self, renders: &Renders) -> Tensor<1>;

    /// Whether the term is evaluated in the step at `at` if its weight is above 0.
    fn is_due(&self, _at: Moment) -> bool {
        true
    }
}

/// Scheduled weight of a term. A term of weight 0 is off: nothing is rendered or computed for it.
pub trait Weighted {
    /// Returns the weight.
    fn weight(&self) -> &Schedule;

    /// Returns the weight, mutable.
    fn weight_mut(&mut self) -> &mut Schedule;
}

/// The config of a term.
pub trait TermSpec: Weighted {
    /// Lists what the term reads in addition to density along the seen rays.
    fn needs(&self) -> Vec<Need> {
        Vec::new()
    }

    /// Builds the term for `scene` and a field on `device`, with everything that it reads or computes once.
    ///
    /// # Errors
    /// If the scene or a file lacks what the term needs.
    fn build(&self, scene: &Scene, device: &Device) -> Result<Box<dyn Term>, Fault>;

    /// Checks every number but the weight.
    ///
    /// # Errors
    /// The first key that is out of range.
    fn validate(&self) -> Result<(), Fault> {
        Ok(())
    }

    /// Returns why the term does not apply to `scene` and is left out; `None` if it applies.
    fn skip_reason(&self, _scene: &Scene) -> Option<&'static str> {
        None
    }

    /// Returns a description of supervision beyond the colours of training images that reports must mention, such as
    /// alpha masks.
    fn extra_supervision(&self) -> Option<&'static str> {
        None
    }

    /// Returns the file of network weights that the term reads, if any: its key within the term's table, and its path.
    fn weights_file(&mut self) -> Option<(&'static str, &mut PathBuf)> {
        None
    }
}
