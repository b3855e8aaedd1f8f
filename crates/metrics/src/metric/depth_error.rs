use super::{Measure, Metric};
use crate::depth::{hits, pixels};
use crate::{Better, Descriptor, MetricError};

pub(super) const DEPTH_ERROR: Metric = Metric {
    descriptor: Descriptor { key: "depth_error", name: "Depth error", unit: "", decimals: 3, better: Better::Lower },
    definition: "RMSE of distance along the ray, scene units, where both render and truth hit something",
    measure: Measure::View(|view| view.depths().and_then(|(render, truth)| depth_error(render, truth))),
};

/// Root mean square error of depth, in the unit of the scene, over the pixels where both the render and the truth hit
/// something.
///
/// `RMSE = sqrt(Σ_i h_i (d_i − d*_i)² / Σ_i h_i)`, `h_i = 1` where both depths are finite: a ray that hits nothing has
/// depth +∞. What one of them misses is the matter of [`crate::silhouette_iou`].
///
/// # Errors
/// [`MetricError::Length`] when the maps differ in length, [`MetricError::NonFinite`] for a rendered depth that is NaN or
/// −∞, [`MetricError::NothingHit`] when there is no such pixel.
pub fn depth_error(render: &[f32], truth: &[f32]) -> Result<f64, MetricError> {
    let (mut squares, mut count) = (0.0, 0usize);
    for (d, t) in pixels(render, truth)?.filter(|&(d, t)| hits(d) && hits(t)) {
        squares += (f64::from(d) - f64::from(t)).powi(2);
        count += 1;
    }
    if count == 0 { Err(MetricError::NothingHit) } else { Ok((squares / count as f64).sqrt()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: f32 = f32::INFINITY;

    #[test]
    fn only_what_both_hit_counts() {
        let value = depth_error(&[4.0, 9.0, 7.0, NOTHING], &[1.0, NOTHING, 3.0, 2.0]).unwrap();
        approx::assert_abs_diff_eq!(value, 12.5f64.sqrt(), epsilon = 1e-12);
    }

    #[test]
    fn a_render_that_misses_everything_has_no_error() {
        assert_eq!(depth_error(&[NOTHING, 1.0], &[1.0, NOTHING]), Err(MetricError::NothingHit));
        assert_eq!(depth_error(&[], &[]), Err(MetricError::NothingHit));
    }
}
