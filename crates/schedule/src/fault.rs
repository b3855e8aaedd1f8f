use std::fmt::{self, Display};
use std::ops::RangeInclusive;

use crate::curve::Schedule;

/// Error in a config: a value that is out of range, or that contradicts other keys.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fault {
    /// Key with its tables, such as `train.rays`.
    pub key: String,
    /// Description of the values that are accepted.
    pub expected: String,
    /// Value that was given.
    pub found: String,
}

impl Fault {
    /// Describes a fault at `key`.
    pub fn new(key: impl Into<String>, expected: impl Into<String>, found: impl ToString) -> Self {
        Self { key: key.into(), expected: expected.into(), found: found.to_string() }
    }

    /// Returns a fault with the value `found` at `key` unless `good` is true.
    pub fn unless(good: bool, key: &str, expected: impl Into<String>, found: impl ToString) -> Result<(), Self> {
        if good { Ok(()) } else { Err(Self::new(key, expected, found)) }
    }

    /// Refuses a number outside `range`, and NaN.
    pub fn unless_within<T: PartialOrd + Display>(range: RangeInclusive<T>, key: &str, number: T) -> Result<(), Self> {
        let expected = || format!("a number from {} to {}", range.start(), range.end());
        if range.contains(&number) { Ok(()) } else { Err(Self::new(key, expected(), number)) }
    }

    /// Refuses a schedule with values outside `range`.
    pub fn unless_always_within(range: RangeInclusive<f64>, key: &str, schedule: &Schedule) -> Result<(), Self> {
        Self::unless_within(range.clone(), key, schedule.least())?;
        Self::unless_within(range, key, schedule.largest())
    }

    /// Returns the fault with `table` in front of its key: `table.key`.
    #[must_use]
    pub fn within(self, table: &str) -> Self {
        Self { key: format!("{table}.{}", self.key), ..self }
    }
}

impl Display for Fault {
    /// Writes the fault in one line: control characters in user input are escaped.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{}: expected {}, found {}", self.key, self.expected, self.found);
        text.chars()
            .try_for_each(|c| if c.is_control() { write!(f, "{}", c.escape_default()) } else { write!(f, "{c}") })
    }
}

impl std::error::Error for Fault {}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_is_one_line_with_its_key() {
        let fault = Fault::unless(false, "kind", "`nerf` or `hash`", "a\nb").unwrap_err().within("field");
        assert_eq!(fault.to_string(), "field.kind: expected `nerf` or `hash`, found a\\nb");
        let rays = |number| Fault::unless_within(1.0..=9.0, "rays", number);
        let least = Fault::unless_within(1e-12..=1.0, "epsilon", 1e-12f32);
        assert_eq!([rays(1.0), rays(9.0), least], [Ok(()), Ok(()), Ok(())]);
        assert_eq!(rays(f64::NAN).unwrap_err().to_string(), "rays: expected a number from 1 to 9, found NaN");
        assert!(Fault::unless_always_within(0.0..=1.0, "weight", &Schedule::Constant(2.0)).is_err());
    }
}
