//! Sweeps as jobs of a stand-in for Slurm: what is submitted, and what results from it.

#![cfg(unix)]

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use crate::common::{Invocation, SWEEP, Workplace, assert_has, records, text, without_times};
use crate::reproduce::TINY;
use serde_json::Value;

/// Workplace in which Slurm's commands are the stand-ins of `tests/schedulers`.
struct Cluster(Workplace);

impl Cluster {
    fn new() -> Self {
        let place = Workplace::new();
        fs::create_dir(place.path("jobs")).unwrap();
        Self(place)
    }

    /// Adds the stand-ins for Slurm's commands to the PATH of the command.
    fn scheduled(&self, invocation: Invocation) -> Invocation {
        let fakes = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/schedulers");
        let path = format!("{}:{}", fakes.display(), std::env::var("PATH").unwrap());
        invocation.env("PATH", path).env("JOBS", self.0.path("jobs"))
    }

    fn sweep(&self, out: &str) -> Invocation {
        self.scheduled(self.0.tiny(SWEEP).args(format!("--out {out}")))
    }

    fn slurm(&self) -> Invocation {
        self.sweep("runs").args("--launch slurm")
    }

    fn script(&self, id: u32) -> String {
        fs::read_to_string(self.0.path("jobs").join(format!("{id}.sh"))).unwrap_or_default()
    }

    /// Runs the script of a job as the task of an array.
    fn task(&self, id: u32, task: u32) -> Output {
        let mut shell = Command::new("sh");
        shell.arg(self.0.path("jobs").join(format!("{id}.sh"))).env("SLURM_ARRAY_TASK_ID", task.to_string());
        shell.env("SLURM_CPUS_ON_NODE", "1").env("XDG_CACHE_HOME", self.0.path("cache"));
        shell.env_remove("INFONERF_WEIGHTS").current_dir(self.0.path("")).output().unwrap()
    }

    fn folder(&self, out: &str) -> PathBuf {
        self.0.path(out).join("sweep-fast-losses")
    }

    fn numbers(&self, out: &str) -> Vec<Value> {
        without_times(&records(&self.folder(out)))
    }
}

#[test]
fn array_jobs_give_the_local_table() {
    let cluster = Cluster::new();
    cluster.sweep("local").succeeds();
    let asked = "--partition gpu --memory 2G --cpus 4 --jobs 3 --timeout 10m --submit-option=--account=vision";
    cluster.slurm().args(asked).env("MAX_ARRAY_SIZE", "6").succeeds_with(&["8 runs submitted as slurm 100, 101, 102"]);
    let (first, second, merge) = (cluster.script(100), cluster.script(101), cluster.script(102));
    let logs = cluster.folder("runs").join("launch");
    for line in [
        "#SBATCH --job-name=\"sweep-fast-losses\"",
        &format!("#SBATCH --output=\"{}/%A_%a.log\"", logs.display()),
        "#SBATCH --partition=\"gpu\"",
        "#SBATCH --mem=\"2048M\"",
        "#SBATCH --cpus-per-task=\"4\"",
        "#SBATCH --time=\"11\"",
        "#SBATCH --array=\"0-5%3\"",
        "#SBATCH --requeue",
        "#SBATCH --signal=\"B:TERM@60\"",
    ] {
        assert!(first.lines().any(|found| found == line), "expected {line}\n{first}");
    }
    assert!(first.starts_with("# --parsable --account=vision ") && !first.contains("--dependency"), "{first}");
    assert_has(&first, &["exec ", "\"$((0 + SLURM_ARRAY_TASK_ID))\""]);
    // Three tasks at a time are the limit of all arrays together, so the second array waits for the first.
    let after_first = "#SBATCH --dependency=\"afterany:100\"";
    assert_has(&second, &["--array=\"0-1%3\"", "\"$((6 + SLURM_ARRAY_TASK_ID))\"", after_first]);
    assert_has(&merge, &["#SBATCH --dependency=\"afterany:100:101\"", " --merge"]);

    // Item 3 is not run.
    for (job, tasks) in [(100, &[5, 4, 2, 1, 0][..]), (101, &[1, 0])] {
        for &task in tasks {
            let output = cluster.task(job, task);
            assert!(output.status.success(), "{}", text(&output.stderr));
        }
    }
    let merged = cluster.task(102, 0);
    assert_eq!(merged.status.code(), Some(1));
    assert_has(&text(&merged.stderr), &["not finished: knot/infonerf_", "(1 of 8 runs)", "without --merge tries"]);
    assert_eq!(cluster.numbers("runs").len(), 7);

    // The same command submits only the missing item.
    cluster.slurm().succeeds_with(&["8 runs, 7 finished before", "1 run submitted"]);
    assert_has(&cluster.script(103), &["--array=\"3\"\n"]);
    assert!(cluster.task(103, 3).status.success());
    assert!(cluster.task(104, 0).status.success());
    assert_eq!(cluster.numbers("local"), cluster.numbers("runs"));
    let table = |out| fs::read_to_string(cluster.folder(out).join("plots/sweep-psnr-infonerf.svg")).unwrap();
    assert_eq!(table("local"), table("runs"));
    // There is nothing left to submit.
    let stdout = cluster.slurm().succeeds_with(&["8 finished before"]);
    assert!(!stdout.contains("submitted"), "{stdout}");
}

