//! Runs of a few steps of tiny fields.

use std::panic::{AssertUnwindSafe, catch_unwind};

use infonerf_train::Checkpoint;

use super::*;
use crate::device::{DeviceName, open};
use crate::plan::Experiment;
use crate::testing::selected;

const TINY: &str = "train.iterations=3 train.rays=16 train.unseen_rays=8 train.target_samples=200 scene.size=16 \
                    eval.test=first-1 eval.information_rays=8 field.resolutions=[4,8] field.width=8 \
                    render.occupancy.resolution=8 render.samples=8 loss.kl.weight=1e-3";

fn plan(settings: &[&str]) -> RunPlan {
    let set: Vec<&str> = TINY.split_whitespace().chain(settings.iter().copied()).collect();
    Experiment::plan("fast-losses", &selected(&["knot"], &["infonerf"], &set)).unwrap().runs.remove(0)
}

fn run(out: &Path, plan: &RunPlan, watch: &mut Watch<'_>) -> Result<Finished> {
    Session::new(open(DeviceName::Flex).unwrap(), out, Existing::Continue).run(plan, watch)
}

fn record(out: &Path, plan: &RunPlan) -> (Box<Record>, usize) {
    match run(out, plan, &mut |_| Control::Continue).unwrap() {
        Finished::Record(record, trained) => (record, trained.trainers.len()),
        _ => panic!("the run did not come to its end"),
    }
}

#[test]
fn a_field_that_went_empty_has_no_part_in_the_pictures() {
    let out = tempfile::tempdir().unwrap();
    let plan = plan(&["train.ensemble.size=2"]);
    let (both, fields) = record(out.path(), &plan);
    assert_eq!(fields, 2);
    // The second field is made to have gone empty.
    let folder = out.path().join(&plan.experiment).join(plan.directory());
    let manifest = folder.join("member1/checkpoint/manifest.json");
    let text = fs::read_to_string(&manifest).unwrap();
    let (full, empty) = ("\"empty_steps\": 0", "\"empty_steps\": 50");
    assert!(text.contains(full), "{text}");
    fs::write(&manifest, text.replace(full, empty)).unwrap();

    let (one, fields) = record(out.path(), &plan);
    assert!(fields == 1 && !one.collapsed, "{fields} fields");
    assert_ne!(one.metrics["psnr"], both.metrics["psnr"]);
    assert_eq!(one.iterations, both.iterations);
    assert!(one.notes.iter().any(|note| note.starts_with("1 of 2 fields became empty")), "{:?}", one.notes);
    let trained = Trained::read(plan, &folder, &open(DeviceName::Flex).unwrap()).unwrap();
    assert!(trained.trainers.len() == 1 && trained.warnings.len() == 1, "{:?}", trained.warnings);
}

/// With one training view, which is also the tested one, there is no residual of another view.
#[test]
fn tested_view_gets_no_residual_of_its_own() {
    let settings = ["eval.test=training", "scene.views.count=1"];
    let psnr = |residuals: &str| {
        let out = tempfile::tempdir().unwrap();
        let plan = plan(&[&settings[..], &[residuals]].concat());
        let (record, _) = record(out.path(), &plan);
        assert_eq!(record.test_views.ids, record.train_views);
        assert!(record.notes.iter().any(|note| note.contains("each without its own residual")), "{:?}", record.notes);
        record.metrics["psnr"].unwrap()
    };
    assert_eq!(psnr("render.residuals=true"), psnr("render.residuals=false"));
}

#[test]
fn training_is_saved_when_its_watcher_panics() {
    let out = tempfile::tempdir().unwrap();
    let plan = plan(&["train.checkpoint_every=0", "train.iterations=9"]);
    let mut watch = |event: RunEvent<'_>| match event {
        RunEvent::Training { trainer, .. } if trainer.progress().step == 2 => panic!("a closed pipe"),
        _ => Control::Continue,
    };
    let ran = catch_unwind(AssertUnwindSafe(|| run(out.path(), &plan, &mut watch).unwrap()));
    assert!(ran.is_err());
    let folder = out.path().join(&plan.experiment).join(plan.directory());
    assert_eq!(Checkpoint::load(&folder).unwrap().0.unwrap().progress().step, 2);
    let warnings = || {
        let mut warnings = Vec::new();
        let mut watch = |event: RunEvent<'_>| match event {
            RunEvent::Warning(text) => (warnings.push(text), Control::Continue).1,
            RunEvent::Training { .. } => Control::Stop,
            _ => Control::Continue,
        };
        assert!(matches!(run(out.path(), &plan, &mut watch).unwrap(), Finished::Stopped));
        warnings
    };
    assert_eq!(warnings(), [""; 0]);
    fs::remove_dir_all(folder.join("checkpoint")).unwrap();
    fs::remove_dir_all(folder.join("checkpoint.previous")).unwrap_or_default();
    assert!(matches!(&warnings()[..], [lost] if lost.contains("no checkpoint of the earlier steps")));
}

