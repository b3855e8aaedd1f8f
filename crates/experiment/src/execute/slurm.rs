//! Runs as array jobs of Slurm (<https://slurm.schedmd.com/sbatch.html>).
//!
//! Each task is a process that starts or continues the run of one line of the manifest, below the manifest's folder. The
//! machines of a cluster have to share only this folder.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use infonerf_report::write_atomically;

use super::Runner;
use crate::sweep::{Prepared, Sweep, manifest};

/// Time before the end of a task at which Slurm signals the task to save.
const NOTICE: Duration = Duration::from_secs(60);

const LAUNCH: &str = "launch";

/// Name of the file that lists the jobs of a launch, so that no second launch starts while they run.
const JOBS: &str = "jobs.json";

/// Slurm, used through its commands on the `PATH`, and the resources that each job requests. `None` leaves a choice to Slurm.
pub struct Slurm {
    /// Name of the partition.
    pub partition: Option<String>,
    /// Memory of each run, in MiB.
    pub memory: Option<u64>,
    /// Number of processor cores of each run.
    pub cpus: Option<u32>,
    /// Maximum number of runs at a time.
    pub at_once: Option<u32>,
    /// Further options, which are passed to `sbatch` unchanged.
    pub options: Vec<String>,
    /// Program that runs the items.
    pub runner: Runner,
    /// Command that merges the results once all jobs have ended.
    pub merge: Vec<OsString>,
}

/// Jobs that were submitted.
#[derive(Clone, Debug)]
pub struct Jobs {
    /// Ids of the jobs. The last job merges the results.
    pub ids: Vec<String>,
    /// Paths of the records, each of which exists once its run is finished.
    pub records: Vec<PathBuf>,
}

impl Slurm {
    /// Submits the missing runs of `sweeps`, and a job that merges the results once all of them have ended. If Slurm refuses,
    /// items that it had accepted before stay submitted, and the error names them.
    pub(super) fn submit(&self, sweeps: &[Sweep], prepared: &[Prepared]) -> Result<Jobs> {
        let limit = array_limit()?;
        let mut jobs = Jobs { ids: Vec::new(), records: Vec::new() };
        let mut lists: Vec<(PathBuf, Vec<String>)> = Vec::new();
        for (sweep, prepared) in sweeps.iter().zip(prepared).filter(|(_, prepared)| !prepared.missing.is_empty()) {
            let folder = std::path::absolute(&prepared.folder).context("--out")?;
            let mut own: Vec<String> = Vec::new();
            // Slurm requires ids of tasks below the limit.
            for items in prepared.missing.chunk_by(|a, b| a / limit == b / limit) {
                let base = items[0] / limit * limit;
                let script = self.array_script(&sweep.about.name, &folder, base, items, own.last())?;
                let id = self.sbatch(&script, &folder.join(LAUNCH).join(format!("items-{base}.sh")));
                let id = id.with_context(|| refused(&sweep.about.name, items, &jobs.ids))?;
                jobs.ids.push(id.clone());
                own.push(id);
                write_jobs(&folder, &own)?;
            }
            let plans = prepared.missing.iter().map(|&run| sweep.run(run));
            jobs.records.extend(plans.map(|plan| plan.record_path(&folder.join(plan.directory()))));
            lists.push((folder, own));
        }
        let (place, _) = lists.first().context("expected runs to submit")?;
        // With `afterok`, the merging job would never start if a run failed.
        let after = format!("afterany:{}", jobs.ids.join(":"));
        let options = [("job-name", "merge".to_owned()), ("dependency", after)];
        let script = self.script(place, "merge_%j.log", &options, &format!("exec {}", quoted(&self.merge)?))?;
        let merging = self.sbatch(&script, &place.join(LAUNCH).join("merge.sh")).with_context(|| {
            let ids = jobs.ids.join(", ");
            format!("jobs {ids} are submitted, the job that merges is not: the same command with --merge does")
        })?;
        for (folder, own) in lists {
            write_jobs(&folder, &[own, vec![merging.clone()]].concat())?;
        }
        jobs.ids.push(merging);
        Ok(jobs)
    }

