use std::collections::BTreeMap;
use std::fmt;

use crate::error::MetricError;
use crate::picture::Picture;
use crate::protocol::Protocol;

/// Network that computes a distance between two images, such as LPIPS.
pub trait PictureDistance: Send + Sync {
    /// Computes the distance between two images of the same size; 0 for identical ones.
    ///
    /// # Errors
    /// One line if the network cannot process images of that size.
    fn distance(&self, render: &Picture, truth: &Picture, protocol: &Protocol) -> Result<f64, String>;
}

/// Network that describes images by vectors, such as Inception.
pub trait FeatureExtractor: Send + Sync {
    /// Computes one vector per image, all of the same length.
    ///
    /// # Errors
    /// One line if the network cannot process images of that size.
    fn features(&self, pictures: &[&Picture], protocol: &Protocol) -> Result<Vec<Vec<f32>>, String>;
}

/// Networks with loaded weights, by name: `lpips-alex`, `lpips-vgg`, `inception-fid`. A metric whose network is not among them
/// has no value, and a note names the weights to fetch.
#[derive(Default)]
pub struct Networks {
    distances: BTreeMap<&'static str, Box<dyn PictureDistance>>,
    extractors: BTreeMap<&'static str, Box<dyn FeatureExtractor>>,
    /// Weights that networks lack, by the network's name, if these are named otherwise.
    missing: BTreeMap<&'static str, &'static str>,
}

impl Networks {
    /// Returns an empty collection.
    #[must_use]
    pub fn none() -> Self {
        Self::default()
    }

    /// Adds or replaces the distance called `name`.
    #[must_use]
    pub fn with_distance(mut self, name: &'static str, network: Box<dyn PictureDistance>) -> Self {
        self.distances.insert(name, network);
        self
    }

    /// Adds or replaces the feature extractor called `name`.
    #[must_use]
    pub fn with_extractor(mut self, name: &'static str, network: Box<dyn FeatureExtractor>) -> Self {
        self.extractors.insert(name, network);
        self
    }

    /// Notes that `network` lacks only the weights called `weights`, such as the heads of LPIPS.
    #[must_use]
    pub fn with_missing(mut self, network: &'static str, weights: &'static str) -> Self {
        self.missing.insert(network, weights);
        self
    }

    /// Finds the distance called `network`.
    ///
    /// # Errors
    /// [`MetricError::NoWeights`].
    pub fn distance(&self, network: &'static str) -> Result<&dyn PictureDistance, MetricError> {
        self.distances.get(network).map(Box::as_ref).ok_or_else(|| self.no_weights(network))
    }

    /// Finds the feature extractor called `network`.
    ///
    /// # Errors
    /// [`MetricError::NoWeights`].
    pub fn extractor(&self, network: &'static str) -> Result<&dyn FeatureExtractor, MetricError> {
        self.extractors.get(network).map(Box::as_ref).ok_or_else(|| self.no_weights(network))
    }

    fn no_weights(&self, network: &'static str) -> MetricError {
        MetricError::NoWeights { weights: self.missing.get(network).unwrap_or(&network) }
    }
}

impl fmt::Debug for Networks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.distances.keys().chain(self.extractors.keys())).finish()
    }
}