/// A run is stopped before the second step of a pose's fit, and then while ray entropy is measured; in the end it has a record.
#[test]
fn evaluation_is_stopped_within_its_steps() {
    let out = tempfile::tempdir().unwrap();
    let plan = plan(&["eval.pose_steps=4"]);
    for last in [2, 6] {
        let mut begun = 0;
        let mut watch = |event: RunEvent<'_>| {
            begun += usize::from(matches!(event, RunEvent::Measuring));
            if begun == last { Control::Stop } else { Control::Continue }
        };
        assert!(matches!(run(out.path(), &plan, &mut watch).unwrap(), Finished::Stopped));
        assert_eq!(begun, last);
    }
    assert!(record(out.path(), &plan).0.ray_entropy_bits.is_some());
}

/// Reading a run returns warnings if fields are missing or training is unfinished.
#[test]
fn missing_fields_and_unfinished_training_are_warned_of() {
    let out = tempfile::tempdir().unwrap();
    let plan = plan(&["train.ensemble.size=3", "train.checkpoint_every=1"]);
    record(out.path(), &plan);
    let folder = out.path().join(&plan.experiment).join(plan.directory());
    fs::remove_dir_all(folder.join("member1")).unwrap();
    let device = open(DeviceName::Flex).unwrap();
    let trained = Trained::read(plan.clone(), &folder, &device).unwrap();
    assert_eq!(trained.trainers.len(), 2, "the fields after the missing one take part");
    assert!(matches!(&trained.warnings[..], [missing] if missing.contains("member1: no checkpoint: one of 3 fields")));

    let other = tempfile::tempdir().unwrap();
    let mut stop = |event: RunEvent<'_>| match event {
        RunEvent::Training { trainer, .. } if trainer.progress().step == 1 => Control::Stop,
        _ => Control::Continue,
    };
    assert!(matches!(run(other.path(), &plan, &mut stop).unwrap(), Finished::Stopped));
    let folder = other.path().join(&plan.experiment).join(plan.directory());
    let warnings = Trained::read(plan, &folder, &device).unwrap().warnings;
    assert!(warnings.iter().any(|warning| warning.contains("unfinished: 33.3 %")), "{warnings:?}");
}

/// A finished run goes on with more steps, and with a second field where a larger budget pays for one.
#[test]
fn finished_run_goes_on() {
    let out = tempfile::tempdir().unwrap();
    let (first, _) = record(out.path(), &plan(&[]));
    let more = plan(&["train.iterations=5"]);
    let curve = || fs::read_to_string(out.path().join(&more.experiment).join(more.directory()).join("metrics.jsonl"));
    let before = curve().unwrap();
    let (longer, _) = record(out.path(), &more);
    assert_eq!((first.iterations, longer.iterations), (3, 5));
    let grown = "train.iterations was 3 and is 5";
    assert!(longer.notes.iter().any(|note| note.contains(grown)), "{:?}", longer.notes);
    assert!(curve().unwrap().starts_with(&before), "no step is taken twice");
    let is_refused = |plan: &RunPlan, part: &str| {
        let error = run(out.path(), plan, &mut |_| Control::Continue).err().unwrap();
        assert!(format!("{error:#}").contains(part), "{error:#}");
    };
    for other in ["train.iterations=4", "train.rays=17"] {
        is_refused(&plan(&["train.iterations=5", other]), "another config");
    }
    // A run whose config is damaged or missing is kept.
    let folder = out.path().join(&more.experiment).join(more.directory());
    let (config, record_file) = (folder.join("config.toml"), more.record_path(&folder));
    let text = fs::read_to_string(&config).unwrap();
    fs::write(&config, "no TOML").unwrap();
    is_refused(&more, "config.toml: expected the config that the run was begun with (--overwrite");
    fs::remove_file(&config).unwrap();
    is_refused(&more, "config.toml is missing beside a record or a checkpoint");
    fs::write(&config, text).unwrap();
    fs::write(record_file, "[{").unwrap();
    is_refused(&more, "record-fast.json: expected the run's record (without the file");
    let budgeted = |budget| RunPlan { budget: Some(budget), ..plan(&["train.ensemble.seconds_per_member=0.1"]) };
    let out = tempfile::tempdir().unwrap();
    assert_eq!(record(out.path(), &budgeted(0.1)).1, 1);
    assert_eq!(record(out.path(), &budgeted(0.2)).1, 2);
}

#[test]
fn long_preparation_is_reported_by_stage() {
    let warning = |reading: f64, first: f64, taken: usize| preparation_warning(20.0, [reading, first], [taken, 4000]);
    let said = warning(3.04, 19.8, 1).unwrap();
    for part in ["a budget of 20 s", "the scene took 3.0 s", "includes, 19.8 s", "1 of 4000 steps are done"] {
        assert!(said.contains(part), "expected `{part}` in: {said}");
    }
    assert!(warning(20.5, 0.1, 3000).is_some() && warning(1.0, 12.0, 399).is_some());
    // There is no warning for a quick first step of a slow field, nor for stereo that leaves enough steps.
    assert!(warning(1.0, 1.0, 39).is_none() && warning(1.0, 12.0, 400).is_none());
}
