use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::Device;
use infonerf_dataset::{SceneSource, with_refined_cameras};
use infonerf_field::FieldSpec;
use infonerf_render::Focal;
use infonerf_report::run_directory;
use infonerf_scene::{PixelCount, Scene, SceneError, SceneRequest};
use infonerf_schedule::Fault;
use infonerf_train::config::{Disturbance, PixelPosition};
use infonerf_train::{Config, MemoryPlan, Preset, Trainer, member_seed};
use serde::{Deserialize, Serialize};
use toml::Table;

use crate::records::found_below;
use crate::scenes::{check_name, find_scenes};

/// One run: a variant on a scene with a seed.
#[derive(Clone, Debug)]
pub struct RunPlan {
    /// Name of the experiment.
    pub experiment: String,
    /// Name of the scene.
    pub scene: String,
    /// Source of the scene.
    pub source: SceneSource,
    /// Folder that holds the scene's folder; none for a built-in scene.
    pub data: Option<PathBuf>,
    /// Name of the variant.
    pub variant: String,
    /// Seed of the training views and of all random numbers.
    pub seed: u64,
    /// The preset that the config started from.
    pub preset: Preset,
    /// Training time in seconds; `None` if the number of steps is fixed.
    pub budget: Option<f64>,
    /// Config: all other settings that the run's numbers depend on.
    pub config: Config,
}

/// Contents of a run's `config.toml`: a complete experiment file with this run alone.
#[derive(Serialize, Deserialize)]
struct RunConfigFile {
    title: String,
    name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    data: Option<PathBuf>,
    scenes: Vec<String>,
    seeds: Vec<u64>,
    preset: Preset,
    #[serde(skip_serializing_if = "Option::is_none")]
    budget_seconds: Option<f64>,
    config: Table,
    variants: BTreeMap<String, Table>,
}

impl RunPlan {
    /// Returns the run's label, `scene/variant/seedN`.
    pub fn label(&self) -> String {
        format!("{}/{}/seed{}", self.scene, self.variant, self.seed)
    }

    /// Describes the length of the training, in seconds or in steps.
    pub fn training(&self) -> String {
        match self.budget {
            Some(seconds) => format!("{seconds} s"),
            None => format!("{} steps of {} seen rays", self.config.train.iterations, self.config.train.rays),
        }
    }

    /// Returns the folder of the run below that of its experiment.
    pub fn directory(&self) -> PathBuf {
        run_directory(&self.scene, &self.variant, self.seed)
    }

    /// Returns the path of the file whose presence marks the run in `folder` as finished.
    pub fn record_path(&self, folder: &Path) -> PathBuf {
        folder.join(format!("record-{}.json", self.preset.name()))
    }

    /// Returns the number of fields that the run trains.
    pub fn members(&self) -> usize {
        self.config.train.ensemble.members(self.budget)
    }

    /// Returns the folder of the `index`th field's training: the run's own if there is one field.
    pub fn member_folder(&self, run: &Path, index: usize) -> PathBuf {
        if self.members() == 1 { run.to_owned() } else { run.join(format!("member{index}")) }
    }

    /// Returns a trainer of the `index`th field before its first step. `other`, if the plan has another field already, shares
    /// what training computes from the scene.
    pub fn trainer(
        &self,
        scene: &Arc<Scene>,
        index: usize,
        other: Option<&Trainer>,
        device: &Device,
    ) -> Result<Trainer> {
        let seed = member_seed(self.seed, index);
        if let Some(other) = other {
            return Ok(other.with_seed(seed)?);
        }
        let config = Config { train: self.config.train.of_member(self.members()), ..self.config.clone() };
        let budget = self.budget.map(|budget| budget / self.members() as f64);
        Ok(Trainer::new(&config, scene.clone(), seed, budget, device)?)
    }

    /// Loads the scene, its training cameras disturbed and refined as the config asks.
    pub fn load(&self) -> Result<Scene> {
        let scene = infonerf_dataset::load(&self.source, &self.request()).map_err(named_by_key);
        let scene = scene.with_context(|| self.source_name())?;
        let corner = self.config.scene.pixel_position == PixelPosition::Corner;
        let scene = if corner { scene.with_rays_through_corners() } else { scene };
        let disturb = self.config.scene.disturb;
        let exact = disturb == Disturbance::default();
        let scene = if exact { scene } else { scene.disturbed(disturb.degrees, disturb.distance, self.seed) };
        let cameras = &self.config.train.cameras;
        let by_matches = cameras.refine.is_by_matches();
        Ok(if by_matches { with_refined_cameras(scene, cameras.focal != Focal::Fixed) } else { scene })
    }

    /// Estimates the memory of the run with `side_by_side` of its fields being trained at a time.
    pub(crate) fn memory(&self, side_by_side: usize) -> Result<MemoryPlan> {
        Ok(MemoryPlan::new(&self.config, self.pixels()?, self.members(), side_by_side))
    }

    /// Returns the pixels that [`Self::load`] will hold.
    pub(crate) fn pixels(&self) -> Result<PixelCount> {
        let pixels = infonerf_dataset::count_pixels(&self.source, &self.request()).map_err(named_by_key);
        pixels.with_context(|| self.source_name())
    }

    fn request(&self) -> SceneRequest {
        let scene = &self.config.scene;
        SceneRequest {
            train: scene.views.clone().with_seed(self.seed),
            test: self.config.eval.test.clone(),
            image_size: (scene.size > 0).then_some(scene.size),
            background: scene.background,
            frame: Some(scene.frame),
            format: scene.format,
            masks: scene.masks,
        }
    }

