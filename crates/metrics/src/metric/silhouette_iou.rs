use super::{Measure, Metric};
use crate::depth::{hits, pixels};
use crate::{Better, Descriptor, MetricError};

pub(super) const SILHOUETTE_IOU: Metric = Metric {
    descriptor: Descriptor {
        key: "silhouette_iou",
        name: "Silhouette IoU",
        unit: "",
        decimals: 3,
        better: Better::Higher,
    },
    definition: "pixels that hit something in both over pixels that hit something in either",
    measure: Measure::View(|view| view.depths().and_then(|(render, truth)| silhouette_iou(render, truth))),
};

/// Intersection over union of what the render and the truth hit, `|R ∩ T| / |R ∪ T|`, by finite depth; 1 where neither
/// hits anything.
///
/// # Errors
/// [`MetricError::Length`] when the maps differ in length, [`MetricError::NonFinite`] for a rendered depth that is NaN or
/// −∞.
pub fn silhouette_iou(render: &[f32], truth: &[f32]) -> Result<f64, MetricError> {
    let (mut both, mut either) = (0usize, 0usize);
    for (d, t) in pixels(render, truth)? {
        both += usize::from(hits(d) && hits(t));
        either += usize::from(hits(d) || hits(t));
    }
    Ok(if either == 0 { 1.0 } else { both as f64 / either as f64 })
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOTHING: f32 = f32::INFINITY;

    #[test]
    fn misses_and_false_hits_both_count() {
        let value = silhouette_iou(&[1.0, 1.0, NOTHING, NOTHING], &[5.0, NOTHING, 5.0, f32::NAN]);
        assert_eq!(value, Ok(1.0 / 3.0));
        assert_eq!(silhouette_iou(&[NOTHING; 2], &[NOTHING; 2]), Ok(1.0));
        assert_eq!(silhouette_iou(&[1.0; 2], &[NOTHING; 2]), Ok(0.0));
    }
}
