//! Runs as array jobs of Slurm (<https://slurm.schedmd.com/sbatch.html>).
//!
//! A line of the manifest has all that its run needs, and each task is a process of its own that runs or continues one run
//! below the manifest's folder. That folder is all that machines have to share.

mod array;
mod script;

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail};
use infonerf_report::write_atomically;

use super::Runner;
use crate::sweep::{Prepared, Sweep, manifest};
use array::JobArray;
use script::{Script, quoted};

/// Time before its end at which a task is signalled to save.
const NOTICE: Duration = Duration::from_secs(60);

/// The file that lists the jobs of a launch, so that no second one starts while they run.
const JOBS: &str = "jobs.json";

/// Resources that a job requests. `None` leaves a choice to Slurm.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct JobResources {
    /// Partition.
    pub partition: Option<String>,
    /// Memory of each run, in MiB.
    pub memory: Option<u64>,
    /// Processor cores of each run.
    pub cpus: Option<u32>,
    /// Runs at a time, at most.
    pub at_once: Option<u32>,
    /// Further options of `sbatch`, as they are.
    pub options: Vec<String>,
}

/// Slurm, as its commands on the PATH reach it.
pub struct Slurm {
    /// Resources that each job requests.
    pub resources: JobResources,
    /// The program that runs items.
    pub runner: Runner,
    /// The command that merges once all jobs have ended.
    pub merge: Vec<OsString>,
}

/// Jobs that were submitted.
#[derive(Clone, Debug)]
pub struct Jobs {
    /// Ids, that of the job that merges last.
    pub ids: Vec<String>,
    /// The file that each run leaves when it is finished.
    records: Vec<PathBuf>,
}

/// Progress of jobs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct JobProgress {
    /// Runs that are finished.
    pub finished: usize,
    /// Tasks that wait.
    pub waiting: usize,
    /// Tasks that run.
    pub running: usize,
}

/// Returns the folder of the scripts, the logs and the list of jobs of the manifest in `folder`.
fn launch_folder(folder: &Path) -> PathBuf {
    folder.join("launch")
}

impl Slurm {
    /// Submits what is missing of `sweeps`, and the job that merges when all of them have ended.
    ///
    /// # Errors
    /// One line with what Slurm printed. Items that it had accepted before stay submitted; the line names them.
    pub(super) fn submit(&self, sweeps: &[Sweep], prepared: &[Prepared]) -> Result<Jobs> {
        let limit = array_limit()?;
        let mut all: Vec<String> = Vec::new();
        let (mut records, mut lists): (Vec<PathBuf>, Vec<(PathBuf, Vec<String>)>) = Default::default();
        for (sweep, prepared) in sweeps.iter().zip(prepared).filter(|(_, prepared)| !prepared.missing.is_empty()) {
            let folder = std::path::absolute(&prepared.folder).context("--out")?;
            let mut own: Vec<String> = Vec::new();
            for array in JobArray::of(&prepared.missing, limit) {
                let script = self.array_script(&sweep.about.name, &folder, &array, own.last())?;
                let path = launch_folder(&folder).join(format!("items-{}.sh", array.base));
                let id = self.sbatch(&script, &path).with_context(|| refused(sweep, &array, &all))?;
                all.push(id.clone());
                own.push(id);
                write_jobs(&folder, &own)?;
            }
            let record = |&run: &usize| {
                let plan = sweep.run(run);
                plan.record_path(&folder.join(plan.directory()))
            };
            records.extend(prepared.missing.iter().map(record));
            lists.push((folder, own));
        }
        let (place, _) = lists.first().context("expected runs to submit")?;
        let mut script = self.script("merge", &launch_folder(place), "merge_%j.log", None)?;
        // `afterok` would never start it once a run has failed.
        script.option("dependency", &format!("afterany:{}", all.join(":")))?;
        script.line(&format!("exec {}", quoted(&self.merge)?));
        let merging = self.sbatch(&script, &launch_folder(place).join("merge.sh")).with_context(|| {
            format!(
                "jobs {} are submitted, the job that merges is not: the same command with --merge does",
                all.join(", ")
            )
        })?;
        for (folder, own) in lists {
            write_jobs(&folder, &[own, vec![merging.clone()]].concat())?;
        }
        all.push(merging);
        Ok(Jobs { ids: all, records })
    }

