//! Faults: a damaged checkpoint, a loss that is not finite, a field that goes empty.

use std::fs;
use std::sync::Arc;

use crate::common::{config, devices, scene, steps, timeless, trainer};
use burn::module::{Module, Param};
use burn::tensor::{Device, Tensor};
use infonerf_field::{Field, FieldOutput, Points};
use infonerf_ops::to_host;
use infonerf_schedule::Moment;
use infonerf_train::{Checkpoint, Config, Event, Outcome, Preset, TrainError, Trainer};

/// Returns a run folder with a checkpoint after step 2, and the previous one after step 1.
fn saved() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut trainer = trainer(&config(&[]), 1, &devices()[0]);
    for _ in 0..2 {
        steps(&mut trainer, 1);
        trainer.checkpoint(&mut |_| ()).unwrap().save(folder.path()).unwrap();
    }
    folder
}

/// Checks that a damaged checkpoint is left out, and that an error names the newest one if both are damaged.
#[test]
fn the_newest_intact_checkpoint_is_used() {
    assert!(Checkpoint::load(tempfile::tempdir().unwrap().path()).unwrap().0.is_none());
    let folder = saved();
    let (checkpoint, refused) = Checkpoint::load(folder.path()).unwrap();
    assert_eq!((checkpoint.unwrap().progress().step, refused.len()), (2, 0));

    type Damage = fn(&mut Vec<u8>);
    let damages: [(&str, Damage); 3] = [
        ("truncated", |bytes| bytes.truncate(bytes.len() / 2)),
        ("a flipped bit", |bytes| {
            let middle = bytes.len() / 2;
            bytes[middle] ^= 0x10;
        }),
        ("empty", Vec::clear),
    ];
    let assert_refused = |part: &str, damage: &str| {
        let (checkpoint, refused) = Checkpoint::load(folder.path()).unwrap();
        assert_eq!(checkpoint.unwrap().progress().step, 1, "{part}, {damage}");
        let [reason] = &refused[..] else { panic!("{part}, {damage}: {refused:?}") };
        assert!(reason.contains(part) && reason.lines().count() == 1, "{part}, {damage}: {reason}");
    };
    for part in ["model.bpk", "optimizer.bpk", "occupancy.bin", "manifest.json"] {
        let path = folder.path().join("checkpoint").join(part);
        let whole = fs::read(&path).unwrap();
        for (name, damage) in damages {
            let mut bytes = whole.clone();
            damage(&mut bytes);
            fs::write(&path, bytes).unwrap();
            assert_refused(part, name);
        }
        fs::remove_file(&path).unwrap();
        assert_refused(part, "missing");
        fs::write(&path, &whole).unwrap();
    }
    for name in ["checkpoint", "checkpoint.previous"] {
        fs::write(folder.path().join(name).join("model.bpk"), "no weights").unwrap();
    }
    let message = Checkpoint::load(folder.path()).unwrap_err().to_string();
    assert!(message.contains("checkpoint/model.bpk") && message.contains("damaged"), "{message}");
    assert_eq!(message.lines().count(), 1);
}

/// Checks a run that was killed while it wrote: a half-written checkpoint is neither loaded nor in the way of the next one.
#[test]
fn interrupted_save_leaves_the_checkpoint_intact() {
    let folder = saved();
    let beside = folder.path().join("checkpoint.writing");
    fs::create_dir(&beside).unwrap();
    fs::write(beside.join("model.bpk"), "half").unwrap();
    let (checkpoint, refused) = Checkpoint::load(folder.path()).unwrap();
    let checkpoint = checkpoint.unwrap();
    assert_eq!((checkpoint.progress().step, refused.len()), (2, 0));
    checkpoint.save(folder.path()).unwrap();
    assert!(!beside.exists());

    // If the run is killed between the two renames, only the previous checkpoint is left.
    fs::rename(folder.path().join("checkpoint"), &beside).unwrap();
    let (checkpoint, _) = Checkpoint::load(folder.path()).unwrap();
    assert_eq!(checkpoint.unwrap().progress().step, 2);
}

