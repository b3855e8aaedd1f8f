//! All metrics. A new one is a file with a [`Metric`] constant, its `mod` line here, and a line in [`METRICS`], which all else reads.

mod average;
mod depth;
mod fid;
mod kid;
mod lpips;
mod psnr;
mod sharpness;
mod ssim;

pub use average::average;
pub use depth::{depth_error, silhouette_iou};
pub use fid::{INCEPTION_NETWORK, frechet_distance};
pub use kid::kernel_distance;
pub use lpips::{LPIPS_ALEX, LPIPS_ALEX_NETWORK, LPIPS_VGG, LPIPS_VGG_NETWORK};
pub use psnr::{PSNR, psnr, psnr_masked};
pub use sharpness::sharpness;
pub use ssim::{SSIM, ssim};

use crate::descriptor::Descriptor;
use crate::error::MetricError;
use crate::features::FeatureSet;
use crate::networks::PictureDistance;
use crate::view::PreparedView;

/// Every metric, in the order of records and tables.
pub const METRICS: &[&Metric] = &[
    &PSNR,
    &SSIM,
    &LPIPS_ALEX,
    &LPIPS_VGG,
    &average::AVERAGE,
    &sharpness::SHARPNESS,
    &psnr::PSNR_MASKED,
    &ssim::SSIM_MASKED,
    &lpips::LPIPS_ALEX_MASKED,
    &lpips::LPIPS_VGG_MASKED,
    &depth::DEPTH_ERROR,
    &depth::SILHOUETTE_IOU,
    &fid::FID,
    &kid::KID,
];

/// Metric of renders: name, definition and computation.
#[derive(Debug, Clone, Copy)]
pub struct Metric {
    /// Name and format.
    pub descriptor: Descriptor,
    /// Definition in one line.
    pub definition: &'static str,
    /// Computation.
    pub measure: Measure,
}

/// Function of a metric and its arguments. The value of a set of views is the mean over its views, except for [`Self::Set`].
#[derive(Debug, Clone, Copy)]
pub enum Measure {
    /// Function of a view.
    View(fn(&PreparedView<'_>) -> Result<f64, MetricError>),
    /// Function of a view and the named distance of [`crate::Networks`].
    Distance(&'static str, fn(&PreparedView<'_>, &PictureDistance) -> Result<f64, MetricError>),
    /// Function of the view's values of these metrics.
    Values(&'static [&'static Metric], fn(&[f64]) -> f64),
    /// Function of the features of all renders and of all truths by the named extractor of [`crate::Networks`].
    Set(&'static str, fn(&FeatureSet, &FeatureSet) -> Result<f64, MetricError>),
}

impl Metric {
    /// Returns the key in `results.json`.
    pub const fn key(&self) -> &'static str {
        self.descriptor.key
    }

    /// Returns the name of the network that the metric needs, if any.
    pub fn network(&self) -> Option<&'static str> {
        match self.measure {
            Measure::View(_) => None,
            Measure::Values(metrics, _) => metrics.iter().find_map(|metric| metric.network()),
            Measure::Distance(network, _) | Measure::Set(network, _) => Some(network),
        }
    }
}

/// Finds the metrics with these keys, in the order given.
///
/// # Errors
/// There is no metric with one of the keys; the message lists all keys.
pub fn select<'a>(keys: impl IntoIterator<Item = &'a str>) -> Result<Vec<&'static Metric>, MetricError> {
    let find = |key: &str| {
        let known = || METRICS.iter().map(|metric| metric.key()).collect::<Vec<_>>().join(", ");
        let unknown = || MetricError::other(format!("no metric is called `{key}`; known: {}", known()));
        METRICS.iter().copied().find(|metric| metric.key() == key).ok_or_else(unknown)
    };
    keys.into_iter().map(find).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn keys_and_headings_are_unique() {
        let keys: HashSet<&str> = METRICS.iter().map(|metric| metric.key()).collect();
        let headings: HashSet<String> = METRICS.iter().map(|metric| metric.descriptor.heading()).collect();
        assert_eq!((keys.len(), headings.len()), (METRICS.len(), METRICS.len()));
        assert!(keys.iter().all(|key| key.bytes().all(|b| b.is_ascii_lowercase() || b == b'_')), "{keys:?}");
    }

    #[test]
    fn metrics_are_found_by_key() {
        let keys: Vec<&str> = select(["ssim", "psnr"]).unwrap().iter().map(|metric| metric.key()).collect();
        assert_eq!(keys, ["ssim", "psnr"]);
        let networks = select(["psnr", "average", "lpips_alex_masked", "kid"]).unwrap();
        let networks: Vec<_> = networks.iter().map(|metric| metric.network()).collect();
        assert_eq!(networks, [None, Some(LPIPS_VGG_NETWORK), Some(LPIPS_ALEX_NETWORK), Some(INCEPTION_NETWORK)]);
        let error = select(["psnr", "vmaf"]).unwrap_err().to_string();
        assert!(error.starts_with("no metric is called `vmaf`; known: psnr, ssim,"), "{error}");
    }
}
