use std::collections::BTreeSet;

use indexmap::IndexMap;
use infonerf_metrics::Summary;

use crate::claim::{Claim, TestedClaim};
use crate::figures::Figure;
use crate::published::Published;
use crate::quantity::Quantity;
use crate::record::{Record, short_key};
use crate::text::counted;

const MAX_VARIANTS: usize = 64;

/// Runs of an experiment and everything else that its report shows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReportInput {
    /// Name of the experiment.
    pub experiment: String,
    /// Subject of the report; [`ReportInput::heading`] adds to it.
    pub title: String,
    /// Records of the runs, variants in the order in which they are shown.
    pub records: Vec<Record>,
    /// Warnings that are shown above all numbers, such as `procedural scenes`.
    pub warnings: Vec<String>,
    /// Charts in addition to those of every report.
    pub figures: Vec<Figure>,
    /// Figures of a paper, shown next to the runs.
    pub published: Option<Published>,
    /// Claims on the order of the variants, which the runs test.
    pub claims: Vec<Claim>,
    /// Command that made the runs, if it is known.
    pub command: Option<String>,
}

impl ReportInput {
    /// Makes the input of a report of `records`.
    pub fn new(experiment: &str, title: &str, records: Vec<Record>) -> Self {
        Self { experiment: experiment.into(), title: title.into(), records, ..Self::default() }
    }

    /// Returns the records of the runs that a page shows: all, or those of the 64 variants with the highest mean PSNR.
    pub fn shown_records(&self) -> Vec<&Record> {
        let mut values: IndexMap<(&str, &str), Vec<f64>> = IndexMap::new();
        for record in &self.records {
            values.entry((&record.variant, &record.preset)).or_default().extend(Quantity::PSNR.value(record));
        }
        let mean = |values: &Vec<f64>| Summary::of(values.iter().copied()).map_or(f64::NEG_INFINITY, |psnr| psnr.mean);
        values.sort_by(|_, a, _, b| mean(b).total_cmp(&mean(a)));
        values.truncate(MAX_VARIANTS);
        self.records.iter().filter(|record| values.contains_key(&(&*record.variant, &*record.preset))).collect()
    }

    /// Returns the title with the keys of a sweep and the number of training views, such as `NeRF by λ₁, 4 training views`.
    pub fn heading(&self) -> String {
        let settings = self.records.iter().filter_map(|record| record.setting.as_ref());
        let keys: BTreeSet<_> = settings.flat_map(|setting| setting.values.keys()).map(|key| short_key(key)).collect();
        let keys = keys.into_iter().collect::<Vec<_>>().join(", ");
        let title = if keys.is_empty() { self.title.clone() } else { format!("{} by {keys}", self.title) };
        let counts = || self.records.iter().map(|record| record.train_views.len());
        let views = match (counts().min(), counts().max()) {
            (None | Some(0), _) | (_, None) => return title,
            (Some(least), Some(most)) if least == most => counted(least, "training view"),
            (Some(least), Some(most)) => format!("{least} to {most} training views"),
        };
        format!("{title}, {views}")
    }

    /// Tests the claims on the runs.
    pub fn tested_claims(&self) -> Vec<TestedClaim> {
        self.claims.iter().map(|claim| claim.test(&self.records, self.published.as_ref())).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{record::Setting, table::tests::record};

    #[test]
    fn heading_of_a_sweep_names_its_keys() {
        let plain = record("lego", "nerf", 0, 15.0);
        let values = [("loss.entropy.weight".to_owned(), "1e-3".to_owned())].into_iter().collect();
        let swept = Record { setting: Some(Setting { variant: "nerf".into(), values }), ..plain.clone() };
        let heading = |record| ReportInput::new("e", "Four views", vec![record]).heading();
        assert_eq!(heading(plain), "Four views, 4 training views");
        assert_eq!(heading(swept), "Four views by λ₁, 4 training views");
    }

    #[test]
    fn page_shows_the_best_of_too_many_variants() {
        let records = (0..MAX_VARIANTS + 6).map(|i| record("lego", &i.to_string(), 0, i as f64)).collect();
        let input = ReportInput::new("e", "Sweep", records);
        let shown = input.shown_records();
        assert_eq!((shown.len(), shown[0].variant.as_str()), (MAX_VARIANTS, "6"));
    }
}
