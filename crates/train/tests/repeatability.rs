//! Runs with one seed give the same values, and so does a resumed run.

use std::collections::BTreeMap;
use std::time::Instant;

use crate::common::{config, configs, devices, losses, scene, scene_of, steps, timeless, trainer};
use burn::tensor::Device;
use infonerf_metrics::{Networks, Protocol};
use infonerf_schedule::Moment;
use infonerf_train::{
    Checkpoint, Config, Evaluation, Event, Information, Outcome, TestView, Trainer, information, step_side_by_side,
};

const STEPS: usize = 12;

/// Returns every kind of field on Burn's default backend, and the paper's network on the older one, which is slow.
fn cases() -> Vec<(Config, Device)> {
    let [flex, older] = devices();
    let on_flex = configs().into_iter().map(|config| (config, flex.clone()));
    on_flex.chain([(config(&[]), older)]).collect()
}

/// Returns everything that evaluation measures: pictures, metrics, entropy and information gain.
fn evaluation(trainer: &Trainer, config: &Config, seed: u64) -> (Vec<Vec<[f32; 3]>>, Vec<f64>) {
    let (scene, networks, protocol) = (scene(), Networks::none(), Protocol::default());
    let mut evaluation = Evaluation::new(&networks, &protocol);
    let view = |view| evaluation.add(trainer.renderer(), &[trainer.trained()], view).unwrap();
    let views: Vec<TestView> = scene.test.iter().map(view).collect();
    let evaluated = evaluation.finish().unwrap();
    let mean = |of: fn(&TestView) -> f64| views.iter().map(of).sum::<f64>() / views.len() as f64;
    let opacity = mean(|view| f64::from(view.image.acc.iter().sum::<f32>()) / view.image.acc.len() as f64);
    assert!((evaluated.opacity - opacity).abs() < 1e-5 * opacity.max(1.0), "{} for {opacity}", evaluated.opacity);
    assert!((evaluated.seconds_per_image - mean(|view| view.seconds)).abs() < 1e-9);
    assert_eq!(evaluated.shows_nothing, views.iter().all(TestView::shows_nothing));
    let information = informed(trainer, config, seed);
    // At most the logarithm of the number of samples along a ray, of which no config here has more than 192.
    assert!(information.entropy_bits < 8.0, "{information:?}");
    let mut numbers = vec![information.entropy_bits, information.gain];
    numbers.extend(views.iter().flat_map(|view| view.values.values().flatten()));
    assert!(views.iter().all(|view| view.value("silhouette_iou").is_some()));
    (views.into_iter().map(|view| view.image.rgb).collect(), numbers)
}

fn informed(trainer: &Trainer, config: &Config, seed: u64) -> Information {
    information(trainer.renderer(), &trainer.snapshot(), trainer.scene(), config, seed, &mut || true).unwrap()
}

/// Checks that the reported information gain uses the same centre of rotation for neighbours as training.
#[test]
fn information_gain_rotates_about_the_configured_centre() {
    let [flex, _] = devices();
    let [centre, origin] = ["centre", "origin"].map(|about| {
        let config = config(&[&format!("train.neighbours.about={about}")]);
        informed(&Trainer::new(&config, scene_of("room", 4, 16), 1, None, &flex).unwrap(), &config, 1)
    });
    assert_ne!(centre.gain, origin.gain);
    let mean = Information::mean(&[centre, origin]).unwrap();
    assert!((mean.gain - 0.5 * (centre.gain + origin.gain)).abs() <= 1e-12 * mean.gain);
}

/// Checks that a seed gives the same values, with any number of threads the same losses, and that another seed gives others.
#[test]
fn runs_of_one_seed_agree() {
    for (config, device) in cases() {
        let run = |seed| {
            let mut trainer = trainer(&config, seed, &device);
            let events = steps(&mut trainer, STEPS);
            (events, evaluation(&trainer, &config, seed), trainer.progress().samples_evaluated)
        };
        let first = run(7);
        assert_eq!(first.0.len(), STEPS);
        assert_eq!(first, run(7));
        for threads in [1, 5] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let events = pool.install(|| steps(&mut trainer(&config, 7, &device), STEPS));
            assert_eq!(first.0, events, "{threads} threads");
        }
        assert_ne!(first.0, run(8).0);
        for event in &first.0 {
            let Event::Step { step, loss, losses, psnr, evaluated, .. } = event else { panic!("{event:?}") };
            let at = Moment { step: step - 1, progress: (step - 1) as f64 / STEPS as f64 };
            for (name, spec) in config.loss.specs() {
                assert_eq!(losses.contains_key(name), spec.weight().at(at) > 0.0, "{name}: {event:?}");
            }
            assert!(loss.is_finite() && losses.contains_key("rgb"), "{event:?}");
            assert!((0.0..=1.0).contains(evaluated), "{event:?}");
            // The loss of a single pass is the mean squared error.
            assert!(config.render.is_hierarchical() || (psnr + 10.0 * losses["rgb"].log10()).abs() < 1e-3, "{event:?}");
        }
    }
}