#[test]
fn checkpoint_of_another_config_is_refused() {
    let folder = saved();
    let checkpoint = Checkpoint::load(folder.path()).unwrap().0.unwrap();
    let wider = "field={kind=\"nerf\",layers=3,width=32,skip=1,position_frequencies=4,direction_frequencies=2,density=\"relu\",detail=1.0}";
    for setting in [wider, "render.fine_samples=0", "render.occupancy.resolution=9"] {
        let mut other = trainer(&config(&[setting]), 1, &devices()[0]);
        let error = other.resume(&checkpoint).expect_err(setting);
        assert_eq!(error.to_string().lines().count(), 1, "{setting}: {error}");
    }
}

#[test]
fn infinite_loss_stops_the_run() {
    for device in devices() {
        let mut poisoned = scene().as_ref().clone();
        let config = config(&["train.rays=64"]);
        let mut trainer = Trainer::new(&config, poisoned.clone(), 1, None, &device).unwrap();
        steps(&mut trainer, 2);
        let good = trainer.checkpoint(&mut |_| ()).unwrap();

        for view in &mut poisoned.train {
            Arc::make_mut(&mut view.image).rgb.fill([f32::NAN; 3]);
        }
        let mut trainer = Trainer::new(&config, poisoned, 1, None, &device).unwrap();
        trainer.resume(&good).unwrap();
        let error = trainer.step(&mut |_| panic!("a step was reported")).unwrap_err();
        let TrainError::NonFinite { what, step, value } = &error else { panic!("{error}") };
        assert_eq!((what.as_str(), *step), ("loss `rgb`", 2));
        assert!(value.is_nan());
        let expected = "step 2: the loss `rgb` is NaN, not a finite number; the last checkpoint is kept";
        assert_eq!(error.to_string(), expected);
        assert_eq!(trainer.progress().step, 2);
        let folder = tempfile::tempdir().unwrap();
        good.save(folder.path()).unwrap();
        let before = fs::read(folder.path().join("checkpoint/model.bpk")).unwrap();
        trainer.checkpoint(&mut |_| ()).unwrap().save(folder.path()).unwrap();
        assert!(before == fs::read(folder.path().join("checkpoint/model.bpk")).unwrap(), "the weights have changed");
    }
}

/// Field of one density, which is its parameter; NaN in one step.
#[derive(Module, Debug)]
struct NanField {
    density: Param<Tensor<1>>,
    #[module(skip)]
    step: usize,
}

impl NanField {
    fn at(step: usize) -> impl Fn(u64, &Device) -> Self + Send + Sync + 'static {
        move |_, device| Self { density: Param::from_data([1.0f32], device), step }
    }
}

impl Field for NanField {
    fn evaluate(&self, points: &Points, color: bool, at: Moment) -> FieldOutput {
        let (samples, device) = (points.len(), self.device());
        let sigma = self.density.val().expand([samples]) * if at.step == self.step { f32::NAN } else { 1.0 };
        FieldOutput { sigma, color: color.then(|| Tensor::zeros([samples, 3], &device)) }
    }
}

/// Checks that earlier steps are reported, and that no later step changes the weights, whenever losses are read.
#[test]
fn infinite_loss_is_found_when_read_late() {
    for device in devices() {
        let config = config(&["render.occupancy.enabled=false", "train.lr=1e-2"]);
        let run = |read_every, asked: usize| {
            let mut trainer = Trainer::with_field(&config, scene(), 1, None, &device, NanField::at(3)).unwrap();
            trainer.read_every(read_every);
            let mut events = Vec::new();
            let mut report = |event| events.push(timeless(event));
            let mut stepped = (0..asked).map(|_| trainer.step(&mut report).map(drop));
            let result = stepped.find(Result::is_err).unwrap_or(Ok(()));
            let result = result.and_then(|()| trainer.checkpoint(&mut report).map(drop));
            let density = to_host(trainer.model().fine.density.val());
            (result.map_err(|error| error.to_string()), events, density, trainer.progress().step)
        };
        let (good, before) = (run(1, 3), run(1, 8));
        assert_ne!(good.2, [1.0]);
        assert!(good.0.is_ok() && before.0.as_ref().unwrap_err().contains("step 3"), "{before:?}");
        assert_eq!((&before.1, &before.2, before.3), (&good.1, &good.2, 3));
        // The NaN is found by a read that is due, and by a checkpoint.
        assert_eq!(run(5, 8), before);
        assert_eq!(run(16, 8), before);
    }
}

