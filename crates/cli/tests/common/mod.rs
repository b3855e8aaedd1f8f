//! Running the program in a folder of its own.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

/// Settings with which a run takes milliseconds: a few small tables, a few rays, two test views.
const TINY: &str = "train.iterations=3 train.rays=32 train.unseen_rays=16 train.target_samples=400 \
                    train.checkpoint_every=2 scene.size=24 eval.test=first-2 eval.information_rays=32 \
                    field.resolutions=[4,8] field.channels=2 field.width=16 field.layers=1 \
                    render.samples={from=12,to=24,end=0.5,curve=\"exponential\"} render.occupancy.resolution=8 \
                    render.occupancy.warmup=1 render.occupancy.every=1";

/// An experiment of one run, and the folder of that run.
pub const EXP: &str = "exp fast-losses --scene knot --variant factored";
pub const RUN: &str = "runs/fast-losses/knot/factored/seed0";

/// A sweep of four values, two seeds, one scene.
pub const SWEEP: &str = "sweep fast-losses --scene knot --variant infonerf --grid loss.entropy.weight=0,1e-3 \
                         --grid loss.kl.weight=0,1e-4 --seed 0..1 --set eval.information_rays=0";

/// Temporary folder that is removed after the test.
pub struct Workplace(tempfile::TempDir);

/// Command line of the program, before it is run.
pub struct Invocation(Command);

impl Workplace {
    pub fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    pub fn path(&self, part: &str) -> PathBuf {
        self.0.path().join(part)
    }

    pub fn read(&self, part: &str) -> String {
        let path = self.path(part);
        fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
    }

    /// Writes a file, and creates its folder if necessary.
    pub fn write(&self, part: &str, contents: impl AsRef<[u8]>) {
        let path = self.path(part);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, contents).unwrap();
    }

    /// Makes the command `infonerf ARGS` in this folder.
    pub fn run(&self, args: impl AsRef<str>) -> Invocation {
        let mut command = Command::new(env!("CARGO_BIN_EXE_infonerf"));
        command.env_remove("RUST_LOG").env_remove("RUST_BACKTRACE").env_remove("COLUMNS");
        // The weights of the user who runs the tests are not used.
        command.env_remove("INFONERF_WEIGHTS").env("XDG_CACHE_HOME", self.path("cache")).current_dir(self.0.path());
        Invocation(command).args(args)
    }

    /// Makes the command `infonerf ARGS` in this folder with settings that make it quick; those in `args` take precedence.
    pub fn tiny(&self, args: impl AsRef<str>) -> Invocation {
        self.tiny_without("nothing", args)
    }

    /// Makes the command `infonerf ARGS` with the quick settings except that of `key`, which `args` set in another way.
    pub fn tiny_without(&self, key: &str, args: impl AsRef<str>) -> Invocation {
        let other = |setting: &&str| setting.split('=').next() != Some(key);
        let settings: String = TINY.split(' ').filter(other).map(|setting| format!(" --set {setting}")).collect();
        let (command, rest) = args.as_ref().split_once(' ').unwrap_or((args.as_ref(), ""));
        self.run(command).args(settings).args(rest)
    }
}

impl Invocation {
    /// Runs the command, asserts success, and returns standard output.
    pub fn stdout(self) -> String {
        text(&self.succeeds().stdout)
    }

    /// Runs the command, asserts success and that standard output contains each of `parts`, and returns standard output.
    pub fn succeeds_with(self, parts: &[&str]) -> String {
        let stdout = self.stdout();
        assert_has(&stdout, parts);
        stdout
    }

    /// Adds words, which spaces separate.
    pub fn args(self, args: impl AsRef<str>) -> Self {
        args.as_ref().split_whitespace().fold(self, Self::arg)
    }

    pub fn arg(mut self, arg: &str) -> Self {
        self.0.arg(arg);
        self
    }

    pub fn env(mut self, name: &str, value: impl AsRef<OsStr>) -> Self {
        self.0.env(name, value);
        self
    }

    pub fn into_command(self) -> Command {
        self.0
    }

    pub fn succeeds(self) -> Output {
        let line = format!("{:?}", self.0.get_args());
        let output = self.into_command().output().unwrap();
        assert!(output.status.success(), "{line}: {}\n{}", output.status, text(&output.stderr));
        output
    }

    /// Runs the command, and asserts exit code 2 and one line on stderr that contains each of `parts`.
    pub fn fails_with(self, parts: &[&str]) {
        let args = format!("{:?}", self.0.get_args());
        let output = self.into_command().output().unwrap();
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{args}: {stderr}");
        assert!(!stderr.contains("panicked"), "{args}: {stderr}");
        assert_eq!(stderr.lines().count(), 1, "{args}: {stderr}");
        assert!(stderr.starts_with("error: "), "{args}: {stderr}");
        for part in parts {
            assert!(stderr.contains(part), "{args}: expected `{part}` in: {stderr}");
        }
    }
}

/// Checks that a text has each of `parts`.
pub fn assert_has(text: &str, parts: &[&str]) {
    for part in parts {
        assert!(text.contains(part), "expected `{part}` in: {text}");
    }
}

pub fn wait_for(path: &Path) {
    wait_until(&path.display().to_string(), || path.exists());
}

/// Waits until `is_there` returns true; `what` names the event in a failure.
pub fn wait_until(what: &str, is_there: impl Fn() -> bool) {
    let patience = Instant::now();
    while !is_there() {
        assert!(patience.elapsed() < Duration::from_secs(60), "{what}: not within a minute");
        sleep(Duration::from_millis(3));
    }
}

pub fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("the program speaks UTF-8")
}

/// Returns the names of the files and folders in a folder.
pub fn files(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect()
}

/// Returns the records of an experiment's `results.json`.
pub fn records(experiment: &Path) -> Vec<Value> {
    let path = experiment.join("results.json");
    let text = fs::read_to_string(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    serde_json::from_str::<Value>(&text).unwrap().as_array().unwrap().clone()
}

/// Returns records without the values that depend on the clock and the machine.
pub fn without_times(records: &[Value]) -> Vec<Value> {
    let mut records = records.to_vec();
    for record in &mut records {
        for key in ["train_seconds", "render_seconds_per_image", "peak_rss_bytes"] {
            record.as_object_mut().unwrap().remove(key).unwrap();
        }
    }
    records
}

/// Returns the events of a run's `metrics.jsonl` without times.
pub fn events(run: &Path) -> Vec<Value> {
    let text = fs::read_to_string(run.join("metrics.jsonl")).unwrap();
    let parse = |line| {
        let mut event: Value = serde_json::from_str(line).unwrap();
        for key in ["seconds", "rays_per_second"] {
            event.as_object_mut().unwrap().remove(key);
        }
        event
    };
    text.lines().map(parse).collect()
}