    /// Returns the script of an array job that runs `items` after the job `after`. The id of a task is its item's number minus
    /// `base`. `exec` replaces the batch shell, which alone receives Slurm's signal (`B:`), by the item's process. `--requeue`
    /// lets Slurm restart an item after it was preempted or its node failed.
    fn array_script(
        &self,
        name: &str,
        folder: &Path,
        base: usize,
        items: &[usize],
        after: Option<&String>,
    ) -> Result<String> {
        let limit = self.at_once.map_or_else(String::new, |limit| format!("%{limit}"));
        let mut options = vec![
            ("job-name", name.to_owned()),
            ("array", ranges(items, base) + &limit),
            ("open-mode", "append".to_owned()),
            ("signal", format!("B:TERM@{}", NOTICE.as_secs())),
        ];
        // `%` limits each array separately. With a limit, the arrays therefore run one after the other.
        options.extend(after.filter(|_| self.at_once.is_some()).map(|job| ("dependency", format!("afterany:{job}"))));
        // Slurm enforces the time limit: it signals the item to save, and stops it `NOTICE` later.
        let minutes = self.runner.timeout.map(|time| (time + NOTICE).as_secs().div_ceil(60));
        options.extend(minutes.map(|minutes| ("time", minutes.to_string())));
        let runner = Runner { timeout: None, ..self.runner.clone() };
        let command = quoted(&runner.command(&folder.join(manifest::NAME)))?;
        let lines = format!(
            "#SBATCH --requeue\nexport RAYON_NUM_THREADS=\"$SLURM_CPUS_ON_NODE\"\n\
             exec {command} \"$(({base} + SLURM_ARRAY_TASK_ID))\""
        );
        self.script(folder, "%A_%a.log", &options, &lines)
    }

    /// Returns a script that runs `lines`, with `options` and the resources that each job requests as `#SBATCH` lines.
    fn script(&self, folder: &Path, log: &str, options: &[(&str, String)], lines: &str) -> Result<String> {
        let Self { partition, memory, cpus, .. } = self;
        let logs = folder.join(LAUNCH).to_str().context("--out: expected UTF-8")?.replace('%', "%%");
        let resources = [
            ("output", Some(format!("{logs}/{log}"))),
            ("partition", partition.clone()),
            ("mem", memory.map(|memory| format!("{memory}M"))),
            ("cpus-per-task", cpus.map(|cpus| cpus.to_string())),
        ];
        let resources = resources.into_iter().filter_map(|(name, value)| Some((name, value?)));
        let mut text = "#!/bin/sh\n".to_owned();
        for (name, value) in options.iter().cloned().chain(resources) {
            ensure!(
                !value.contains(char::is_control),
                "--{name} {value:?}: expected no line breaks or other control characters"
            );
            let value = value.replace('\\', "\\\\").replace('"', "\\\"");
            text += &format!("#SBATCH --{name}=\"{value}\"\n");
        }
        Ok(text + lines + "\n")
    }

    /// Writes the script to `path`, submits it, and returns the id of the job.
    fn sbatch(&self, script: &str, path: &Path) -> Result<String> {
        write_atomically(path, script.as_bytes())?;
        let mut args = vec!["--parsable".into()];
        args.extend(self.options.iter().map(OsString::from));
        args.push(path.into());
        let printed = output("sbatch", &args)?;
        // `ID`, or `ID;CLUSTER`.
        let id = printed.trim().split(';').next();
        let id = id.filter(|id| !id.is_empty() && id.bytes().all(|c| c.is_ascii_digit()));
        Ok(id.with_context(|| format!("sbatch: expected the id of a job, found {printed:?}"))?.to_owned())
    }
}

/// Returns the ids `item - base` of the tasks of increasing `items` as ranges such as `0-3,7,9-12`.
fn ranges(items: &[usize], base: usize) -> String {
    let range = |run: &[usize]| match run {
        [one] => (one - base).to_string(),
        run => format!("{}-{}", run[0] - base, run[run.len() - 1] - base),
    };
    items.chunk_by(|a, b| a + 1 == *b).map(range).collect::<Vec<_>>().join(",")
}