/// Checks that fields trained side by side have the values of each alone, and that their times add up to at most what passed.
#[test]
fn training_side_by_side_changes_nothing() {
    for (config, device) in cases() {
        let seeds = 0..3;
        let alone: Vec<_> = seeds.clone().map(|seed| steps(&mut trainer(&config, seed, &device), STEPS)).collect();
        let mut trainers: Vec<Trainer> = seeds.map(|seed| trainer(&config, seed, &device)).collect();
        let mut together = vec![Vec::new(); trainers.len()];
        let start = Instant::now();
        for _ in 0..STEPS {
            let stepped = step_side_by_side(&mut trainers.iter_mut().collect::<Vec<_>>());
            for (seen, (events, outcome)) in together.iter_mut().zip(stepped) {
                outcome.unwrap();
                seen.extend(events.into_iter().map(timeless));
            }
        }
        let passed = start.elapsed().as_secs_f64();
        assert_eq!(together, alone);
        let counted: f64 = trainers.iter().map(|trainer| trainer.progress().seconds).sum();
        assert!(counted > 0.0 && counted <= passed, "{counted} of {passed} s");
    }
}

/// Checks that a step's share of the time is counted before the step's outcome and events are determined, and that the last step
/// counts the time in which the losses of earlier ones are read.
#[test]
fn members_share_the_budget() {
    let (config, device) = cases().remove(0);
    for read_every in [1, 1000] {
        let budgeted = |seed| Trainer::new(&config, scene(), seed, Some(0.02), &device).unwrap();
        let mut trainers: Vec<Trainer> = (0..3).map(budgeted).collect();
        trainers.iter_mut().for_each(|trainer| trainer.read_every(read_every));
        let mut active: Vec<&mut Trainer> = trainers.iter_mut().collect();
        while !active.is_empty() {
            let stepped = step_side_by_side(&mut active);
            for (trainer, (events, outcome)) in active.iter().zip(stepped) {
                assert_eq!(outcome.unwrap() == Outcome::Finished, trainer.done() >= 1.0);
                let now = trainer.progress().seconds;
                let is_told = |event: &Event| matches!(event, Event::Step { seconds, .. } if *seconds == now);
                let is_unread = read_every > 1 && trainer.done() < 1.0;
                assert!(is_unread || events.iter().any(is_told), "{events:?} at {now} s");
            }
            active.retain(|trainer| trainer.done() < 1.0);
        }
    }
}

/// Checks that a run that is broken off and resumed from its checkpoint has the values of a straight run, and so has a run
/// whose losses are read later.
#[test]
fn resuming_and_late_reading_change_nothing() {
    for (config, device) in cases() {
        let begun = |read_every| {
            let mut trainer = trainer(&config, 1, &device);
            trainer.read_every(read_every);
            trainer
        };
        let run = |read_every, broken_after: Option<usize>| {
            let (mut trainer, mut events) = (begun(read_every), Vec::new());
            if let Some(count) = broken_after {
                events.extend(steps(&mut trainer, count));
                let folder = tempfile::tempdir().unwrap();
                let checkpoint = trainer.checkpoint(&mut |event| events.push(timeless(event))).unwrap();
                assert_eq!(events.len(), count);
                checkpoint.save(folder.path()).unwrap();
                trainer = begun(read_every);
                let (checkpoint, refused) = Checkpoint::load(folder.path()).unwrap();
                assert!(refused.is_empty(), "{refused:?}");
                trainer.resume(&checkpoint.unwrap()).unwrap();
                assert_eq!(trainer.progress().step, count);
                // Pictures show what was trained, and not what would come later.
                let at = Moment { step: count - 1, progress: (count - 1) as f64 / STEPS as f64 };
                assert_eq!((trainer.snapshot().at, trainer.trained().at), (at, at));
            }
            events.extend(steps(&mut trainer, STEPS));
            let evaluation = evaluation(&trainer, &config, 1);
            assert_eq!(trainer.step(&mut |event| panic!("{event:?}")).unwrap(), Outcome::Finished);
            (events, evaluation, trainer.progress().samples_evaluated)
        };
        let expected = run(1, None);
        assert_eq!(expected.0.len(), STEPS);
        let others = [(1, Some(1)), (1, Some(2)), (1, Some(5)), (1, Some(STEPS)), (5, None), (5, Some(7))];
        for (read_every, broken_after) in others {
            assert_eq!(run(read_every, broken_after), expected, "{read_every}, broken off after {broken_after:?}");
        }
    }
}

/// Checks that a term of weight 0 is not computed, and that unseen rays that no term needs are not cast.
#[test]
fn term_of_weight_zero_renders_nothing() {
    let [flex, _] = devices();
    let off = config(&["loss.entropy.weight=0.0", "loss.kl.weight=0.0"]);
    let mut trainer = trainer(&off, 1, &flex);
    for (losses, loss) in losses(&mut trainer, 2) {
        assert_eq!(losses, BTreeMap::from([("rgb".to_owned(), loss)]));
    }
    // Two steps of 24 rays, 10 coarse samples and 16 fine ones.
    assert_eq!(trainer.progress().samples_total, 2 * 24 * (10 + 16));
}
