use std::collections::BTreeMap;
use std::fmt;

use crate::{MetricError, Picture, Protocol};

/// A network that says how different two pictures look, such as LPIPS.
pub trait PictureDistance: Send + Sync {
    /// Distance between two pictures of the same size; 0 for the same picture.
    ///
    /// # Errors
    /// One line if it cannot look at pictures of that size.
    fn distance(&self, render: &Picture, truth: &Picture, protocol: &Protocol) -> Result<f64, String>;
}

/// A network that describes pictures by vectors, such as Inception.
pub trait FeatureExtractor: Send + Sync {
    /// One vector per picture, all of the same length.
    ///
    /// # Errors
    /// One line if it cannot look at pictures of that size.
    fn features(&self, pictures: &[&Picture], protocol: &Protocol) -> Result<Vec<Vec<f32>>, String>;
}

/// The networks at hand, by the name that their weights have: `lpips-alex`, `lpips-vgg`, `inception-fid`. A metric whose
/// network is not among them has no value, and says how to get its weights.
#[derive(Default)]
pub struct Networks {
    distances: BTreeMap<&'static str, Box<dyn PictureDistance>>,
    extractors: BTreeMap<&'static str, Box<dyn FeatureExtractor>>,
}

impl Networks {
    /// None at all.
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

    /// The distance called `network`.
    ///
    /// # Errors
    /// [`MetricError::NoWeights`].
    pub fn distance(&self, network: &'static str) -> Result<&dyn PictureDistance, MetricError> {
        self.distances.get(network).map(Box::as_ref).ok_or(MetricError::NoWeights { network })
    }

    /// The feature extractor called `network`.
    ///
    /// # Errors
    /// [`MetricError::NoWeights`].
    pub fn extractor(&self, network: &'static str) -> Result<&dyn FeatureExtractor, MetricError> {
        self.extractors.get(network).map(Box::as_ref).ok_or(MetricError::NoWeights { network })
    }
}

impl fmt::Debug for Networks {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.distances.keys().chain(self.extractors.keys())).finish()
    }
}
