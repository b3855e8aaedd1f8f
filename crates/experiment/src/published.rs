//! A paper's published figures in an experiment file, and how the paper's protocol differs from that of our runs.

use std::collections::BTreeMap;

use indexmap::{IndexMap, IndexSet};
use infonerf_metrics::Summary;
use infonerf_report::{Published, PublishedRow, Quantity};
use infonerf_schedule::Moment;
use serde::Deserialize;

use crate::run_plan::RunPlan;

/// The `[paper]` of an experiment file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Paper {
    /// Name of the paper and its table.
    source: String,
    /// Means by variant over the paper's scenes.
    #[serde(default)]
    figures: BTreeMap<String, Figures>,
    /// Figures by scene and variant.
    #[serde(default)]
    scenes: BTreeMap<String, BTreeMap<String, Figures>>,
    /// Description of each aspect of the paper's protocol. Aspects that are left out are not compared.
    #[serde(default)]
    pub(crate) protocol: BTreeMap<Aspect, String>,
    /// Further remarks.
    #[serde(default)]
    notes: Vec<String>,
}

type Figures = IndexMap<Quantity, PublishedFigure>;

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
enum PublishedFigure {
    Mean(f64),
    /// Mean and standard deviation.
    Spread([f64; 2]),
}

/// Aspect of a protocol that figures depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Aspect {
    Scenes,
    Images,
    TrainViews,
    TestViews,
    ViewSets,
    Field,
    Samples,
    Training,
    Weights,
    Priors,
}

impl Paper {
    /// Returns the paper's figures, with each difference between its protocol and that of `runs`.
    pub(crate) fn to_published(&self, runs: &[&RunPlan]) -> Published {
        let means = self.figures.iter().map(|figures| row(figures, None));
        let of_scenes = self.scenes.iter().flat_map(|(scene, rows)| rows.iter().map(|of| row(of, Some(scene.clone()))));
        let differences = self.protocol.iter().filter_map(|(aspect, there)| {
            let (what, here) = aspect.describe(runs);
            here.filter(|here| here != there).map(|here| format!("{what}: {here} here; {there} in the paper."))
        });
        Published {
            source: self.source.clone(),
            rows: means.chain(of_scenes).collect(),
            footnotes: differences.chain(self.notes.iter().cloned()).collect(),
        }
    }
}

fn row((variant, figures): (&String, &Figures), scene: Option<String>) -> PublishedRow {
    let summary = |figure: &PublishedFigure| match *figure {
        PublishedFigure::Mean(mean) => Summary { mean, std: None, n: 1 },
        PublishedFigure::Spread([mean, std]) => Summary { mean, std: Some(std), n: 1 },
    };
    let figures = figures.iter().map(|(quantity, figure)| (*quantity, summary(figure))).collect();
    PublishedRow { variant: variant.clone(), scene, figures }
}

impl Aspect {
    /// Returns the heading of the aspect, and its description for `runs` (`None` if it is unknown before scenes are read).
    fn describe(self, runs: &[&RunPlan]) -> (&'static str, Option<String>) {
        let all = |describe: fn(&RunPlan) -> String| Some(distinct(runs, describe).join(" or "));
        match self {
            Self::Scenes => {
                let own = if runs.iter().any(|plan| plan.data.is_none()) { "built-in: " } else { "" };
                ("Scenes", Some(format!("{own}{}", distinct(runs, |plan| plan.scene.clone()).join(", "))))
            }
            Self::Images => (
                "Images",
                all(|plan| match plan.config.scene.size {
                    0 => "as they are".into(),
                    size => format!("{size} pixels"),
                }),
            ),
            Self::TrainViews => {
                let known = runs.iter().all(|plan| plan.config.scene.views.count().is_some());
                let count = |plan: &RunPlan| plan.config.scene.views.count().unwrap_or_default().to_string();
                ("Training views", all(count).filter(|_| known))
            }
            Self::TestViews => ("Test views", all(|plan| plan.config.eval.test.to_string())),
            Self::ViewSets => {
                ("Sets of training views", Some(distinct(runs, |plan| plan.seed.to_string()).len().to_string()))
            }
            Self::Field => ("Field", all(|plan| plan.config.field.to_string())),
            Self::Samples => (
                "Samples",
                all(|plan| {
                    let coarse = plan.config.render.samples.at(Moment::END).round();
                    match plan.config.render.fine_samples {
                        0 => format!("at most {coarse} per ray"),
                        fine => format!("{coarse} coarse and {fine} fine per ray"),
                    }
                }),
            ),
            Self::Training => ("Training", all(RunPlan::training)),
            Self::Weights => ("Weights", Some(weights(runs))),
            Self::Priors => ("Other losses", Some(priors(runs))),
        }
    }
}

