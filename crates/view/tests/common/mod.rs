//! Small runs for the tests.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};

use infonerf_experiment::{
    Control, DeviceName, Existing, Experiment, Finished, OpenDevice, RunEvent, RunPlan, Selection, Session, open,
    save_record,
};
use infonerf_view::{Server, TrainingControl};

/// Settings of a run of a few steps, with a field of small tables.
pub const TINY: &str = "train.iterations=4 train.checkpoint_every=2 train.rays=64 train.unseen_rays=16 \
                        train.target_samples=1000 scene.size=24 eval.test=first-2 eval.information_rays=32 \
                        field.resolutions=[8,16] field.view_dependence=0.4 render.occupancy.resolution=8 \
                        render.occupancy.warmup=1 render.occupancy.every=1";

pub fn device() -> OpenDevice {
    open(DeviceName::Flex).unwrap()
}

pub fn plan(variant: &str, settings: &str) -> RunPlan {
    plan_of("crane", "fast-losses", variant, settings)
}

/// Plans a run with settings that spaces separate.
pub fn plan_of(scene: &str, experiment: &str, variant: &str, settings: &str) -> RunPlan {
    let [scenes, variants] = [scene, variant].map(|name| vec![name.to_owned()]);
    let set = settings.split(' ').map(str::to_owned).collect();
    let selection = Selection { scenes, variants, set, ..Selection::default() };
    Experiment::plan(experiment, &selection).unwrap().runs.remove(0)
}

/// Trains and evaluates below `out`, and returns the run's folder. `stop` ends training at that step.
pub fn train(out: &Path, plan: &RunPlan, stop: Option<usize>) -> PathBuf {
    let session = Session::new(device(), out, Existing::Continue);
    let mut watch = |event: RunEvent<'_>| match event {
        RunEvent::Training { trainer, .. } if Some(trainer.progress().step) == stop => Control::Stop,
        _ => Control::Continue,
    };
    let folder = session.out.join(&plan.experiment);
    match session.run(plan, &mut watch).unwrap() {
        Finished::Record(record, _) => save_record(&folder, &record).unwrap(),
        Finished::Stopped => assert!(stop.is_some()),
        Finished::AlreadyDone(_) => panic!("the run was finished before"),
    }
    folder.join(plan.directory())
}

/// Serves `root` from a thread that ends with the test.
pub fn serve(root: &Path, training: Option<TrainingControl>) -> SocketAddr {
    let server = Server::start(&[root.to_owned()], "127.0.0.1:0".parse().unwrap(), device(), training).unwrap();
    let address = server.url().trim_start_matches("http://").trim_end_matches('/').parse().unwrap();
    std::thread::spawn(move || server.wait());
    address
}
