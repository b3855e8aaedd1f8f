//! Array jobs of Slurm (<https://slurm.schedmd.com/sbatch.html>).

use std::ffi::OsString;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, Result};

use super::array::Array;
use super::command::output;
use super::script::{Script, quoted};
use super::{Batch, Launcher, Live, Resources, Runner, Scheduler};

/// How long before its time is up an item is told to save.
const NOTICE: Duration = Duration::from_secs(60);

/// Slurm, as its commands on the PATH reach it.
pub(super) struct Slurm {
    resources: Resources,
}

impl Slurm {
    pub(super) fn new(resources: Resources) -> Self {
        Self { resources }
    }

    /// The script of an array. `exec` makes the item the process that Slurm's signal reaches (`B:`, the batch shell
    /// alone), and `--requeue` lets Slurm start it again where it was preempted or its node failed.
    fn array_script(&self, batch: &Batch, array: &Array, runner: &Runner, after: Option<&str>) -> Result<Script> {
        let mut script = self.script(&batch.name, &batch.launch_folder(), "%A_%a.log", runner.timeout)?;
        let most = self.resources.at_once.map_or_else(String::new, |most| format!("%{most}"));
        script.option("array", &format!("{}{most}", array.ranges()))?;
        script.flag("requeue");
        script.option("open-mode", "append")?;
        script.option("signal", &format!("B:TERM@{}", NOTICE.as_secs()))?;
        if let (Some(job), Some(_)) = (after, self.resources.at_once) {
            // One array after the other: `%` limits each for itself.
            script.option("dependency", &format!("afterany:{job}"))?;
        }
        // The time is Slurm's to keep: it tells the item to save, and stops it.
        let command = quoted(&Runner { timeout: None, ..runner.clone() }.command(&batch.manifest))?;
        script.line("export RAYON_NUM_THREADS=\"$SLURM_CPUS_ON_NODE\"");
        script.line(&format!("exec {command} \"$(({} + SLURM_ARRAY_TASK_ID))\"", array.base));
        Ok(script)
    }

    /// A script with what each job asks for.
    fn script(&self, name: &str, folder: &Path, log: &str, time: Option<Duration>) -> Result<Script> {
        let mut script = Script::new("#SBATCH");
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
        let said = output("Slurm", "sbatch", &args)?;
        // `ID`, or `ID;CLUSTER`.
        let id = said.trim().split(';').next().filter(|id| !id.is_empty() && id.bytes().all(|c| c.is_ascii_digit()));
        Ok(id.with_context(|| format!("sbatch: expected the id of a job, found {said:?}"))?.to_owned())
    }
}

impl Scheduler for Slurm {
    fn launcher(&self) -> Launcher {
        Launcher::Slurm
    }

    /// `MaxArraySize`.
    fn array_limit(&self) -> Result<usize> {
        let said = output("Slurm", "scontrol", &["show", "config"])?;
        let line = said.lines().find_map(|line| line.trim().strip_prefix("MaxArraySize")?.trim().strip_prefix('='));
        let limit = line.and_then(|value| value.trim().parse().ok()).filter(|limit| *limit > 0);
        limit.context("scontrol show config: expected a line `MaxArraySize = NUMBER`")
    }

    fn submit(&self, batch: &Batch, array: &Array, runner: &Runner, after: Option<&str>) -> Result<String> {
        let path = batch.launch_folder().join(format!("items-{}.sh", array.base));
        self.sbatch(&self.array_script(batch, array, runner, after)?, &path)
    }

    /// `afterany`: `afterok` would never start it once an item has failed.
    fn submit_merge(&self, batch: &Batch, jobs: &[String], command: &[OsString]) -> Result<Option<String>> {
        let folder = batch.launch_folder();
        let mut script = self.script(&format!("merge-{}", batch.name), &folder, "merge_%j.log", None)?;
        script.option("dependency", &format!("afterany:{}", jobs.join(":")))?;
        script.line(&format!("exec {}", quoted(command)?));
        self.sbatch(&script, &folder.join("merge.sh")).map(Some)
    }

    fn live(&self, jobs: &[String]) -> Result<Live> {
        // One line a task; %F is the id of its array's job. Asked for all jobs of the user: an id that Slurm has
        // forgotten would be an error.
        let said = output("Slurm", "squeue", &["--me", "--noheader", "--array", "--format=%F %t"])?;
        let mut live = Live::default();
        for line in said.lines() {
            let mut words = line.split_whitespace();
            if words.next().is_some_and(|id| jobs.iter().any(|job| job == id)) {
                match words.next() {
                    Some("PD") => live.waiting += 1,
                    _ => live.running += 1,
                }
            }
        }
        Ok(live)
    }

    fn cancel(&self, jobs: &[String]) -> String {
        format!("scancel {}", jobs.join(" "))
    }
}
