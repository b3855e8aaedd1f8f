//! Output of benchmarks: JSON, CSV and charts.

use std::fs;

use anyhow::{Context, Result};
use infonerf_report::TextTable;
use serde::Serialize;
use serde_json::Value;
use statrs::statistics::{Data, Median};

use crate::context::Bench;

impl Bench {
    /// Adds the machine, the description `protocol` and the `rows` to the object `results`, and writes it to `results.json`.
    pub(crate) fn save_results(
        &self,
        protocol: &str,
        rows: &(impl Serialize + ?Sized),
        mut results: Value,
    ) -> Result<()> {
        results["about"] = self.conditions();
        results["protocol"] = protocol.into();
        results["rows"] = serde_json::to_value(rows)?;
        self.save("results.json", &(serde_json::to_string_pretty(&results)? + "\n"))
    }

    pub(crate) fn save_csv(&self, table: &TextTable) -> Result<()> {
        self.save(&format!("{}.csv", self.name), &table.to_csv())
    }

    pub(crate) fn save(&self, name: &str, text: &str) -> Result<()> {
        let path = self.folder.join(name);
        fs::create_dir_all(&self.folder).with_context(|| self.folder.display().to_string())?;
        fs::write(&path, text).with_context(|| path.display().to_string())
    }
}

/// Formats a value, or `-` if it was not measured.
pub(crate) fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".into(), |value| format!("{value:.digits$}"))
}

/// Computes the median of `values`; 0 for none.
pub(crate) fn median(values: &[f64]) -> f64 {
    if values.is_empty() { 0.0 } else { Data::new(values.to_vec()).median() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_of_even_counts_are_means_of_two() {
        assert_eq!(median(&[3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&[4.0, 1.0, 2.0, 3.0]), 2.5);
        assert_eq!(median(&[]), 0.0);
    }
}
