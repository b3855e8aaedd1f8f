//! The runs of an experiment, and how each differs from a preset.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use anyhow::{Context, Result, bail, ensure};
use infonerf_dataset::SceneSource;
use infonerf_report::{Claim, Record, ReportInput};
use infonerf_scene::{Backdrop, Layout};
use infonerf_train::config::{self, checks};
use infonerf_train::{Config, Preset};
use toml::Table;

use crate::file::{Layers, Start, Variant};
use crate::published::Paper;
use crate::run_plan::RunPlan;
use crate::scenes::{check_name, find_scenes};
use crate::sweep::figures::Plot;

/// Choice among the runs of an experiment, with changes to them. An empty field leaves the experiment's own value.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Folder that holds the scenes' folders; without it the experiment's, or the built-in procedural scenes.
    pub data: Option<PathBuf>,
    /// Names of scenes.
    pub scenes: Vec<String>,
    /// Names of variants.
    pub variants: Vec<String>,
    /// Seeds of the runs.
    pub seeds: Vec<u64>,
    /// Preset that the config starts from; `None` for the experiment's, else the one that suits each scene.
    pub preset: Option<Preset>,
    /// Assignments `dotted.key=value`, each of which changes a key of every config.
    pub set: Vec<String>,
    /// Training time of each run in seconds; the schedules follow the clock.
    pub budget: Option<f64>,
}

/// Name, title, data, claims and plot of an experiment: all but its runs.
#[derive(Clone, Debug, Default)]
pub struct About {
    /// Name in results.
    pub name: String,
    /// Title: one line on what the experiment shows.
    pub title: String,
    /// Folder of scenes; none for the built-in ones.
    pub data: Option<PathBuf>,
    /// Mean wall-clock seconds of a run on two CPU cores; `None` where data or settings are not the experiment's own.
    pub seconds_per_run: Option<f64>,
    pub(crate) paper: Option<Paper>,
    pub(crate) claims: Vec<Claim>,
    pub(crate) plot: Option<Plot>,
}

/// An experiment, ready to run.
#[derive(Clone, Debug)]
pub struct Experiment {
    /// Name, title, data, claims and plot.
    pub about: About,
    /// Runs by scene, variant and seed.
    pub runs: Vec<RunPlan>,
}

impl Experiment {
    /// Reads the experiment called `experiment` (built in, or a file) and applies what `selection` changes.
    ///
    /// # Errors
    /// One line that names the file or option and what was expected.
    pub fn plan(experiment: &str, selection: &Selection) -> Result<Self> {
        let outline = Outline::read(experiment, selection)?;
        Ok(Self { runs: outline.runs(&[])?, about: outline.about })
    }
}

/// An experiment that is read once and planned for any number of settings.
pub(crate) struct Outline {
    pub(crate) about: About,
    /// Name or path of the experiment.
    experiment: String,
    layers: Layers,
    scenes: Vec<ChosenScene>,
    variants: Vec<Variant>,
    /// Selection with the seeds and the budget of the experiment if it has none of its own.
    pub(crate) selection: Selection,
}

