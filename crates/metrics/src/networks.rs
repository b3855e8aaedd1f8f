use std::collections::BTreeMap;
use std::fmt;

use crate::error::MetricError;
use crate::picture::Picture;
use crate::protocol::Protocol;

/// Network that computes a distance between two images of the same size, such as LPIPS: 0 for identical ones, or an error of
/// one line if it cannot process images of that size.
pub type PictureDistance = dyn Fn(&Picture, &Picture, &Protocol) -> Result<f64, String> + Send + Sync;

/// Network that describes images by vectors of one length, such as Inception.
pub type FeatureExtractor = dyn Fn(&[&Picture]) -> Vec<Vec<f32>> + Send + Sync;

/// Networks with loaded weights, by name: `lpips-alex`, `lpips-vgg`, `inception-fid`. A metric whose network is not among them
/// has no value, and a note names the weights to fetch.
#[derive(Default)]
pub struct Networks {
    /// Distances between two images.
    pub distances: BTreeMap<&'static str, Box<PictureDistance>>,
    /// Feature extractors.
    pub extractors: BTreeMap<&'static str, Box<FeatureExtractor>>,
    /// Names of missing weights by the network that lacks only these, such as the heads of LPIPS.
    pub missing: BTreeMap<&'static str, &'static str>,
}

impl Networks {
    /// Returns an empty collection.
    pub fn none() -> Self {
        Self::default()
    }

    /// Finds the distance called `network`.
    ///
    /// # Errors
    /// If its weights are missing.
    pub fn distance(&self, network: &'static str) -> Result<&PictureDistance, MetricError> {
        self.distances.get(network).map(Box::as_ref).ok_or_else(|| self.no_weights(network))
    }

    /// Finds the feature extractor called `network`.
    ///
    /// # Errors
    /// If its weights are missing.
    pub fn extractor(&self, network: &'static str) -> Result<&FeatureExtractor, MetricError> {
        self.extractors.get(network).map(Box::as_ref).ok_or_else(|| self.no_weights(network))
    }

    fn no_weights(&self, network: &'static str) -> MetricError {
        let weights = self.missing.get(network).unwrap_or(&network);
        let ways = format!("`infonerf weights import FILE` or `infonerf weights fetch {weights}`");
        MetricError::other(format!("no weights of {weights}; {ways}"))
    }
}

impl fmt::Debug for Networks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.distances.keys().chain(self.extractors.keys())).finish()
    }
}