/// Checks that a field that is empty while its images are not starts over, and gives up when no fresh start is left.
#[test]
fn empty_field_starts_over() {
    // Nothing is learned, and the density of a ReLU field of this size is 0 everywhere for some seeds.
    let field = "field={kind=\"nerf\",layers=1,width=2,skip=1,position_frequencies=0,direction_frequencies=0,density=\"relu\",detail=1.0}";
    let run = |seed, restarts: usize, read_every| {
        let restarts = format!("train.restarts={restarts}");
        let settings = [field, &restarts, "train.lr=0.0", "train.iterations=60", "render.occupancy.enabled=false"];
        let mut trainer = trainer(&config(&settings), seed, &devices()[0]);
        trainer.read_every(read_every);
        let mut collapses = Vec::new();
        let mut report = |event| {
            if let Event::Collapse { step, restarted } = event {
                collapses.push((step, restarted));
            }
        };
        let mut outcomes = std::iter::repeat_with(|| trainer.step(&mut report).unwrap());
        let outcome = outcomes.find(|outcome| *outcome != Outcome::Running).unwrap();
        (outcome, collapses, trainer.progress().restarts)
    };
    let collapses = |&seed: &u64| run(seed, 0, 1) == (Outcome::Collapsed, vec![(50, false)], 0);
    let collapsed: Vec<u64> = (0..10).filter(collapses).take(2).collect();
    assert!(!collapsed.is_empty(), "no seed gives an empty field");
    for seed in collapsed {
        // Losses of steps after the collapse belong to the field that was given up.
        assert_eq!(run(seed, 0, 16), run(seed, 0, 1));
        assert_eq!(run(seed, 1, 16), run(seed, 1, 1), "seed {seed}");
        let (_, collapses, restarts) = run(seed, 1, 1);
        assert_eq!((collapses[0], restarts), ((50, true), 1), "seed {seed}");
    }
}

/// Checks that steps that aim for fewer samples than a ray has take one ray of each kind.
#[test]
fn step_has_at_least_one_ray_of_each_kind() {
    let few = ["train.rays=2", "train.unseen_rays=1", "train.target_samples=1", "loss.kl.weight=0"];
    let mut trainer = trainer(&config(&few), 1, &devices()[0]);
    steps(&mut trainer, 2);
    let before = trainer.progress().samples_total;
    assert_eq!(steps(&mut trainer, 2).len(), 2);
    // A coarse pass of 10 samples and a fine one of 16, along two rays in each step.
    assert_eq!(trainer.progress().samples_total - before, 2 * 2 * (10 + 16));
}

/// Checks that a step in which no term is due is taken, and that a config without terms is refused.
#[test]
fn step_without_a_gradient_is_taken() {
    let alone = ["loss.entropy.weight=0", "loss.kl.weight=0", "loss.rgb.weight={from=0.0,to=1.0}"];
    assert_eq!(steps(&mut trainer(&config(&alone), 1, &devices()[0]), 3).len(), 3);
    let none = Config::of(Preset::Paper, ["loss.entropy.weight=0", "loss.kl.weight=0", "loss.rgb.weight=0"]);
    assert_eq!(none.unwrap_err().to_string(), "loss: expected a term with a weight above 0, found none");
}