    fn source_name(&self) -> String {
        match &self.source {
            SceneSource::Procedural(name) => format!("built-in scene {name}"),
            SceneSource::Folder { path } => format!("scene {}", path.display()),
        }
    }

    /// Returns the text of `config.toml`: running it again, from any folder, gives the same numbers.
    pub fn to_toml(&self) -> Result<String> {
        self.to_toml_with(vec![self.scene.clone()])
    }

    /// Returns the text of the `config.toml` of a run over several scenes.
    pub(crate) fn to_toml_with(&self, scenes: Vec<String>) -> Result<String> {
        let mut config = self.config.clone();
        for path in file_paths(&mut config).into_iter().filter(|path| !path.as_os_str().is_empty()) {
            *path = absolute(path);
        }
        let file = RunConfigFile {
            title: self.label(),
            name: self.experiment.clone(),
            data: self.data.as_deref().map(absolute),
            scenes,
            seeds: vec![self.seed],
            preset: self.preset,
            budget_seconds: self.budget,
            // Through text, which writes the `f32` 0.001 as 0.001 and not as 0.0010000000474974513.
            config: toml::to_string(&config)?.parse()?,
            variants: BTreeMap::from([(self.variant.clone(), Table::new())]),
        };
        Ok(toml::to_string(&file)?)
    }

    /// Reads the `config.toml` of a run's folder.
    ///
    /// # Errors
    /// If there is none, or it is not of a run.
    pub fn of_run(folder: &Path) -> Result<Self> {
        let path = folder.join("config.toml");
        let hint = || found_below(folder, "config.toml");
        ensure!(path.is_file(), "{}: expected the folder of a run, with a config.toml{}", folder.display(), hint());
        let text = std::fs::read_to_string(&path).with_context(|| path.display().to_string())?;
        Self::from_toml(&text).with_context(|| path.display().to_string())
    }

    /// Reads the text of a `config.toml`.
    pub(crate) fn from_toml(text: &str) -> Result<Self> {
        let file: RunConfigFile = toml::from_str(text).map_err(|error| anyhow::anyhow!("{}", error.message()))?;
        let config = Config::from_table(file.config)?;
        let (Some(scene), Some(&seed), Some(variant)) =
            (file.scenes.first(), file.seeds.first(), file.variants.keys().next())
        else {
            bail!("expected one scene, one seed and one variant");
        };
        check_name("experiment", &file.name)?;
        check_name("variant", variant)?;
        check_name("scene", scene)?;
        let source = match &file.data {
            // Results can be read where the scene is not: loading the scene reports that.
            Some(data) => SceneSource::Folder { path: data.join(scene) },
            None => find_scenes(None, Some(vec![scene.clone()]), "scenes")?.remove(0).1,
        };
        Ok(Self {
            experiment: file.name,
            scene: scene.clone(),
            source,
            data: file.data,
            variant: variant.clone(),
            seed,
            preset: file.preset,
            budget: file.budget_seconds,
            config,
        })
    }
}

/// Replaces the name of a request's field in an error by the config key that the field comes from.
fn named_by_key(error: SceneError) -> anyhow::Error {
    let SceneError::Request { field, expected, found } = error else { return error.into() };
    let key = match field {
        "train" => "scene.views",
        "test" => "eval.test",
        "image_size" => "scene.size",
        "background" => "scene.background",
        "frame" => "scene.frame",
        other => other,
    };
    Fault::new(key, expected, found).into()
}

/// Returns the paths of all files that a config names, except the scene's. The path of an unused file is empty.
pub(crate) fn file_paths(config: &mut Config) -> Vec<&mut PathBuf> {
    let of_terms = config.loss.specs_mut().filter_map(|(_, term)| Some(term.weights_file()?.1));
    std::iter::once(&mut config.train.init)
        .chain(of_terms)
        .chain(config.field.files().into_iter().map(|file| file.path))
        .collect()
}

fn absolute(path: &Path) -> PathBuf {
    std::path::absolute(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::{Experiment, Selection};
    use crate::testing::{first_run, selected};

    /// The released code does not add 0.5 to pixel positions, so its rays pass through corners; see `parity.rs`.
    #[test]
    fn released_rays_pass_through_corners() {
        let [centre, corner] = [Preset::Paper, Preset::Released].map(|preset| {
            let selection = Selection { preset: Some(preset), ..selected(&["knot"], &[], &["scene.size=8"]) };
            Experiment::plan("fast-losses", &selection).unwrap().runs.remove(0).load().unwrap()
        });
        for (centre, corner) in [(&centre.train, &corner.train), (&centre.test, &corner.test)] {
            let (at, shifted) = (&centre[0].camera, &corner[0].camera);
            assert!((at.ray(3.0, 5.0).direction - shifted.ray(3.5, 5.5).direction).length() < 1e-6);
        }
    }

    #[test]
    fn a_config_can_be_run_from_another_folder() {
        let plan = first_run(&["train.init=runs/here"]);
        let text = plan.to_toml().unwrap();
        let numbers = text.split([' ', ',', '\n', '[', ']']).filter(|word| word.parse::<f64>().is_ok());
        let digits = |number: &&str| number.trim_start_matches(['0', '.', '-']).len();
        assert_eq!(numbers.filter(|number| digits(number) > 9).collect::<Vec<_>>(), [""; 0], "{text}");
        let again = RunPlan::from_toml(&text).unwrap();
        let init = again.config.train.init.clone();
        assert!(init.is_absolute() && init.ends_with("runs/here"));
    }
}