impl Outline {
    pub(crate) fn read(experiment: &str, selection: &Selection) -> Result<Self> {
        let layers = Layers::read(experiment)?;
        let name = layers.result_name();
        check_name("experiment", &name)?;
        let data = selection.data.clone().or_else(|| layers.last(|file| file.data.clone()));
        // In the user's own data, all scenes by default.
        let (place, names) = match &selection.scenes[..] {
            [] if selection.data.is_some() => ("--data".to_owned(), None),
            [] => (layers.place("scenes", |file| file.scenes.is_some()), layers.last(|file| file.scenes.clone())),
            chosen => ("--scene".to_owned(), Some(chosen.to_vec())),
        };
        let scenes = find_scenes(data.as_deref(), names, &place)?;
        check_list(&place, scenes.iter().map(|(name, _)| name.clone()))?;
        let scenes = scenes.into_iter().map(ChosenScene::new).collect();
        let own_seeds = layers.last(|file| file.seeds.clone()).unwrap_or_else(|| vec![0]);
        let (place, seeds) = match &selection.seeds[..] {
            [] => (layers.place("seeds", |file| file.seeds.is_some()), own_seeds),
            chosen => ("--seed".to_owned(), chosen.to_vec()),
        };
        check_list(&place, seeds.iter().map(u64::to_string))?;
        let mut about = About::of(&layers, data);
        let Selection { data, preset, set, budget, .. } = selection;
        if data.is_some() || preset.is_some() || budget.is_some() || !set.is_empty() {
            about.seconds_per_run = None;
        }
        let variants = chosen_variants(experiment, &layers, selection)?;
        let in_files = layers.last(|file| file.budget_seconds);
        if let Some(seconds) = budget.or(in_files).filter(|seconds| *seconds <= 0.0 || !seconds.is_finite()) {
            let key = layers.place("budget_seconds", |file| file.budget_seconds.is_some());
            let place: &str = if budget.is_some() { "--budget" } else { &key };
            bail!("{place}: expected a number of seconds above 0, found {seconds}");
        }
        let selection = Selection { seeds, budget: budget.or(in_files), ..selection.clone() };
        Ok(Self { about, experiment: experiment.to_owned(), layers, scenes, variants, selection })
    }

    /// Lists the runs by scene, variant and seed. The assignments of `set` apply after those of the selection.
    pub(crate) fn runs(&self, set: &[String]) -> Result<Vec<RunPlan>> {
        let mut configs: BTreeMap<_, Config> = BTreeMap::new();
        let mut runs = Vec::new();
        for scene in &self.scenes {
            let ChosenScene { name, source, .. } = scene;
            for variant in &self.variants {
                let mut config = |preset: Preset| match configs.entry((preset.name(), &variant.name)) {
                    Entry::Occupied(known) => Ok::<Config, anyhow::Error>(known.get().clone()),
                    Entry::Vacant(new) => Ok(new.insert(self.config(preset, variant, set)?).clone()),
                };
                let own = match variant.start {
                    Start::Experiment => self.layers.last(|file| file.preset),
                    Start::Preset(preset) => preset,
                };
                let preset = self.selection.preset.or(own).unwrap_or(scene.suitable);
                for &seed in &self.selection.seeds {
                    let mut plan = RunPlan {
                        experiment: self.about.name.clone(),
                        scene: name.clone(),
                        source: source.clone(),
                        data: self.about.data.clone(),
                        variant: variant.name.clone(),
                        seed,
                        preset,
                        budget: self.selection.budget,
                        config: config(preset)?,
                    };
                    // A selected preset is used for any number of views.
                    if preset == Preset::Capture && self.selection.preset.is_none() {
                        // If the scene cannot be read, loading it reports the error.
                        let views = plan.pixels().map_or(0, |pixels| pixels.views);
                        plan.preset = preset.for_views(views, scene.layout);
                        plan.config = config(plan.preset)?;
                    }
                    checks::body(&plan.config, source.has_body())
                        .with_context(|| format!("{}: {name}/{}", self.experiment, variant.name))?;
                    runs.push(plan);
                }
            }
        }
        Ok(runs)
    }

    fn config(&self, preset: Preset, variant: &Variant, set: &[String]) -> Result<Config> {
        let mut table = match variant.start {
            Start::Experiment => self.layers.config(preset),
            Start::Preset(_) => preset.table(),
        };
        config::merge(&mut table, variant.changes.clone());
        assign(&mut table, &self.selection.set)
            .and_then(|()| assign(&mut table, set))
            .and_then(|()| Config::from_table(table).with_context(|| format!("variant {}", variant.name)))
            .with_context(|| self.experiment.clone())
    }
}

