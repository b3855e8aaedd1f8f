//! The metrics, one file each.
//!
//! A new one is a file with a [`Metric`] constant, its `mod` line here, and its line in [`METRICS`]: records, tables,
//! `eval` and notes follow from the list.

mod average;
mod depth_error;
mod fid;
mod gmsd;
mod kid;
mod lpips;
mod ms_ssim;
mod psnr;
mod sharpness;
mod silhouette_iou;
mod ssim;

pub use average::average;
pub use depth_error::depth_error;
pub use fid::{INCEPTION_NETWORK, frechet_distance};
pub use gmsd::gmsd;
pub use kid::{kernel_distance, maximum_mean_discrepancy};
pub use lpips::{LPIPS_ALEX, LPIPS_ALEX_NETWORK, LPIPS_VGG, LPIPS_VGG_NETWORK};
pub use psnr::{PSNR, psnr, psnr_masked};
pub use sharpness::{mean_gradient, sharpness};
pub use silhouette_iou::silhouette_iou;
pub use ssim::{SSIM, ssim};

use crate::{Descriptor, Features, MetricError, PictureDistance, View};

/// Every metric, in the order of records and tables.
pub const METRICS: &[&Metric] = &[
    &PSNR,
    &SSIM,
    &LPIPS_ALEX,
    &LPIPS_VGG,
    &average::AVERAGE,
    &ms_ssim::MS_SSIM,
    &gmsd::GMSD,
    &sharpness::SHARPNESS,
    &psnr::PSNR_MASKED,
    &ssim::SSIM_MASKED,
    &lpips::LPIPS_ALEX_MASKED,
    &lpips::LPIPS_VGG_MASKED,
    &depth_error::DEPTH_ERROR,
    &silhouette_iou::SILHOUETTE_IOU,
    &fid::FID,
    &kid::KID,
];

/// A number that says how good renders are.
#[derive(Debug, Clone, Copy)]
pub struct Metric {
    /// How it is called and shown.
    pub descriptor: Descriptor,
    /// What it is, in one line.
    pub definition: &'static str,
    /// How it is computed.
    pub measure: Measure,
}

/// What a metric is a function of. The value of a set is the mean over its views, unless it is a function of the set.
#[derive(Debug, Clone, Copy)]
pub enum Measure {
    /// One view.
    View(fn(&View<'_>) -> Result<f64, MetricError>),
    /// One view, and the distance of that name among [`crate::Networks`].
    Distance(&'static str, fn(&View<'_>, &dyn PictureDistance) -> Result<f64, MetricError>),
    /// The values that these metrics have for the view.
    Values(&'static [&'static Metric], fn(&[f64]) -> f64),
    /// What the feature extractor of that name makes of all renders and of all truths.
    Set(&'static str, fn(&Features, &Features) -> Result<f64, MetricError>),
}

impl Metric {
    /// Key in `results.json`.
    pub const fn key(&self) -> &'static str {
        self.descriptor.key
    }

    /// Name of the network that it needs.
    pub fn network(&self) -> Option<&'static str> {
        match self.measure {
            Measure::View(_) => None,
            Measure::Values(metrics, _) => metrics.iter().find_map(|metric| metric.network()),
            Measure::Distance(network, _) | Measure::Set(network, _) => Some(network),
        }
    }
}

/// The metrics with these keys, in the order given.
///
/// # Errors
/// [`MetricError::UnknownMetric`].
pub fn select<'a>(keys: impl IntoIterator<Item = &'a str>) -> Result<Vec<&'static Metric>, MetricError> {
    let find = |key: &str| {
        let known = || METRICS.iter().map(|metric| metric.key()).collect::<Vec<_>>().join(", ");
        let unknown = || MetricError::UnknownMetric { key: key.to_owned(), known: known() };
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
        let error = select(["psnr", "vmaf"]).unwrap_err().to_string();
        assert!(error.starts_with("no metric is called `vmaf`; known: psnr, ssim,"), "{error}");
    }
}
