//! A paper's published figures, as an experiment file holds them, and how its protocol differs from ours.

use std::collections::BTreeMap;

use indexmap::IndexMap;
use infonerf_metrics::Summary;
use infonerf_report::{Published, PublishedRow, Quantity};
use infonerf_schedule::Moment;
use serde::Deserialize;

use crate::RunPlan;

/// The `[paper]` of an experiment file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Paper {
    /// Paper and table.
    source: String,
    /// Means by variant over the paper's scenes.
    #[serde(default)]
    figures: BTreeMap<String, Figures>,
    /// Figures by scene and variant.
    #[serde(default)]
    scenes: BTreeMap<String, BTreeMap<String, Figures>>,
    /// How the figures were obtained.
    #[serde(default)]
    protocol: PublishedProtocol,
    /// Further remarks.
    #[serde(default)]
    notes: Vec<String>,
}

/// A row of a paper's table.
#[derive(Clone, Debug, Deserialize)]
struct Figures(IndexMap<Quantity, PublishedFigure>);

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
enum PublishedFigure {
    Mean(f64),
    /// Mean and standard deviation.
    Spread([f64; 2]),
}

/// A protocol in words: all that figures depend on. Parts that a paper's protocol leaves out are not compared.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct PublishedProtocol {
    scenes: Option<String>,
    images: Option<String>,
    train_views: Option<String>,
    test_views: Option<String>,
    view_sets: Option<String>,
    field: Option<String>,
    samples: Option<String>,
    training: Option<String>,
    weights: Option<String>,
    priors: Option<String>,
}

impl Paper {
    /// Returns the paper's figures, with each difference between its protocol and that of `runs`.
    pub(crate) fn beside(&self, runs: &[&RunPlan]) -> Published {
        let means = self.figures.iter().map(|(variant, figures)| figures.row(variant, None));
        let of_scenes = self.scenes.iter().flat_map(|(scene, variants)| {
            variants.iter().map(move |(variant, figures)| figures.row(variant, Some(scene.clone())))
        });
        let differences = self.protocol.differences(&PublishedProtocol::of(runs));
        Published {
            source: self.source.clone(),
            rows: means.chain(of_scenes).collect(),
            footnotes: differences.into_iter().chain(self.notes.iter().cloned()).collect(),
        }
    }
}

impl Figures {
    fn row(&self, variant: &str, scene: Option<String>) -> PublishedRow {
        let summary = |figure: &PublishedFigure| match *figure {
            PublishedFigure::Mean(mean) => Summary { mean, std: None, n: 1 },
            PublishedFigure::Spread([mean, std]) => Summary { mean, std: Some(std), n: 1 },
        };
        let figures = self.0.iter().map(|(quantity, figure)| (*quantity, summary(figure))).collect();
        PublishedRow { variant: variant.to_owned(), scene, figures }
    }
}

impl PublishedProtocol {
    /// Returns the protocol of `runs`.
    fn of(runs: &[&RunPlan]) -> Self {
        let all = |describe: fn(&RunPlan) -> String| Some(distinct(runs, describe).join(" or "));
        let views = |plan: &RunPlan| plan.config.scene.views.count();
        let own = if runs.iter().any(|plan| plan.data.is_none()) { "built-in: " } else { "" };
        let seeds = distinct(runs, |plan| plan.seed.to_string()).len();
        Self {
            scenes: Some(format!("{own}{}", distinct(runs, |plan| plan.scene.clone()).join(", "))),
            images: all(|plan| match plan.config.scene.size {
                0 => "as they are".into(),
                size => format!("{size} pixels"),
            }),
            train_views: runs
                .iter()
                .all(|plan| views(plan).is_some())
                .then(|| distinct(runs, |plan| views(plan).unwrap_or_default().to_string()).join(" or ")),
            test_views: all(|plan| plan.config.eval.test.to_string()),
            view_sets: Some(format!("{seeds}")),
            field: all(|plan| plan.config.field.to_string()),
            samples: all(|plan| {
                let coarse = plan.config.render.samples.at(Moment::END).round();
                match plan.config.render.fine_samples {
                    0 => format!("at most {coarse} per ray"),
                    fine => format!("{coarse} coarse and {fine} fine per ray"),
                }
            }),
            training: all(|plan| match plan.budget {
                Some(seconds) => format!("{seconds} s"),
                None => format!("{} steps of {} seen rays", plan.config.train.iterations, plan.config.train.rays),
            }),
            weights: Some(weights(runs)),
            priors: Some(priors(runs)),
        }
    }

