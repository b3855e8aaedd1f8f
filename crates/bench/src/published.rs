//! Published few-shot figures of other systems, from `published.toml`.

use anyhow::{Context, Result};
use infonerf_report::chart::Series;
use serde::Deserialize;

/// Published figures for a number of training views.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct PublishedFigures {
    views: usize,
    scenes: Vec<String>,
    #[serde(rename = "system")]
    systems: Vec<PublishedSystem>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PublishedSystem {
    name: String,
    /// Name of the scene; `None` for the mean over all scenes.
    scene: Option<String>,
    hardware: String,
    /// Training time in seconds.
    seconds: f64,
    psnr: Option<f64>,
    ssim: Option<f64>,
    source: String,
}

impl PublishedFigures {
    pub(crate) fn read() -> Result<Self> {
        toml::from_str(include_str!("../published.toml")).context("published.toml")
    }

    /// Selects figures comparable with runs on `scenes` with numbers of training `views`: a system's figures of a single scene if
    /// it has them, and otherwise its means. Returns none if the runs have other scenes or views.
    fn comparable(&self, scenes: &[String], views: &[usize]) -> Vec<&PublishedSystem> {
        if scenes.iter().any(|scene| !self.scenes.contains(scene)) || views.iter().any(|views| *views != self.views) {
            return Vec::new();
        }
        let own = |system: &&PublishedSystem| scenes.len() == 1 && system.scene.as_ref() == scenes.first();
        let has_own = |name: &str| self.systems.iter().filter(own).any(|system| system.name == name);
        let shown = |system: &&PublishedSystem| own(system) || system.scene.is_none() && !has_own(&system.name);
        self.systems.iter().filter(shown).collect()
    }

    /// Returns a point for each comparable system in a chart of training time against the metric `key`, named with its
    /// hardware.
    pub(crate) fn series(&self, scenes: &[String], views: &[usize], key: &str) -> Vec<Series> {
        let series = |system: &PublishedSystem| {
            let value = match key {
                "psnr" => system.psnr?,
                "ssim" => system.ssim?,
                _ => return None,
            };
            let other = if system.scene.is_none() && scenes.len() < self.scenes.len() { ", 8 scenes" } else { "" };
            let name = format!("{} ({}{other})", system.name, system.hardware);
            Some(Series { name, points: vec![(system.seconds, value)] })
        };
        self.comparable(scenes, views).into_iter().filter_map(series).collect()
    }

    /// Describes each comparable system in a line, with its source.
    pub(crate) fn lines(&self, scenes: &[String], views: &[usize]) -> Vec<String> {
        let line = |system: &PublishedSystem| {
            let psnr = system.psnr.map_or_else(|| "-".to_owned(), |psnr| format!("{psnr:.2}"));
            let PublishedSystem { name, seconds, hardware, source, .. } = system;
            let scene = system.scene.as_deref().unwrap_or("mean of 8 scenes");
            format!("{name}, {scene}: {psnr} dB in {seconds} s on {hardware} ({source})")
        };
        self.comparable(scenes, views).into_iter().map(line).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn published_figures_match_scenes_and_views() {
        let published = PublishedFigures::read().unwrap();
        let series = |scene: &str, views| published.series(&[scene.to_owned()], &[views], "psnr");
        let point = |all: &[Series], name: &str| all.iter().find(|one| one.name == name).map(|one| one.points[0].1);
        let lego = series("lego", 4);
        assert_eq!(point(&lego, "InfoNeRF (RTX 2080 Ti)"), Some(18.92), "{lego:?}");
        assert_eq!(point(&lego, "ZeroRF (A100, 8 scenes)"), Some(21.94), "{lego:?}");
        assert_eq!(lego.len(), 5, "each system once");
        assert_eq!(point(&series("mic", 4), "InfoNeRF (RTX 2080 Ti, 8 scenes)"), Some(18.65));
        assert!(series("lego", 8).is_empty() && series("crane", 4).is_empty());
    }
}