pub(crate) fn assign(table: &mut Table, set: &[String]) -> Result<()> {
    set.iter().try_for_each(|text| config::assign(table, text).with_context(|| format!("--set {text}")))
}

/// A scene, and the preset that suits it.
struct ChosenScene {
    name: String,
    source: SceneSource,
    suitable: Preset,
    layout: Layout,
}

impl ChosenScene {
    /// Chooses the preset that suits the scene: `capture` suits photographs without a uniform background, `fast`
    /// everything else. If the scene cannot be read, loading it reports the error.
    fn new((name, source): (String, SceneSource)) -> Self {
        let (backdrop, layout) = source.setting().unwrap_or_default();
        let suitable = if backdrop == Some(Backdrop::Unknown) { Preset::Capture } else { Preset::Fast };
        Self { name, source, suitable, layout }
    }
}

/// Returns the selected variants of `experiment`, by default all. Refuses claims about other variants than those of `layers`.
fn chosen_variants(experiment: &str, layers: &Layers, selection: &Selection) -> Result<Vec<Variant>> {
    let all = layers.variants().with_context(|| experiment.to_owned())?;
    let expected = "expected at least one, as a table [variants.NAME] or from a `base` (`infonerf list` names some)";
    ensure!(!all.is_empty(), "{experiment}: variants: {expected}");
    let names = all.iter().map(|variant| variant.name.as_str()).collect::<Vec<_>>().join(", ");
    let named = |name: &str| all.iter().find(|variant| variant.name == name).cloned();
    for (index, claim) in layers.last(|file| file.claims.clone()).iter().flatten().enumerate() {
        if let Some(other) = claim.variants().find(|name| named(name).is_none()) {
            bail!("{experiment}: claims[{index}]: expected variants among {names}, found {other:?}");
        }
    }
    let expected = |name: &String| named(name).with_context(|| format!("--variant {name}: expected one of: {names}"));
    let chosen = selection.variants.iter().map(expected).collect::<Result<Vec<_>>>()?;
    let variants = if chosen.is_empty() { all } else { chosen };
    check_list("--variant", variants.iter().map(|variant| variant.name.clone()))?;
    variants.iter().try_for_each(|variant| check_name("variant", &variant.name))?;
    Ok(variants)
}

/// Refuses an empty list of items that stand at `place`, and an item that is given twice.
fn check_list(place: &str, items: impl Iterator<Item = String>) -> Result<()> {
    let mut seen = BTreeSet::new();
    for item in items {
        ensure!(seen.insert(item.clone()), "{place} {item}: given twice");
    }
    ensure!(!seen.is_empty(), "{place}: expected at least one");
    Ok(())
}

const SWEEP: &str = "sweep-";

impl About {
    /// Describes the built-in experiment, or the sweep of one, whose results are called `name`; any other by its name alone.
    pub(crate) fn of_results(name: &str) -> Self {
        let known = |name: &str| {
            let layers = Layers::built_in(name)?;
            Some(Self::of(&layers, layers.last(|file| file.data.clone())))
        };
        let swept = || known(name.strip_prefix(SWEEP)?).map(Self::swept);
        known(name).or_else(swept).unwrap_or_else(|| Self { name: name.into(), title: name.into(), ..Self::default() })
    }

    /// Describes a sweep of the experiment, without its time, the paper's figures, claims and plot, which hold for other settings.
    pub(crate) fn swept(self) -> Self {
        let (name, title) = (format!("{SWEEP}{}", self.name), format!("Sweep of {}", self.title));
        Self { name, title, data: self.data, ..Self::default() }
    }

    fn of(layers: &Layers, data: Option<PathBuf>) -> Self {
        let name = layers.result_name();
        Self {
            title: layers.last(|file| file.title.clone()).unwrap_or_else(|| name.clone()),
            name,
            data,
            seconds_per_run: layers.seconds_per_run(),
            paper: layers.paper(),
            claims: layers.last(|file| file.claims.clone()).unwrap_or_default(),
            plot: layers.last(|file| file.plot.clone()),
        }
    }

