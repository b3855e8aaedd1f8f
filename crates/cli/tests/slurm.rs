//! Sweeps on a real Slurm: `just test-slurm`.

#![cfg(unix)]

use std::fs;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use crate::common::{Workplace, records, text, without_times};
use serde_json::Value;

const LOGS: &str = "launch";

fn slurm(program: &str, args: &[&str]) -> String {
    let output = Command::new(program).args(args).output().unwrap_or_else(|error| panic!("{program}: {error}"));
    assert!(output.status.success(), "{program} {args:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// Waits for `found` to find something.
fn patiently<T>(what: &str, mut found: impl FnMut() -> Option<T>) -> T {
    let start = Instant::now();
    loop {
        if let Some(found) = found() {
            return found;
        }
        assert!(start.elapsed() < Duration::from_secs(300), "{what}: not within five minutes");
        std::thread::sleep(Duration::from_millis(50));
    }
}

/// The task `ARRAY_TASK` of the running item `item`, once its run has a checkpoint.
fn running(item: usize, run: PathBuf) -> String {
    patiently("a running item with a checkpoint", || {
        // Arrays have at most six tasks here: see scripts/slurm-node.
        let name = format!("/items-{}.sh", item / 6 * 6);
        let listed = slurm("squeue", &["--noheader", "--array", "--states=R", "--format=%i %o"]);
        let mut lines = listed.lines().filter_map(|line| line.trim().split_once(' '));
        let (id, _) =
            lines.find(|(id, command)| id.ends_with(&format!("_{}", item % 6)) && command.trim().ends_with(&name))?;
        run.join("checkpoint/manifest.json").exists().then(|| id.to_owned())
    })
}

struct SpawnedSweep<'a> {
    place: &'a Workplace,
    args: &'a str,
}

impl SpawnedSweep<'_> {
    fn spawn(&self, out: &str, more: &str) -> Child {
        let mut command =
            self.place.tiny_without("train.iterations", self.args).args(&["--out", out]).args(more).into_command();
        let file = |name: &str| fs::File::create(self.place.path(&format!("{out}.{name}"))).unwrap();
        command.stdout(file("out")).stderr(file("err")).stdin(Stdio::null()).spawn().unwrap()
    }

    /// Waits for the sweep into `out`, and returns its output with its errors and its exit code.
    fn ended(&self, mut child: Child, out: &str) -> (String, Option<i32>) {
        let code = child.wait().unwrap().code();
        let read = |name: &str| fs::read_to_string(self.place.path(&format!("{out}.{name}"))).unwrap();
        (read("out") + &read("err"), code)
    }
}

fn numbers(place: &Workplace, sweep: &str, out: &str) -> Vec<Value> {
    without_times(&records(&place.path(out).join(sweep)))
}

#[test]
#[ignore = "needs Slurm: just test-slurm"]
fn a_requeued_item_goes_on_and_the_table_is_the_local_one() {
    let place = Workplace::new();
    let args = "sweep fast-losses --scene knot --variant infonerf --grid loss.entropy.weight=0,1e-4,1e-3,1e-2 \
                --grid loss.kl.weight=0,1e-5,1e-4,1e-3 --set train.iterations=1500 --set train.checkpoint_every=50";
    let sweep = SpawnedSweep { place: &place, args };
    // A name that scripts have to quote, and Slurm to take literally.
    let slurm_out = "a \"b\" 100%";
    let child = sweep.spawn(slurm_out, "--launch slurm --cpus 1 --jobs 2 --watch");
    let folder = place.path(slurm_out).join("sweep-fast-losses");
    let run = folder.join("knot/infonerf_loss.entropy.weight_0_loss.kl.weight_1e-4/seed0");
    let task = running(2, run);
    slurm("scontrol", &["requeue", &task]);
    let (said, code) = sweep.ended(child, slurm_out);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("16 runs submitted as slurm"), "{said}");
    let shown = slurm("scontrol", &["show", "job", &task]);
    assert!(shown.contains("Restarts=1"), "{shown}");
    assert!(folder.join(LOGS).join("merge.sh").exists());

    let (said, code) = sweep.ended(sweep.spawn("local", "--jobs 2"), "local");
    assert_eq!(code, Some(0), "{said}");
    let numbers = |out| numbers(&place, "sweep-fast-losses", out);
    assert_eq!(numbers(slurm_out).len(), 16);
    assert_eq!(numbers(slurm_out), numbers("local"));
}

#[test]
#[ignore = "needs Slurm: just test-slurm"]
fn items_that_fail_take_too_long_or_are_cancelled() {
    let place = Workplace::new();
    // The scene has 100 views.
    let file = "base = 'fast-losses'\n[variants.cancelled.train]\niterations = 1500\n\
                [variants.bad.scene]\nviews = { kind = 'ids', ids = [1000] }\n\
                [variants.slow.train]\niterations = 1_000_000_000\n[variants.good.train]\niterations = 20\n";
    fs::write(place.path("mine.toml"), file).unwrap();
    let args = "sweep mine.toml --scene knot --grid loss.kl.weight=0 --timeout 60s \
                --variant cancelled --variant bad --variant slow --variant good";
    let sweep = SpawnedSweep { place: &place, args };
    let child = sweep.spawn("slurm", "--launch slurm --cpus 1 --watch");
    let folder = place.path("slurm/sweep-mine");
    let run = |variant: &str| folder.join(format!("knot/{variant}_loss.kl.weight_0/seed0"));
    let task = running(0, run("cancelled"));
    slurm("scancel", &[&task]);
    patiently("the end of a cancelled item", || {
        let state = slurm("scontrol", &["show", "job", &task]);
        state.contains("JobState=CANCELLED").then_some(())
    });
    // Slurm starts it again once the processes of the cancelled one have ended.
    patiently("a requeued item", || {
        Command::new("scontrol").args(["requeue", &task]).output().unwrap().status.success().then_some(())
    });
    let (said, code) = sweep.ended(child, "slurm");
    assert_eq!(code, Some(1), "{said}");
    assert!(said.contains("2 of 4 runs are not finished: knot/bad_"), "{said}");
    let logs = fs::read_dir(folder.join(LOGS)).unwrap().map(|entry| fs::read_to_string(entry.unwrap().path()).unwrap());
    let logs: Vec<String> = logs.collect();
    assert!(logs.iter().any(|log| log.contains("error: ") && log.contains("1000")), "{logs:?}");
    assert!(logs.iter().any(|log| log.contains("stopping after this step")), "{logs:?}");
    assert!(run("slow").join("checkpoint/manifest.json").exists(), "it saved before its time was up");

    let (said, code) = sweep.ended(sweep.spawn("local", "--jobs 2"), "local");
    assert_eq!(code, Some(1), "{said}");
    let numbers = |out| numbers(&place, "sweep-mine", out);
    assert_eq!(numbers("slurm").len(), 2);
    assert_eq!(numbers("slurm"), numbers("local"));
}
