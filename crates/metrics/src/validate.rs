//! Checks shared by every metric, so that none of them can panic or return a number made from NaN.

use crate::MetricError;

/// Both images are non-empty, of the same length, and finite.
pub(crate) fn pair(render: &[[f32; 3]], truth: &[[f32; 3]]) -> Result<(), MetricError> {
    if truth.is_empty() {
        return Err(MetricError::Empty { what: "truth" });
    }
    if render.len() != truth.len() {
        return Err(MetricError::Length { what: "render", found: render.len(), expected: truth.len() });
    }
    finite("render", render)?;
    finite("truth", truth)
}

/// As [`pair`], and both hold `width × height` pixels.
pub(crate) fn sized_pair(
    render: &[[f32; 3]],
    truth: &[[f32; 3]],
    width: usize,
    height: usize,
) -> Result<(), MetricError> {
    size("truth", truth.len(), width, height)?;
    pair(render, truth)
}

/// `found` is `width × height`.
pub(crate) fn size(what: &'static str, found: usize, width: usize, height: usize) -> Result<(), MetricError> {
    let expected = width.saturating_mul(height);
    if found != expected {
        return Err(MetricError::Length { what, found, expected });
    }
    Ok(())
}

fn finite(what: &'static str, pixels: &[[f32; 3]]) -> Result<(), MetricError> {
    match pixels.iter().position(|pixel| pixel.iter().any(|value| !value.is_finite())) {
        Some(index) => Err(MetricError::NonFinite { what, index }),
        None => Ok(()),
    }
}
