//! Task arrays of HyperQueue (<https://it4innovations.github.io/hyperqueue/stable/jobs/arrays/>).

use std::ffi::OsString;

use anyhow::{Context, Result};
use serde::Deserialize;

use super::array::Array;
use super::command::output;
use super::script::{Script, quoted};
use super::{Batch, Launcher, Live, Resources, Runner, Scheduler};

/// HyperQueue, as `hq` on the PATH reaches its server.
pub(super) struct Hyperqueue {
    resources: Resources,
}

/// A job in `hq job list`.
#[derive(Deserialize)]
struct Job {
    id: u64,
    task_stats: TaskStats,
}

#[derive(Deserialize)]
struct TaskStats {
    running: usize,
    waiting: usize,
}

impl Hyperqueue {
    pub(super) fn new(resources: Resources) -> Self {
        Self { resources }
    }

    /// The script of an array. A worker that has less time left than an item may take is not given one.
    fn script(&self, batch: &Batch, array: &Array, runner: &Runner) -> Result<Script> {
        let mut script = Script::new("#HQ");
        script.option("name", &batch.name)?;
        let folder = batch.launch_folder();
        let folder = folder.to_str().context("--out: expected UTF-8")?;
        script.option("stdout", &format!("{folder}/%{{JOB_ID}}_%{{TASK_ID}}.log"))?;
        script.option("stderr", "none")?;
        if let Some(memory) = self.resources.memory {
            script.option("resource", &format!("mem={memory}"))?;
        }
        if let Some(cpus) = self.resources.cpus {
            script.option("cpus", &cpus.to_string())?;
        }
        if let Some(time) = runner.timeout {
            script.option("time-request", &format!("{}s", time.as_secs_f64().ceil()))?;
        }
        if let Some(cpus) = self.resources.cpus {
            script.line(&format!("export RAYON_NUM_THREADS={cpus}"));
        }
        script.line(&format!(
            "exec {} \"$(({} + HQ_TASK_ID))\" 2>&1",
            quoted(&runner.command(&batch.manifest))?,
            array.base
        ));
        Ok(script)
    }
}

impl Scheduler for Hyperqueue {
    fn launcher(&self) -> Launcher {
        Launcher::Hyperqueue
    }

    /// Task ids have 32 bits.
    fn array_limit(&self) -> Result<usize> {
        Ok(u32::MAX as usize)
    }

    fn submit(&self, batch: &Batch, array: &Array, runner: &Runner, _after: Option<&str>) -> Result<String> {
        let path = batch.launch_folder().join(format!("items-{}.sh", array.base));
        self.script(batch, array, runner)?.write(&path)?;
        // Options in a script have to be in its first 32 KiB, which a list of many ranges exceeds.
        let mut args: Vec<OsString> =
            ["--output-mode=quiet".into(), "submit".into(), format!("--array={}", array.ranges()).into()].into();
        args.extend(self.resources.options.iter().map(OsString::from));
        args.push(path.into());
        let said = output("HyperQueue", "hq", &args)?;
        let id = said.trim().parse::<u64>().ok();
        Ok(id.with_context(|| format!("hq submit: expected the id of a job, found {said:?}"))?.to_string())
    }

    /// A job of HyperQueue cannot wait for another one.
    fn submit_merge(&self, _batch: &Batch, _jobs: &[String], _command: &[OsString]) -> Result<Option<String>> {
        Ok(None)
    }

    fn live(&self, jobs: &[String]) -> Result<Live> {
        let said = output("HyperQueue", "hq", &["--output-mode=json", "job", "list"])?;
        let listed: Vec<Job> =
            serde_json::from_str(&said).context("hq job list: expected a list of jobs with id and task_stats")?;
        let mut live = Live::default();
        for job in listed.iter().filter(|job| jobs.contains(&job.id.to_string())) {
            live.waiting += job.task_stats.waiting;
            live.running += job.task_stats.running;
        }
        Ok(live)
    }

    fn cancel(&self, jobs: &[String]) -> String {
        format!("hq job cancel {}", jobs.join(","))
    }
}
