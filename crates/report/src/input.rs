use std::{borrow::Cow, collections::HashSet};

use indexmap::IndexMap;

use crate::{Claim, Figure, Published, Quantity, Record, Run, TestedClaim};

/// Variants that a page shows, at most.
const MOST_VARIANTS: usize = 64;

/// What a report is made of.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ReportInput {
    /// Name of the experiment.
    pub experiment: String,
    /// What the report shows; its heading adds the number of training views.
    pub title: String,
    /// The runs, variants in the order in which they are to be shown.
    pub runs: Vec<Run>,
    /// What a reader must know before the numbers, such as `procedural scenes`; shown at the top.
    pub warnings: Vec<String>,
    /// Charts beyond those that every report has.
    pub figures: Vec<Figure>,
    /// What a paper found, to stand beside the runs.
    pub published: Option<Published>,
    /// What it says about the order of the variants, to be tested on the runs.
    pub claims: Vec<Claim>,
    /// How many test views of each scene are shown.
    pub views: usize,
}

impl ReportInput {
    /// A report of `records`, each in its usual folder, with three views a scene.
    #[must_use]
    pub fn new(experiment: &str, title: &str, records: Vec<Record>) -> Self {
        Self {
            experiment: experiment.into(),
            title: title.into(),
            runs: records.into_iter().map(Run::from).collect(),
            warnings: Vec::new(),
            figures: Vec::new(),
            published: None,
            claims: Vec::new(),
            views: 3,
        }
    }

    /// The same with the runs that a page shows: of too many variants those with the highest mean PSNR, and a warning that
    /// says so.
    pub fn shown(&self) -> Cow<'_, Self> {
        let mut means: IndexMap<(&str, &str), Vec<f64>> = IndexMap::new();
        let key = |run: &'_ Run| (run.record.variant.clone(), run.record.preset.clone());
        for Run { record, .. } in &self.runs {
            let values = means.entry((&record.variant, &record.preset)).or_default();
            values.extend(Quantity::PSNR.value(record));
        }
        let count = means.len();
        if count <= MOST_VARIANTS {
            return Cow::Borrowed(self);
        }
        let mean = |values: &Vec<f64>| match values.len() {
            0 => f64::NEG_INFINITY,
            count => values.iter().sum::<f64>() / count as f64,
        };
        means.sort_by(|_, a, _, b| mean(b).total_cmp(&mean(a)));
        let best: HashSet<(String, String)> =
            means.keys().take(MOST_VARIANTS).map(|(variant, preset)| ((*variant).into(), (*preset).into())).collect();
        let mut shown =
            Self { runs: self.runs.iter().filter(|run| best.contains(&key(run))).cloned().collect(), ..self.clone() };
        shown.warnings.push(format!(
            "Shown are the {MOST_VARIANTS} variants with the highest PSNR, of {count}: the others are in results.json."
        ));
        Cow::Owned(shown)
    }

    /// The title with how many views the runs were trained on, such as `NeRF and InfoNeRF, 4 training views`.
    pub fn heading(&self) -> String {
        let counts = || self.runs.iter().map(|run| run.record.train_views.len());
        let views = match (counts().min(), counts().max()) {
            (None | Some(0), _) | (_, None) => return self.title.clone(),
            (Some(1), Some(1)) => "1 training view".to_owned(),
            (Some(least), Some(most)) if least == most => format!("{least} training views"),
            (Some(least), Some(most)) => format!("{least} to {most} training views"),
        };
        format!("{}, {views}", self.title)
    }

    /// The claims with what the runs say of them.
    pub fn tested_claims(&self) -> Vec<TestedClaim> {
        let records: Vec<Record> = self.runs.iter().map(|run| run.record.clone()).collect();
        self.claims.iter().map(|claim| claim.test(&records, self.published.as_ref())).collect()
    }
}
