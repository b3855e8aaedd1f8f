//! Metrics of depth maps: distance along each pixel's ray, +∞ if it hits nothing; the truth may have NaN there.

use super::{Measure, Metric, SSIM};
use crate::descriptor::{Better, Descriptor};
use crate::error::MetricError;

pub(super) const DEPTH_ERROR: Metric = Metric {
    descriptor: Descriptor { key: "depth_error", name: "Depth error", unit: "", decimals: 3, better: Better::Lower },
    definition: "RMSE of distance along the ray, scene units, where both render and truth hit something",
    measure: Measure::View(|view| view.depths().and_then(|(render, truth)| depth_error(render, truth))),
};

pub(super) const SILHOUETTE_IOU: Metric = Metric {
    descriptor: Descriptor { key: "silhouette_iou", name: "Silhouette IoU", ..SSIM.descriptor },
    definition: "pixels that hit something in both over pixels that hit something in either",
    measure: Measure::View(|view| view.depths().and_then(|(render, truth)| silhouette_iou(render, truth))),
};

/// Computes the root mean square error of depth, in scene units, over the pixels where both render and truth hit something.
///
/// `RMSE = sqrt(Σ_i h_i (d_i − d*_i)² / Σ_i h_i)`, `h_i = 1` where both depths are finite: a ray that hits nothing has
/// depth +∞. [`silhouette_iou`] measures hits that only one of them has.
///
/// # Errors
/// If the maps differ in length, a rendered depth is NaN or −∞, or there is no such pixel.
pub fn depth_error(render: &[f32], truth: &[f32]) -> Result<f64, MetricError> {
    let (mut squares, mut count) = (0.0, 0usize);
    for (d, t) in pixels(render, truth)?.filter(|(d, t)| d.is_finite() && t.is_finite()) {
        squares += (f64::from(d) - f64::from(t)).powi(2);
        count += 1;
    }
    if count == 0 {
        return Err(MetricError::other("no pixel where both the render and the truth hit something"));
    }
    Ok((squares / count as f64).sqrt())
}

/// Computes `|R ∩ T| / |R ∪ T|` of what render and truth hit, that is, where depth is finite; 1 if neither hits anything.
///
/// # Errors
/// If the maps differ in length, or a rendered depth is NaN or −∞.
pub fn silhouette_iou(render: &[f32], truth: &[f32]) -> Result<f64, MetricError> {
    let (mut both, mut either) = (0usize, 0usize);
    for (d, t) in pixels(render, truth)? {
        both += usize::from(d.is_finite() && t.is_finite());
        either += usize::from(d.is_finite() || t.is_finite());
    }
    Ok(if either == 0 { 1.0 } else { both as f64 / either as f64 })
}

fn pixels(render: &[f32], truth: &[f32]) -> Result<impl Iterator<Item = (f32, f32)>, MetricError> {
    if render.len() != truth.len() {
        return Err(MetricError::length("rendered depth", render.len(), truth.len()));
    }
    match render.iter().position(|depth| depth.is_nan() || *depth == f32::NEG_INFINITY) {
        Some(index) => Err(MetricError::not_finite("rendered depth", index)),
        None => Ok(render.iter().copied().zip(truth.iter().copied())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: f32 = f32::INFINITY;

    #[test]
    fn depth_error_counts_pixels_that_both_hit() {
        let value = depth_error(&[4.0, 9.0, 7.0, NOTHING], &[1.0, NOTHING, 3.0, 2.0]).unwrap();
        approx::assert_abs_diff_eq!(value, 12.5f64.sqrt(), epsilon = 1e-12);
        assert!(depth_error(&[NOTHING, 1.0], &[1.0, NOTHING]).is_err() && depth_error(&[], &[]).is_err());
    }

    #[test]
    fn silhouettes_count_misses_and_false_hits() {
        let value = silhouette_iou(&[1.0, 1.0, NOTHING, NOTHING], &[5.0, NOTHING, 5.0, f32::NAN]);
        assert_eq!(value, Ok(1.0 / 3.0));
        assert_eq!(silhouette_iou(&[NOTHING; 2], &[NOTHING; 2]), Ok(1.0));
        assert_eq!(silhouette_iou(&[1.0; 2], &[NOTHING; 2]), Ok(0.0));
    }

    #[test]
    fn broken_maps_are_refused() {
        assert_eq!(depth_error(&[1.0], &[1.0, 2.0]), Err(MetricError::length("rendered depth", 1, 2)));
        for broken in [[1.0, f32::NAN], [1.0, f32::NEG_INFINITY]] {
            assert_eq!(silhouette_iou(&broken, &broken), Err(MetricError::not_finite("rendered depth", 1)));
        }
    }
}