    /// Returns the script of an array. `exec` makes the item the process that Slurm's signal reaches (`B:`, the batch
    /// shell alone), and `--requeue` lets Slurm start it again if it was preempted or its node failed.
    fn array_script(&self, name: &str, folder: &Path, array: &JobArray, after: Option<&String>) -> Result<Script> {
        let mut script = self.script(name, &launch_folder(folder), "%A_%a.log", self.runner.timeout)?;
        let limit = self.resources.at_once.map_or_else(String::new, |limit| format!("%{limit}"));
        script.option("array", &format!("{}{limit}", array.ranges()))?;
        script.flag("requeue");
        script.option("open-mode", "append")?;
        script.option("signal", &format!("B:TERM@{}", NOTICE.as_secs()))?;
        if let (Some(job), Some(_)) = (after, self.resources.at_once) {
            // One array after the other: `%` limits each for itself.
            script.option("dependency", &format!("afterany:{job}"))?;
        }
        // The time is Slurm's to keep: it signals the item to save, and stops it.
        let runner = Runner { timeout: None, ..self.runner.clone() };
        let command = quoted(&runner.command(&folder.join(manifest::NAME)))?;
        script.line("export RAYON_NUM_THREADS=\"$SLURM_CPUS_ON_NODE\"");
        script.line(&format!("exec {command} \"$(({} + SLURM_ARRAY_TASK_ID))\"", array.base));
        Ok(script)
    }

    /// Returns a script with the resources that each job requests.
    fn script(&self, name: &str, folder: &Path, log: &str, time: Option<Duration>) -> Result<Script> {
        let mut script = Script::new();
        script.option("job-name", name)?;
        let folder = folder.to_str().context("--out: expected UTF-8")?.replace('%', "%%");
        script.option("output", &format!("{folder}/{log}"))?;
        if let Some(partition) = &self.resources.partition {
            script.option("partition", partition)?;
        }
        if let Some(memory) = self.resources.memory {
            script.option("mem", &format!("{memory}M"))?;
        }
        if let Some(cpus) = self.resources.cpus {
            script.option("cpus-per-task", &cpus.to_string())?;
        }
        if let Some(time) = time {
            script.option("time", &(time + NOTICE).as_secs().div_ceil(60).to_string())?;
        }
        Ok(script)
    }

    /// Writes the script and submits it; the id of the job.
    fn sbatch(&self, script: &Script, path: &Path) -> Result<String> {
        script.write(path)?;
        let mut args = vec!["--parsable".into()];
        args.extend(self.resources.options.iter().map(OsString::from));
        args.push(path.into());
        let printed = output("sbatch", &args)?;
        // `ID`, or `ID;CLUSTER`.
        let id = printed.trim().split(';').next();
        let id = id.filter(|id| !id.is_empty() && id.bytes().all(|c| c.is_ascii_digit()));
        Ok(id.with_context(|| format!("sbatch: expected the id of a job, found {printed:?}"))?.to_owned())
    }
}

impl Jobs {
    /// Returns the number of runs.
    pub fn runs(&self) -> usize {
        self.records.len()
    }

    /// Returns how many of the runs are finished, run and wait.
    ///
    /// # Errors
    /// If Slurm does not answer.
    pub fn progress(&self) -> Result<JobProgress> {
        // Asked first: what has ended by then has left its record.
        let (waiting, running) = live(&self.ids)?;
        let finished = self.records.iter().filter(|record| record.exists()).count();
        Ok(JobProgress { finished, waiting, running })
    }

    /// Returns the command that cancels the jobs.
    pub fn cancel(&self) -> String {
        cancel(&self.ids)
    }
}

