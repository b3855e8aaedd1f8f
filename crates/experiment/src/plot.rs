//! The `[plot]` of an experiment file: PSNR over a number that its variants stand for.

use std::collections::BTreeMap;

use infonerf_report::chart::{Axis, ChartFrame, Series, line_chart};
use infonerf_report::{Figure, Quantity, Record, ReportError};
use serde::Deserialize;

use crate::sweep::figures::means;

/// Lines through the mean PSNR of variants.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Plot {
    /// Name of the number.
    x: String,
    /// Whether its axis is logarithmic.
    #[serde(default)]
    log: bool,
    /// Lines by name: its variants, each with its number.
    series: BTreeMap<String, BTreeMap<String, f64>>,
}

impl Plot {
    /// Returns the chart of `records`: means over scenes and seeds, as in the tables.
    pub(crate) fn figure(&self, records: &[Record]) -> Result<Figure, ReportError> {
        let means = means(records);
        let series = self.series.iter().map(|(name, variants)| {
            let point = |(variant, x): (&String, &f64)| Some((*x, *means.get(variant)?));
            let mut points: Vec<(f64, f64)> = variants.iter().filter_map(point).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            Series { name: name.clone(), points }
        });
        let x = if self.log { Axis::log(&self.x) } else { Axis::linear(&self.x) };
        let title = format!("{} by {}", Quantity::PSNR.heading(), self.x);
        let frame = ChartFrame { title: title.clone(), x, y: Axis::linear("PSNR (dB)") };
        let svg = line_chart(&frame, &series.collect::<Vec<_>>())?;
        Ok(Figure { name: "psnr-by".into(), title, svg, caption: "Means over scenes and seeds.".into() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variants_become_points() {
        let text = "x = 'views'\nlog = true\n[series]\nNeRF = { nerf-2 = 2, nerf-4 = 4, nerf-100 = 100 }";
        let plot: Plot = toml::from_str(text).unwrap();
        let record = |variant: &str, psnr| Record {
            variant: variant.into(),
            metrics: [("psnr".to_owned(), Some(psnr))].into_iter().collect(),
            ..Record::default()
        };
        let figure = plot.figure(&[record("nerf-4", 15.0), record("nerf-2", 12.0)]).unwrap();
        assert_eq!(figure.svg.matches("<circle").count(), 2);
        assert!(toml::from_str::<Plot>("x = 'views'").is_err());
    }
}
