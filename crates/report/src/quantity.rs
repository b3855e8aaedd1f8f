use std::ops::Deref;

use infonerf_metrics::{Better, Descriptor, METRICS};
use serde::{Deserialize, Deserializer, de};

use crate::record::Record;

/// Number of a [`Record`] that reports show: a metric of [`METRICS`], a statistic of test rays, or a cost. Files name it by key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Quantity(Descriptor);

const fn quantity([key, name, unit]: [&'static str; 3], decimals: usize, better: Better) -> Quantity {
    Quantity(Descriptor { key, name, unit, decimals, better })
}

/// Statistics of test rays (the paper's Figure A).
const OF_RAYS: [Quantity; 2] = [
    quantity(["ray_entropy_bits", "Ray entropy", "bits"], 2, Better::Lower),
    quantity(["information_gain", "Information gain", ""], 3, Better::Lower),
];

const COSTS: [Quantity; 4] = [
    Quantity::TRAIN_SECONDS,
    quantity(["render_seconds_per_image", "Render", "s/image"], 2, Better::Lower),
    quantity(["samples_skipped", "Samples skipped", "×"], 1, Better::Higher),
    quantity(["peak_memory", "Peak memory", "MiB"], 0, Better::Lower),
];

impl Quantity {
    /// Peak signal-to-noise ratio.
    pub const PSNR: Self = Self(infonerf_metrics::PSNR.descriptor);
    /// Structural similarity.
    pub const SSIM: Self = Self(infonerf_metrics::SSIM.descriptor);
    /// Mean entropy of the ray distribution.
    pub const RAY_ENTROPY: Self = OF_RAYS[0];
    /// Wall-clock time of training.
    pub const TRAIN_SECONDS: Self = quantity(["train_seconds", "Training", "s"], 1, Better::Lower);

    /// Returns the metrics, and the statistics of the paper's Figure A.
    pub fn quality() -> Vec<Self> {
        METRICS.iter().map(|metric| Self(metric.descriptor)).chain(OF_RAYS).collect()
    }

    /// Returns the costs of a run: time, samples, memory.
    pub fn cost() -> Vec<Self> {
        COSTS.to_vec()
    }

    /// Returns every quantity, in the order of a report.
    pub fn all() -> Vec<Self> {
        [Self::quality(), Self::cost()].concat()
    }

    /// Returns the quantity of this key.
    pub fn named(key: &str) -> Option<Self> {
        Self::all().into_iter().find(|quantity| quantity.key == key)
    }

    /// Returns the value of the quantity in a run; `None` if it was not computed.
    pub fn value(self, record: &Record) -> Option<f64> {
        let value = match self.key {
            "ray_entropy_bits" => record.ray_entropy_bits,
            "information_gain" => record.information_gain,
            "train_seconds" => Some(record.train_seconds),
            "render_seconds_per_image" => Some(record.render_seconds_per_image),
            "samples_skipped" => Some(record.samples_total as f64 / record.samples_evaluated as f64),
            "peak_memory" => record.peak_rss_bytes.map(|bytes| bytes as f64 / f64::from(1 << 20)),
            metric => record.metrics.get(metric).copied().flatten(),
        };
        value.filter(|value| value.is_finite())
    }

    /// Returns the name with its unit, such as `PSNR (dB)`.
    pub fn name(self) -> String {
        let Descriptor { name, unit, .. } = self.0;
        if unit.is_empty() { name.to_owned() } else { format!("{name} ({unit})") }
    }
}

impl Deref for Quantity {
    type Target = Descriptor;

    fn deref(&self) -> &Descriptor {
        &self.0
    }
}

impl<'de> Deserialize<'de> for Quantity {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let key = String::deserialize(deserializer)?;
        let known = || Self::all().into_iter().map(|quantity| quantity.key).collect::<Vec<_>>().join(", ");
        Self::named(&key).ok_or_else(|| de::Error::custom(format!("expected one of {}, found {key:?}", known())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_unique_and_found() {
        let all = Quantity::all();
        for quantity in &all {
            assert_eq!(Quantity::named(quantity.key), Some(*quantity));
        }
        let keys: std::collections::HashSet<&str> = all.iter().map(|quantity| quantity.key).collect();
        assert_eq!(keys.len(), all.len());
    }

    #[test]
    fn a_record_has_metrics_and_costs() {
        let record = Record {
            metrics: [("psnr".to_owned(), Some(20.0)), ("fid".to_owned(), None)].into_iter().collect(),
            train_seconds: 2.0,
            samples_total: 10,
            samples_evaluated: 0,
            ..Record::default()
        };
        let value = |key| Quantity::named(key).unwrap().value(&record);
        assert_eq!(["psnr", "fid", "ssim", "train_seconds"].map(value), [Some(20.0), None, None, Some(2.0)]);
        assert_eq!(value("samples_skipped"), None, "nothing was evaluated");
    }
}