#[test]
fn a_launch_that_is_refused_loses_nothing() {
    let cluster = Cluster::new();
    // Without Slurm: the PATH is that of an empty folder.
    cluster.slurm().env("PATH", cluster.0.path("jobs")).fails_with(&["scontrol: not found", "Slurm"]);
    let nowhere = cluster.slurm().args("--partition nowhere");
    nowhere.fails_with(&["items 0 to 7 were not submitted", "invalid partition specified: nowhere"]);
    // With a full queue, the jobs that were accepted stay submitted and are named.
    let full = cluster.slurm().env("MAX_ARRAY_SIZE", "6").env("MAX_JOBS", "1");
    full.fails_with(&["items 6 to 7 were not submitted", "as 100", "submit limit"]);
    let full = cluster.slurm().env("MAX_ARRAY_SIZE", "6").env("LIVE", "100");
    full.fails_with(&["launch is under way: 1 of its tasks wait and 1 run", "scancel 100"]);
    // Nothing else may change the manifest under running jobs either.
    cluster.sweep("runs").env("LIVE", "100").fails_with(&["launch is under way"]);
    cluster.sweep("runs").env("PATH", cluster.0.path("jobs")).fails_with(&["jobs.json", "squeue: not found"]);
    // When they have ended, the rest is submitted.
    assert!(cluster.task(100, 0).status.success());
    cluster.slurm().succeeds_with(&["1 finished before", "7 runs submitted"]);
    assert_has(&cluster.script(101), &["--array=\"1-7\"\n"]);
    // Merging is possible at any time.
    let merge = cluster.slurm().args("--merge").env("LIVE", "101").into_command().output().unwrap();
    assert_eq!((merge.status.code(), cluster.numbers("runs").len()), (Some(1), 1));

    fs::write(cluster.folder("runs").join("launch/jobs.json"), "{}").unwrap();
    cluster.slurm().fails_with(&["jobs.json", "expected a list of jobs"]);
}

#[test]
fn options_that_do_not_go_together() {
    let cluster = Cluster::new();
    let sweep = |args: &str| cluster.sweep("runs").args(args);
    for args in ["--partition gpu", "--memory 1G", "--cpus 2", "--submit-option=--hold", "--watch"] {
        let option = args.split([' ', '=']).next().unwrap();
        sweep(args).fails_with(&[option, "expected --launch slurm"]);
    }
    assert!(!cluster.0.path("runs").exists(), "nothing is written before the options are checked");
}

#[test]
fn reproduce_is_launched_as_one() {
    let cluster = Cluster::new();
    let args = "reproduce --only information --only views --scene knot --seed 0";
    let run = |more: &str| cluster.scheduled(cluster.0.run(args).args(TINY).args(more));
    let stdout = run("--launch slurm").stdout();
    let jobs = fs::read_dir(cluster.0.path("jobs")).unwrap().count();
    assert_eq!(jobs, 3, "two arrays and one job that merges: {stdout}");
    assert_has(&cluster.script(102), &["afterany:100:101"]);
    assert!(cluster.task(101, 0).status.success());
    assert_eq!(cluster.task(102, 0).status.code(), Some(1), "most runs are not finished");
    assert_has(&cluster.0.read("runs/reproduce/report.html"), &["Claims of the paper"]);
}
