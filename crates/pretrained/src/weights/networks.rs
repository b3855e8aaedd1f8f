use burn::tensor::Device;
use infonerf_metrics::{INCEPTION_NETWORK, LPIPS_ALEX_NETWORK, LPIPS_VGG_NETWORK, Metric, Networks};

use super::{KnownWeights, Store, WeightsError};
use crate::{Inception, InceptionConfig, Lpips, LpipsConfig};

impl Store {
    /// The networks that `metrics` need, of those whose weights are here, on `device`.
    ///
    /// # Errors
    /// If weights are here and cannot be read: what is broken is not taken for missing.
    pub fn networks(&self, metrics: &[&Metric], device: &Device) -> Result<Networks, WeightsError> {
        let is_needed = |name: &str| metrics.iter().any(|metric| metric.network() == Some(name));
        let mut networks = Networks::none();
        for (name, config) in [(LPIPS_ALEX_NETWORK, LpipsConfig::alex()), (LPIPS_VGG_NETWORK, LpipsConfig::vgg())] {
            let files = [self.path(name), self.path(&format!("{name}-heads"))];
            if let ([Some(backbone), Some(heads)], true) = (files, is_needed(name)) {
                let lpips = Lpips::read(&backbone, &heads, config, device).map_err(WeightsError::Network)?;
                networks = networks.with_distance(name, Box::new(lpips));
            }
        }
        if let (Some(path), true) = (self.path(INCEPTION_NETWORK), is_needed(INCEPTION_NETWORK)) {
            let inception = Inception::read(&path, InceptionConfig::FULL, device).map_err(WeightsError::Network)?;
            networks = networks.with_extractor(INCEPTION_NETWORK, Box::new(inception));
        }
        Ok(networks)
    }

    fn path(&self, name: &str) -> Option<std::path::PathBuf> {
        self.find(KnownWeights::named(name)?)
    }
}
