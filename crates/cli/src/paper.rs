//! What a paper found, as an experiment file holds it, and how its protocol differs from ours.

use std::collections::BTreeMap;

use infonerf_metrics::Summary;
use infonerf_report::{Published, PublishedRow};
use serde::Deserialize;

use crate::experiment::RunPlan;

/// The `[paper]` of an experiment file.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Paper {
    /// Which paper and table.
    source: String,
    /// By variant: means over the paper's scenes.
    #[serde(default)]
    figures: BTreeMap<String, Figures>,
    /// By scene and variant.
    #[serde(default)]
    scenes: BTreeMap<String, BTreeMap<String, Figures>>,
    /// How the figures were obtained.
    #[serde(default)]
    protocol: Protocol,
    /// Further remarks.
    #[serde(default)]
    notes: Vec<String>,
}

/// What a row of a paper's table holds.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Figures {
    psnr: Option<Figure>,
    ssim: Option<Figure>,
    lpips: Option<Figure>,
}

#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(untagged)]
enum Figure {
    Mean(f64),
    /// Mean and standard deviation.
    Spread([f64; 2]),
}

/// What figures depend on, in words. What a paper's protocol leaves out is not compared.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Protocol {
    scenes: Option<String>,
    images: Option<String>,
    test_views: Option<String>,
    view_sets: Option<String>,
    field: Option<String>,
    samples: Option<String>,
    training: Option<String>,
    weights: Option<String>,
    priors: Option<String>,
}

impl Paper {
    /// The paper's figures, with each difference between its protocol and that of `runs`.
    pub(crate) fn beside(&self, runs: &[&RunPlan]) -> Published {
        let means = self.figures.iter().map(|(variant, figures)| figures.row(variant, None));
        let of_scenes = self.scenes.iter().flat_map(|(scene, variants)| {
            variants.iter().map(move |(variant, figures)| figures.row(variant, Some(scene.clone())))
        });
        let differences = self.protocol.differences(&Protocol::of(runs));
        Published {
            source: self.source.clone(),
            rows: means.chain(of_scenes).collect(),
            footnotes: differences.into_iter().chain(self.notes.iter().cloned()).collect(),
        }
    }
}

impl Figures {
    fn row(&self, variant: &str, scene: Option<String>) -> PublishedRow {
        let summary = |figure: Option<Figure>| {
            figure.map(|figure| match figure {
                Figure::Mean(mean) => Summary { mean, std: None, n: 1 },
                Figure::Spread([mean, std]) => Summary { mean, std: Some(std), n: 1 },
            })
        };
        PublishedRow {
            variant: variant.to_owned(),
            scene,
            psnr: summary(self.psnr),
            ssim: summary(self.ssim),
            lpips: summary(self.lpips),
        }
    }
}

impl Protocol {
    /// Ours.
    fn of(runs: &[&RunPlan]) -> Self {
        let all = |describe: fn(&RunPlan) -> String| Some(distinct(runs, describe).join(" or "));
        let own = if runs.iter().any(|plan| plan.data.is_none()) { "built-in: " } else { "" };
        let seeds = distinct(runs, |plan| plan.seed.to_string()).len();
        Self {
            scenes: Some(format!("{own}{}", distinct(runs, |plan| plan.scene.clone()).join(", "))),
            images: all(|plan| match plan.config.scene.size {
                0 => "as they are".into(),
                size => format!("{size} pixels"),
            }),
            test_views: all(|plan| plan.config.eval.test.to_string()),
            view_sets: Some(format!("{seeds}")),
            field: all(|plan| plan.config.field.to_string()),
            samples: all(|plan| match plan.config.render.fine_samples {
                0 => format!("at most {} a ray", plan.config.render.samples),
                fine => format!("{} coarse and {fine} fine a ray", plan.config.render.samples),
            }),
            training: all(|plan| match plan.budget {
                Some(seconds) => format!("{seconds} s"),
                None => format!("{} steps of {} seen rays", plan.config.train.iterations, plan.config.train.rays),
            }),
            weights: Some(weights(runs)),
            priors: Some(priors(runs)),
        }
    }

    /// One line for each difference.
    fn differences(&self, ours: &Self) -> Vec<String> {
        let both = [
            ("Scenes", &ours.scenes, &self.scenes),
            ("Images", &ours.images, &self.images),
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

/// The weights of the paper's losses, where they are on.
fn weights(runs: &[&RunPlan]) -> String {
    let of = |name: &str, weight: fn(&RunPlan) -> f32| {
        let on: Vec<&RunPlan> = runs.iter().copied().filter(|plan| weight(plan) > 0.0).collect();
        let values = distinct(&on, |plan| weight(plan).to_string());
        (!values.is_empty()).then(|| format!("{name} = {}", values.join(" or ")))
    };
    let parts = [of("λ₁", |plan| plan.config.loss.entropy.weight), of("λ₂", |plan| plan.config.loss.gain.weight)];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Terms of the objective that are not the paper's.
fn priors(runs: &[&RunPlan]) -> String {
    let on =
        |name: &str, weight: fn(&RunPlan) -> f32| runs.iter().any(|plan| weight(plan) > 0.0).then(|| name.to_owned());
    let terms = [
        on("opacity", |plan| plan.config.loss.opacity.weight),
        on("background key", |plan| plan.config.loss.key.background + plan.config.loss.key.foreground),
        on("alpha channel", |plan| plan.config.loss.alpha),
        on("total variation", |plan| plan.config.loss.variation.weight),
    ];
    let terms: Vec<String> = terms.into_iter().flatten().collect();
    if terms.is_empty() { "none".to_owned() } else { terms.join(", ") }
}

/// The values of `key`, each once, in order of appearance.
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

    #[test]
    fn figures_and_differences() {
        let text = "source = 'Table 1'\nnotes = ['n']\n[figures.nerf]\npsnr = [15.93, 1.06]\nlpips = 0.32\n\
                    [scenes.lego.nerf]\npsnr = 15.61\n[protocol]\nimages = '800 pixels'\nview_sets = '5'\n";
        let paper: Paper = toml::from_str(text).unwrap();
        let published = paper.beside(&[]);
        assert_eq!(published.rows[0].psnr, Some(Summary { mean: 15.93, std: Some(1.06), n: 1 }));
        assert_eq!((published.rows[0].ssim, published.rows[1].scene.as_deref()), (None, Some("lego")));
        assert!(published.footnotes.contains(&"Sets of training views: 0 here; 5 in the paper.".into()));
        assert_eq!(published.footnotes.last().map(String::as_str), Some("n"));
        assert!(toml::from_str::<Paper>("source = 'x'\npages = 3").is_err());
    }
}
