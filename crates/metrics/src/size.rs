//! Checks that pictures, and what belongs to them, are of one size.

use crate::MetricError;

/// `what` is as large as the render.
pub(crate) fn check_size(what: &'static str, found: [usize; 2], expected: [usize; 2]) -> Result<(), MetricError> {
    if found == expected { Ok(()) } else { Err(MetricError::Size { what, found, expected }) }
}

/// `found` is width × height.
pub(crate) fn check_length(what: &'static str, found: usize, [width, height]: [usize; 2]) -> Result<(), MetricError> {
    let expected = width.saturating_mul(height);
    if found == expected { Ok(()) } else { Err(MetricError::Length { what, found, expected }) }
}