/// Terms of the paper's objective, each with the paper's symbol for its weight.
const PAPER_TERMS: [(&str, &str); 3] = [("rgb", ""), ("entropy", "λ₁"), ("kl", "λ₂")];

/// Describes the weights of the paper's losses that are on, such as `λ₁ = 0.001`.
fn weights(runs: &[&RunPlan]) -> String {
    let of = |(term, symbol): (&str, &str)| {
        let weight = |plan: &&RunPlan| {
            let (_, spec) = plan.config.loss.active().find(|(name, _)| *name == term)?;
            Some(spec.weight().largest().to_string())
        };
        let values = Vec::from_iter(runs.iter().filter_map(weight).collect::<IndexSet<String>>());
        (!values.is_empty() && !symbol.is_empty()).then(|| format!("{symbol} = {}", values.join(" or ")))
    };
    PAPER_TERMS.into_iter().filter_map(of).collect::<Vec<_>>().join(", ")
}

/// Lists the active terms of the objective that are not the paper's, or `none`.
fn priors(runs: &[&RunPlan]) -> String {
    let names = runs.iter().flat_map(|plan| plan.config.loss.active().map(|(name, _)| name));
    let others = names.filter(|name| PAPER_TERMS.iter().all(|(paper, _)| paper != name));
    let terms: IndexSet<&str> = others.collect();
    if terms.is_empty() { "none".to_owned() } else { Vec::from_iter(terms).join(", ") }
}

fn distinct(runs: &[&RunPlan], key: impl Fn(&RunPlan) -> String) -> Vec<String> {
    runs.iter().map(|plan| key(plan)).collect::<IndexSet<String>>().into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Experiment;
    use crate::testing::selected;

    #[test]
    fn figures_and_differences() {
        let text = "source = 'Table 1'\nnotes = ['n']\n[figures.nerf]\npsnr = [15.93, 1.06]\nlpips_vgg = 0.32\n\
                    [scenes.lego.nerf]\npsnr = 15.61\n[protocol]\nimages = '800 pixels'\nview_sets = '5'\n";
        let paper: Paper = toml::from_str(text).unwrap();
        let published = paper.to_published(&[]);
        let psnr = (Quantity::PSNR, Summary { mean: 15.93, std: Some(1.06), n: 1 });
        assert!(published.rows[0].figures.contains(&psnr));
        assert_eq!((published.rows[0].figures.len(), published.rows[1].scene.as_deref()), (2, Some("lego")));
        assert!(toml::from_str::<Paper>("source = 'x'\n[figures.nerf]\nvmaf = 90.0").is_err());
        assert!(published.footnotes.contains(&"Sets of training views: 0 here; 5 in the paper.".into()));
        assert_eq!(published.footnotes.last().map(String::as_str), Some("n"));
        assert!(toml::from_str::<Paper>("source = 'x'\npages = 3").is_err());
    }

    #[test]
    fn other_training_views_than_the_papers_are_noted() {
        let noted = |set: &[&str]| {
            let plan = Experiment::plan("synthetic-4view", &selected(&[], &[], set)).unwrap();
            let published = plan.about.paper.unwrap().to_published(&plan.runs.iter().collect::<Vec<_>>());
            published.footnotes.into_iter().find(|note| note.starts_with("Training views"))
        };
        assert_eq!(noted(&[]), None);
        assert_eq!(noted(&["scene.views=26,86"]).as_deref(), Some("Training views: 2 here; 4 in the paper."));
    }

    #[test]
    fn every_active_term_is_listed() {
        let set = ["loss.semantic.weight=0.1", "loss.tv.weight=1", "loss.silhouette.weight=0"];
        let runs = Experiment::plan("fast-losses", &selected(&[], &["factored"], &set)).unwrap().runs;
        assert_eq!(priors(&runs.iter().collect::<Vec<_>>()), "semantic, tv");
    }
}