/// Refuses to touch the manifest in `folder` while jobs of a launch run its items.
pub(crate) fn refuse_under_way(folder: &Path) -> Result<()> {
    let path = launch_folder(folder).join(JOBS);
    if !path.exists() {
        return Ok(());
    }
    let named = || path.display().to_string();
    let ids: Vec<String> = serde_json::from_slice(&fs::read(&path).with_context(named)?)
        .with_context(|| format!("{}: expected a list of jobs", path.display()))?;
    let (waiting, running) = live(&ids).with_context(|| {
        format!("{}: it is not known whether its jobs have ended (remove the file if they have)", path.display())
    })?;
    if waiting + running > 0 {
        bail!(
            "{}: a launch is under way: {waiting} of its tasks wait and {running} run: wait for them, or `{}`",
            folder.display(),
            cancel(&ids)
        );
    }
    Ok(())
}

fn write_jobs(folder: &Path, ids: &[String]) -> Result<()> {
    Ok(write_atomically(&launch_folder(folder).join(JOBS), &serde_json::to_vec(ids)?)?)
}

fn cancel(ids: &[String]) -> String {
    format!("scancel {}", ids.join(" "))
}

/// Returns how many tasks of jobs wait, and how many run.
fn live(ids: &[String]) -> Result<(usize, usize)> {
    // One line a task; %F is the id of its array's job. Asked for all jobs of the user: an id that Slurm has forgotten would
    // be an error.
    let printed = output("squeue", &["--me", "--noheader", "--array", "--format=%F %t"])?;
    let (mut waiting, mut running) = (0, 0);
    for line in printed.lines() {
        let mut words = line.split_whitespace();
        if words.next().is_some_and(|id| ids.iter().any(|job| job == id)) {
            match words.next() {
                Some("PD") => waiting += 1,
                _ => running += 1,
            }
        }
    }
    Ok((waiting, running))
}

/// Returns Slurm's `MaxArraySize`: how many tasks an array may have.
fn array_limit() -> Result<usize> {
    let printed = output("scontrol", &["show", "config"])?;
    let line = printed.lines().find_map(|line| line.trim().strip_prefix("MaxArraySize")?.trim().strip_prefix('='));
    let limit = line.and_then(|value| value.trim().parse().ok()).filter(|limit| *limit > 0);
    limit.context("scontrol show config: expected a line `MaxArraySize = NUMBER`")
}

/// Names what was not submitted, and what was.
fn refused(sweep: &Sweep, array: &JobArray, jobs: &[String]) -> String {
    let (first, last) = array.ends();
    let refused = format!("{}: items {first} to {last} were not submitted", sweep.about.name);
    match jobs {
        [] => refused,
        jobs => format!(
            "{refused} (those before are, as {}: the same command, without --overwrite, submits the rest when they have ended)",
            jobs.join(", ")
        ),
    }
}

/// Returns what `program`, a command of Slurm's, prints.
///
/// # Errors
/// If there is no such program, or it fails: with what it printed, on one line.
fn output<S: AsRef<OsStr>>(program: &str, args: &[S]) -> Result<String> {
    let output = match Command::new(program).args(args).stdin(Stdio::null()).output() {
        Err(error) if error.kind() == ErrorKind::NotFound => {
            bail!("{program}: not found: expected Slurm's commands on the PATH")
        }
        output => output.with_context(|| program.to_owned())?,
    };
    if !output.status.success() {
        let printed = String::from_utf8_lossy(&output.stderr).into_owned();
        let prefix = format!("{program}: ");
        let lines = printed.lines().map(|line| line.trim().trim_start_matches(&prefix).trim_start_matches("error: "));
        let fault = lines.filter(|line| !line.is_empty()).collect::<Vec<_>>().join("; ");
        match fault.as_str() {
            "" => bail!("{program}: {}", output.status),
            fault => bail!("{program}: {fault}"),
        }
    }
    String::from_utf8(output.stdout).with_context(|| format!("{program}: expected text"))
}
