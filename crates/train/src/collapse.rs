//! Detection of a field that has gone empty.

use serde::{Deserialize, Serialize};

/// A field is empty whose seen rays have less opacity than this share of the pixels that show something ...
const EMPTY: f32 = 0.01;
/// ... if it stays so for this many steps while any more than as large a share of the pixels does.
const STEPS: usize = 50;

/// Steps in a row in which the field was empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct EmptySteps(usize);

impl EmptySteps {
    /// Counts a step whose seen rays have mean opacity `acc`, and of whose pixels a share of `foreground` shows
    /// something. Returns whether the field has collapsed.
    pub(crate) fn add(&mut self, acc: f32, foreground: f32) -> bool {
        let empty = acc < EMPTY * foreground && foreground > EMPTY;
        self.0 = if empty { self.0 + 1 } else { 0 };
        self.are_collapse()
    }

    /// Whether the field has collapsed.
    pub(crate) fn are_collapse(&self) -> bool {
        self.0 >= STEPS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fifty_empty_steps_are_a_collapse() {
        let mut steps = EmptySteps::default();
        assert!((0..49).all(|_| !steps.add(1e-4, 0.5)));
        assert!(!steps.add(0.1, 0.5), "one step with something begins anew");
        assert_eq!((0..100).find(|_| steps.add(1e-4, 0.5)), Some(49));
        assert!((0..100).all(|_| !EmptySteps::default().add(0.0, 0.0)), "there is nothing to show");
    }
}