    /// Returns one line for each difference.
    fn differences(&self, ours: &Self) -> Vec<String> {
        let both = [
            ("Scenes", &ours.scenes, &self.scenes),
            ("Images", &ours.images, &self.images),
            ("Training views", &ours.train_views, &self.train_views),
            ("Test views", &ours.test_views, &self.test_views),
            ("Sets of training views", &ours.view_sets, &self.view_sets),
            ("Field", &ours.field, &self.field),
            ("Samples", &ours.samples, &self.samples),
            ("Training", &ours.training, &self.training),
            ("Weights", &ours.weights, &self.weights),
            ("Other losses", &ours.priors, &self.priors),
        ];
        let line = |(what, here, there): (&str, &Option<String>, &Option<String>)| {
            let (here, there) = (here.as_ref()?, there.as_ref()?);
            (here != there).then(|| format!("{what}: {here} here; {there} in the paper."))
        };
        both.into_iter().filter_map(line).collect()
    }
}

/// Terms of the paper's objective, and how it calls their weights.
const PAPER_TERMS: [(&str, &str); 3] = [("rgb", ""), ("entropy", "λ₁"), ("kl", "λ₂")];

/// Returns the weights of the paper's losses, where they are on.
fn weights(runs: &[&RunPlan]) -> String {
    let of = |(term, symbol): (&str, &str)| {
        let weight = |plan: &RunPlan| {
            let terms = plan.config.loss.active();
            terms.filter(|(name, _)| *name == term).map(|(_, spec)| spec.weight().largest()).next()
        };
        let on: Vec<&RunPlan> = runs.iter().copied().filter(|plan| weight(plan).is_some()).collect();
        let values = distinct(&on, |plan| weight(plan).unwrap_or(0.0).to_string());
        (!values.is_empty() && !symbol.is_empty()).then(|| format!("{symbol} = {}", values.join(" or ")))
    };
    PAPER_TERMS.into_iter().filter_map(of).collect::<Vec<_>>().join(", ")
}

/// Terms of the objective that are not the paper's.
fn priors(runs: &[&RunPlan]) -> String {
    let names = runs.iter().flat_map(|plan| plan.config.loss.active().map(|(name, _)| name));
    let mut terms: Vec<&str> = Vec::new();
    for name in names.filter(|name| PAPER_TERMS.iter().all(|(paper, _)| paper != name)) {
        if !terms.contains(&name) {
            terms.push(name);
        }
    }
    if terms.is_empty() { "none".to_owned() } else { terms.join(", ") }
}

/// Returns the values of `key`, each once, in order of appearance.
fn distinct(runs: &[&RunPlan], key: impl Fn(&RunPlan) -> String) -> Vec<String> {
    let mut values: Vec<String> = Vec::new();
    for value in runs.iter().map(|plan| key(plan)) {
        if !values.contains(&value) {
            values.push(value);
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Experiment, Selection};

    #[test]
    fn figures_and_differences() {
        let text = "source = 'Table 1'\nnotes = ['n']\n[figures.nerf]\npsnr = [15.93, 1.06]\nlpips_vgg = 0.32\n\
                    [scenes.lego.nerf]\npsnr = 15.61\n[protocol]\nimages = '800 pixels'\nview_sets = '5'\n";
        let paper: Paper = toml::from_str(text).unwrap();
        let published = paper.beside(&[]);
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
            let selection =
                Selection { set: set.iter().map(|&text| text.to_owned()).collect(), ..Selection::default() };
            let plan = Experiment::plan("synthetic-4view", &selection).unwrap();
            let published = plan.about.paper.unwrap().beside(&plan.runs.iter().collect::<Vec<_>>());
            published.footnotes.into_iter().find(|note| note.starts_with("Training views"))
        };
        assert_eq!(noted(&[]), None);
        assert_eq!(noted(&["scene.views=26,86"]).as_deref(), Some("Training views: 2 here; 4 in the paper."));
    }

    #[test]
    fn every_active_term_is_listed() {
        let selection = Selection {
            set: vec!["loss.semantic.weight=0.1".into(), "loss.tv.weight=1".into(), "loss.silhouette.weight=0".into()],
            variants: vec!["factored".into()],
            ..Selection::default()
        };
        let runs = Experiment::plan("fast-losses", &selection).unwrap().runs;
        assert_eq!(priors(&runs.iter().collect::<Vec<_>>()), "semantic, tv");
    }
}