    /// Collects the input of a report of `records`, the results of `runs`. Claims about variants that `runs` lack are left out.
    pub(crate) fn report_input(&self, records: Vec<Record>, runs: &[&RunPlan]) -> Result<ReportInput> {
        let plot = self.plot.as_ref().map(|plot| plot.figure(&records)).transpose()?;
        let mut input = ReportInput::new(&self.name, &self.title, records);
        input.figures.extend(plot);
        let procedural = "Procedural scenes of this project, not a published data set.";
        input.warnings.extend(self.data.is_none().then(|| procedural.to_owned()));
        input.published = self.paper.as_ref().map(|paper| paper.to_published(runs));
        let chosen = |variant: &str| runs.iter().any(|plan| plan.variant == variant);
        input.claims = self.claims.iter().filter(|claim| claim.variants().all(chosen)).cloned().collect();
        Ok(input)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::described::{Description, describe};
    use crate::file::list;
    use crate::identity;
    use crate::testing::selected;

    /// Every built-in experiment can be planned over any preset, and its runs can be read back from their `config.toml`.
    #[test]
    fn every_built_in_experiment_is_valid() {
        for (name, title) in list().unwrap() {
            let Description { experiment, text, .. } = describe(name).unwrap();
            assert!(experiment.about.title == title && !experiment.runs.is_empty() && !text.is_empty(), "{name}");
            for preset in Preset::ALL {
                let selection = Selection { preset: Some(preset), ..Selection::default() };
                for plan in Experiment::plan(name, &selection).unwrap().runs {
                    let text = plan.to_toml().unwrap();
                    assert_eq!(RunPlan::from_toml(&text).unwrap().to_toml().unwrap(), text, "{name}");
                }
            }
        }
    }

    /// Loads the first scene of each variant, in small images.
    #[test]
    fn scenes_of_built_in_experiments_have_the_views_that_they_ask_for() {
        for (name, _) in list().unwrap() {
            let runs = Experiment::plan(name, &selected(&[], &[], &["scene.size=8"])).unwrap().runs;
            for run in runs.iter().filter(|run| (&run.scene, run.seed) == (&runs[0].scene, runs[0].seed)) {
                let loaded = run.load().unwrap_or_else(|error| panic!("{name}, {}: {error:#}", run.variant));
                assert!(!loaded.train.is_empty() && !loaded.test.is_empty(), "{name}, {}", run.variant);
            }
        }
    }

    /// Returns the keys (`section.key`) at which the configs of two variants of an experiment differ.
    fn differences(experiment: &str, variants: [&str; 2]) -> Vec<String> {
        let runs = Experiment::plan(experiment, &selected(&[], &variants, &[])).unwrap().runs;
        let of = |variant: &str| runs.iter().find(|run| run.variant == variant).unwrap();
        let [one, other] = variants.map(|variant| Table::try_from(&of(variant).config).unwrap());
        let section_key = |key: &str| key.split('.').take(2).collect::<Vec<_>>().join(".");
        let keys = identity::differences(&one, &other).into_iter().map(|difference| section_key(&difference.key));
        keys.collect::<BTreeSet<String>>().into_iter().collect()
    }

    /// Configs of other methods differ from NeRF's only in the keys that define the method.
    #[test]
    fn baselines_are_what_they_are_called() {
        for experiment in ["baselines", "baselines-paper"] {
            let simplified = ["field.position_frequencies", "render.fine_samples", "render.samples", "train.lr"];
            assert_eq!(differences(experiment, ["nerf", "simplified-nerf"]), simplified, "{experiment}");
        }
        assert_eq!(differences("baselines-paper", ["nerf", "dietnerf"]), ["loss.semantic"]);
    }

    #[test]
    fn photographs_have_a_preset_of_their_own() {
        let presets = |experiment: &str, preset: Option<Preset>| {
            let selection = Selection { preset, ..selected(&["castle", "room"], &[], &[]) };
            let plan = Experiment::plan(experiment, &selection).unwrap();
            let of = |scene: &str| plan.runs.iter().find(|run| run.scene == scene).unwrap();
            let stereo = |run: &RunPlan| run.scene == "room" && !run.config.loss.stereo.weight.is_zero();
            assert_eq!(plan.runs.iter().any(stereo), of("room").preset == Preset::Capture);
            (of("castle").preset, of("room").preset)
        };
        assert_eq!(presets("views", None), (Preset::Released, Preset::Released));
        assert_eq!(presets("recipe", Some(Preset::Fast)), (Preset::Fast, Preset::Fast));
        assert_eq!(presets("recipe", None), (Preset::Fast, Preset::Capture));
        assert_eq!(presets("capture", Some(Preset::Capture)), (Preset::Capture, Preset::Capture));
    }

    /// The scene `table` has 42 training views, all of which `capture` uses. The cameras of `room` face forward.
    #[test]
    fn many_photographs_have_a_larger_field() {
        let of = |scene: &str, experiment: &str, set: &[&str], preset: Option<Preset>| {
            let selection = Selection { preset, ..selected(&[scene], &[], set) };
            let run = Experiment::plan(experiment, &selection).unwrap().runs.remove(0);
            let rebuilt = RunPlan::from_toml(&run.to_toml().unwrap()).unwrap();
            assert_eq!((rebuilt.preset, &rebuilt.config), (run.preset, &run.config));
            run
        };
        assert_eq!(of("room", "capture", &[], None).preset, Preset::Capture);
        let plan = |experiment: &str, set: &[&str], preset| of("table", experiment, set, preset);
        assert_eq!(plan("capture", &[], None).preset, Preset::Dense);
        assert_eq!(plan("capture", &["scene.views=seed-9"], None).preset, Preset::Dense);
        assert_eq!(plan("capture", &["scene.views=seed-8"], None).preset, Preset::Capture);
        assert_eq!(plan("recipe", &["scene.views=seed-9"], None).preset, Preset::Dense);
        assert_eq!(plan("llff-3view", &[], None).preset, Preset::Capture);
        assert_eq!(plan("capture", &[], Some(Preset::Capture)).preset, Preset::Capture);
        let set = plan("capture", &["field.view_dependence=0.5"], None).config;
        assert_eq!(set.render.space, infonerf_render::SpaceChoice::Content);
        let infonerf_field::FieldConfig::Factored(field) = set.field else { panic!("{:?}", set.field) };
        assert_eq!(field.view_dependence, 0.5);
    }

    #[test]
    fn a_report_names_only_claims_that_its_runs_could_test() {
        let claims = |variants: &[&str]| {
            let plan = Experiment::plan("synthetic-4view", &selected(&[], variants, &[])).unwrap();
            plan.about.report_input(Vec::new(), &plan.runs.iter().collect::<Vec<_>>()).unwrap().claims.len()
        };
        assert_eq!([claims(&["infonerf+"]), claims(&["nerf", "infonerf"]), claims(&[])], [0, 1, 2]);
    }

    #[test]
    fn names_are_checked_before_anything_runs() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("my exp.toml");
        std::fs::write(&file, "base = 'fast-losses'\n[variants.'factored+key']\n").unwrap();
        let plan = Experiment::plan(&file.to_string_lossy(), &Selection::default()).unwrap();
        assert_eq!(plan.about.name, "my exp");
        assert!(plan.runs.iter().any(|run| run.variant == "factored+key"));
        std::fs::write(&file, "base = 'fast-losses'\n[variants.'factored/key']\n").unwrap();
        let error = Experiment::plan(&file.to_string_lossy(), &Selection::default()).unwrap_err();
        assert!(format!("{error:#}").contains("variant \"factored/key\""), "{error:#}");
    }
}