fn quoted(command: &[OsString]) -> Result<String> {
    let words = command.iter().map(|word| word.to_str().with_context(|| format!("{}: expected UTF-8", word.display())));
    Ok(shlex::try_join(words.collect::<Result<Vec<_>>>()?)?)
}

impl Jobs {
    /// Returns the numbers of finished runs, waiting tasks and running tasks.
    ///
    /// # Errors
    /// If Slurm does not answer.
    pub fn progress(&self) -> Result<[usize; 3]> {
        // Slurm is asked first: a task that has ended by then has already written its record.
        let (waiting, running) = live(&self.ids)?;
        Ok([self.records.iter().filter(|record| record.exists()).count(), waiting, running])
    }
}

/// Returns an error if jobs of a launch still run items of the manifest in `folder`.
pub(crate) fn check_no_running_jobs(folder: &Path) -> Result<()> {
    let path = folder.join(LAUNCH).join(JOBS);
    if !path.exists() {
        return Ok(());
    }
    let name = path.display();
    let text = fs::read(&path).with_context(|| name.to_string())?;
    let ids: Vec<String> = serde_json::from_slice(&text).with_context(|| format!("{name}: expected a list of jobs"))?;
    let unknown = || format!("{name}: it is not known whether its jobs have ended (remove the file if they have)");
    let (waiting, running) = live(&ids).with_context(unknown)?;
    let (folder, ids) = (folder.display(), ids.join(" "));
    ensure!(
        waiting + running == 0,
        "{folder}: a launch is under way: {waiting} of its tasks wait and {running} run: wait for them, or `scancel {ids}`"
    );
    Ok(())
}

fn write_jobs(folder: &Path, ids: &[String]) -> Result<()> {
    Ok(write_atomically(&folder.join(LAUNCH).join(JOBS), &serde_json::to_vec(ids)?)?)
}

/// Returns the numbers of waiting and of running tasks of the jobs `ids`.
fn live(ids: &[String]) -> Result<(usize, usize)> {
    // One line per task; %F is the id of its array job. All jobs are listed, since `squeue` fails for an id that it has forgotten.
    let printed = output("squeue", &["--me", "--noheader", "--array", "--format=%F %t"])?;
    let own =
        printed.lines().map(str::trim).filter(|line| ids.iter().any(|id| line.split_whitespace().next() == Some(id)));
    let (waiting, running): (Vec<&str>, Vec<&str>) = own.partition(|line| line.split_whitespace().nth(1) == Some("PD"));
    Ok((waiting.len(), running.len()))
}

/// Returns Slurm's `MaxArraySize`, the limit of the ids of an array's tasks.
fn array_limit() -> Result<usize> {
    let printed = output("scontrol", &["show", "config"])?;
    let line = printed.lines().find_map(|line| line.trim().strip_prefix("MaxArraySize")?.trim().strip_prefix('='));
    let limit = line.and_then(|value| value.trim().parse().ok()).filter(|limit| *limit > 0);
    limit.context("scontrol show config: expected a line `MaxArraySize = NUMBER`")
}

/// Describes which items of the experiment `name` were not submitted, and which jobs were.
fn refused(name: &str, items: &[usize], jobs: &[String]) -> String {
    let (first, last) = (items[0], items[items.len() - 1]);
    let refused = format!("{name}: items {first} to {last} were not submitted");
    if jobs.is_empty() {
        return refused;
    }
    let remedy = "the same command, without --overwrite, submits the rest when they have ended";
    format!("{refused} (those before are, as {}: {remedy})", jobs.join(", "))
}

/// Runs `program`, a command of Slurm, and returns what it prints, or an error with this on one line.
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
        let fault = if fault.is_empty() { output.status.to_string() } else { fault };
        bail!("{program}: {fault}");
    }
    String::from_utf8(output.stdout).with_context(|| format!("{program}: expected text"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_ranges_and_words_are_quoted() {
        assert_eq!(ranges(&[10, 11, 12, 15, 19], 10), "0-2,5,9");
        assert_eq!(quoted(&["a b".into(), "it's".into(), "c=1".into()]).unwrap(), "'a b' \"it's\" 'c=1'");
    }
}
