//! Runs that are killed, starved of disk or of memory, or run twice at once: resumed, they reach the unbroken run's numbers, or
//! report in one line what is wrong.
//!
//! `INFONERF_KILLS=50 cargo test --release --workspace --test all kills:: -- --nocapture` is the long form.

#![cfg(unix)]

use std::fs;
use std::process::{Command, Stdio};
use std::sync::LazyLock;
use std::time::{Duration, Instant};

use crate::common::{Workplace, events, records, text, wait_for, without_times};
use serde_json::Value;

/// Run with a checkpoint after every step, which spends most of its time writing.
const RUN: &str = "exp fast-losses --scene knot --variant infonerf --set train.iterations=120 \
                   --set train.checkpoint_every=1 --set loss.kl.weight=1e-3";
const FOLDER: &str = "fast-losses/knot/infonerf/seed0";

/// Records of a run without times, and the log of its steps.
type Numbers = (Vec<Value>, Vec<Value>);

/// Numbers of an unbroken run, and the time that it takes.
static UNBROKEN: LazyLock<(Numbers, Duration)> = LazyLock::new(|| {
    let (place, start) = (Workplace::new(), Instant::now());
    place.tiny(RUN).succeeds();
    (numbers(&place, "runs"), start.elapsed())
});

fn numbers(place: &Workplace, out: &str) -> Numbers {
    (without_times(&records(&place.path(out).join("fast-losses"))), events(&place.path(out).join(FOLDER)))
}

fn command(place: &Workplace, args: &str) -> Command {
    let mut command = place.tiny(RUN).args(args).into_command();
    command.stdout(Stdio::null()).stderr(Stdio::null());
    command
}

#[test]
fn killed_runs_go_on_to_the_same_numbers() {
    let wanted: usize = std::env::var("INFONERF_KILLS").map_or(10, |kills| kills.parse().expect("a number"));
    let (place, (unbroken, life)) = (Workplace::new(), &*UNBROKEN);
    let mut rng = fastrand::Rng::with_seed(4);
    let (mut kills, mut while_writing, mut runs) = (0, 0, 0);
    while kills < wanted {
        let out = format!("run{runs}");
        let args = format!("--out {out}");
        loop {
            let stderr = place.path("stderr");
            let mut child = command(&place, &args).stderr(fs::File::create(&stderr).unwrap()).spawn().unwrap();
            // After the last kill, the run is left to end.
            let end = (kills < wanted).then(|| Instant::now() + life.mul_f64(rng.f64()));
            let is_due = || end.is_some_and(|end| Instant::now() >= end);
            let mut ended = child.try_wait().unwrap();
            while ended.is_none() && !is_due() {
                std::thread::sleep(Duration::from_millis(1));
                ended = child.try_wait().unwrap();
            }
            if let Some(status) = ended {
                assert!(status.success(), "after {kills} kills: {status}, {}", fs::read_to_string(&stderr).unwrap());
                break;
            }
            child.kill().unwrap();
            child.wait().unwrap();
            kills += 1;
            while_writing += usize::from(place.path(&out).join(FOLDER).join("checkpoint.writing").exists());
        }
        assert_eq!(*unbroken, numbers(&place, &out), "{out}, after {kills} kills in all");
        runs += 1;
    }
    eprintln!(
        "{kills} kills, {while_writing} of them while a checkpoint was written: {runs} of {runs} runs ended at the unbroken run's numbers"
    );
}

/// If files may not grow beyond a limit, as on a full disk, one line names the file, earlier checkpoints stay usable, and nothing
/// half-written is left.
#[test]
fn a_full_disk_is_told_of_and_does_no_harm() {
    let place = Workplace::new();
    for blocks in [0, 2, 8, 32] {
        let out = format!("full{blocks}");
        let run = command(&place, &format!("--out {out}"));
        let limits = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\"");
        let mut bash = Command::new("bash");
        bash.args(["-c", &limits, "bash"]).arg(run.get_program()).args(run.get_args());
        let output = bash.current_dir(run.get_current_dir().unwrap()).output().unwrap();
        let stderr = text(&output.stderr);
        if !output.status.success() {
            assert_eq!(output.status.code(), Some(2), "{blocks} blocks: {stderr}");
            let last = stderr.lines().last().unwrap_or_default();
            assert!(last.starts_with("error: "), "{blocks} blocks: {stderr}");
            assert!(stderr.lines().all(|line| line.contains("too large")), "{blocks} blocks: {stderr}");
            assert_eq!(last.contains("checkpoint.writing"), last.contains("an earlier one is kept"), "{stderr}");
        }
        assert!(!place.path(&out).join(FOLDER).join("checkpoint.writing").exists(), "{blocks} blocks");
        assert!(!output.status.success() || blocks == 32, "{blocks} blocks were enough");
        place.tiny(RUN).args(format!("--out {out}")).succeeds();
        assert_eq!(UNBROKEN.0, numbers(&place, &out), "{blocks} blocks");
    }
}

#[test]
fn two_runs_in_one_folder() {
    let place = Workplace::new();
    let mut first = command(&place, "--set train.iterations=100000").spawn().unwrap();
    wait_for(&place.path("runs").join(FOLDER).join("checkpoint/manifest.json"));
    let again = place.tiny(RUN).args("--set train.iterations=100000");
    again.fails_with(&["another process is at work on this run", FOLDER]);
    first.kill().unwrap();
    first.wait().unwrap();
}

/// Terabytes of activations are refused before anything is allocated.
#[cfg(target_os = "linux")]
#[test]
fn what_cannot_fit_into_memory_is_refused() {
    let place = Workplace::new();
    let field = "field={kind=\"nerf\",layers=64,width=4096,skip=1,position_frequencies=4,direction_frequencies=2,density=\"relu\",detail=1.0}";
    let args = format!("--set {field} --set train.target_samples=0 --set train.rays=65536");
    place.tiny(RUN).args(args).fails_with(&["train.rays and render.samples", "GiB", "available"]);
}

#[test]
fn the_number_of_threads_changes_no_number() {
    let place = Workplace::new();
    let [one, two, three] = ["1", "2", "3"].map(|threads| {
        let run = place.tiny(RUN).args(format!("--set train.iterations=20 --out {threads}"));
        run.env("RAYON_NUM_THREADS", threads).succeeds();
        numbers(&place, threads)
    });
    assert_eq!(one, two);
    assert_eq!(one, three);
}
