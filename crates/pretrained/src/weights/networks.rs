use burn::tensor::Device;
use infonerf_metrics::{INCEPTION_NETWORK, LPIPS_ALEX_NETWORK, LPIPS_VGG_NETWORK, Metric, Networks, Picture, Protocol};

use super::{KnownWeights, Store, WeightsError};
use crate::inception::{Inception, InceptionConfig};
use crate::lpips::{Lpips, LpipsConfig};

impl Store {
    /// Reads to `device` the networks that `metrics` need and whose weights are present.
    ///
    /// # Errors
    /// If weights are present and cannot be read: broken files do not count as missing.
    pub fn networks(&self, metrics: &[&Metric], device: &Device) -> Result<Networks, WeightsError> {
        let is_needed = |name: &str| metrics.iter().any(|metric| metric.network() == Some(name));
        let mut networks = Networks::none();
        let lpips = [
            (LPIPS_ALEX_NETWORK, "lpips-alex-heads", LpipsConfig::alex()),
            (LPIPS_VGG_NETWORK, "lpips-vgg-heads", LpipsConfig::vgg()),
        ];
        for (name, heads, config) in lpips.into_iter().filter(|(name, ..)| is_needed(name)) {
            match (self.path(name), self.path(heads)) {
                (Some(backbone), Some(heads)) => {
                    let lpips = Lpips::read(&backbone, &heads, config, device).map_err(WeightsError)?;
                    let distance = move |render: &Picture, truth: &Picture, protocol: &Protocol| {
                        lpips.distance(render, truth, protocol.lpips_input)
                    };
                    networks.distances.insert(name, Box::new(distance));
                }
                (Some(_), None) => {
                    networks.missing.insert(name, heads);
                }
                (None, _) => {}
            }
        }
        if let (Some(path), true) = (self.path(INCEPTION_NETWORK), is_needed(INCEPTION_NETWORK)) {
            let inception = Inception::read(&path, InceptionConfig::FULL, device).map_err(WeightsError)?;
            let features = move |pictures: &[&Picture]| inception.features(pictures);
            networks.extractors.insert(INCEPTION_NETWORK, Box::new(features));
        }
        Ok(networks)
    }

    fn path(&self, name: &str) -> Option<std::path::PathBuf> {
        self.find(KnownWeights::named(name)?)
    }
}
