//! Depth maps: distance along each pixel's ray, +∞ where it hits nothing; the truth may have NaN there.

use crate::MetricError;

/// Whether a ray of that depth hits something.
pub(crate) fn hits(depth: f32) -> bool {
    depth.is_finite()
}

/// Rendered and true depth of each pixel.
///
/// # Errors
/// [`MetricError::Length`] when the maps differ in length, [`MetricError::NonFinite`] for a rendered depth that is NaN or
/// −∞.
pub(crate) fn pixels(render: &[f32], truth: &[f32]) -> Result<impl Iterator<Item = (f32, f32)>, MetricError> {
    if render.len() != truth.len() {
        return Err(MetricError::Length { what: "rendered depth", found: render.len(), expected: truth.len() });
    }
    match render.iter().position(|depth| depth.is_nan() || *depth == f32::NEG_INFINITY) {
        Some(index) => Err(MetricError::NonFinite { what: "rendered depth", index }),
        None => Ok(render.iter().copied().zip(truth.iter().copied())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn broken_maps_are_refused() {
        let error = |render: &[f32], truth: &[f32]| pixels(render, truth).map(|_| ()).unwrap_err();
        let length = MetricError::Length { what: "rendered depth", found: 1, expected: 2 };
        assert_eq!(error(&[1.0], &[1.0, 2.0]), length);
        let nan = MetricError::NonFinite { what: "rendered depth", index: 1 };
        assert_eq!(error(&[1.0, f32::NAN], &[1.0, f32::NAN]), nan);
    }
}
