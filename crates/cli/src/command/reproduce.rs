//! `infonerf reproduce`: every synthetic table and figure of the paper, and whether what it says holds here.

use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use infonerf_report::{Chapter, Collection, write_collection};

use super::exp::print_claims;
use super::sweep::{Execution, FAILED, INTERRUPTED, Limits, Run, Sweep};
use crate::args::{DeviceName, PresetName, Selection, parse_seeds};
use crate::experiment::Experiment;
use crate::{device, interrupt};

/// What is reproduced, in the order of the report.
const EXPERIMENTS: [&str; 6] = ["synthetic-4view", "loss-ablation", "unseen-rays", "baseline", "views", "information"];

pub(crate) const REPRODUCE_EXAMPLES: &str = "\
Examples:
  infonerf reproduce
      on the built-in scenes; needs no data
  infonerf reproduce --jobs 2
      two runs at a time, with the same numbers
  infonerf reproduce --data nerf_synthetic --scene lego --only baseline --set scene.size=100
      the table of narrow and wide baselines on real Blender data
The same command again goes on where it was interrupted.";

#[derive(Debug, Args)]
pub(crate) struct ReproduceArgs {
    /// Only this experiment, again for more.
    #[arg(long, value_name = "EXPERIMENT", value_parser = EXPERIMENTS)]
    only: Vec<String>,
    /// Folder that holds the scenes' folders; without it the built-in procedural scenes are used.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// A scene to run on, again for more; by default each experiment's, or all in DIR.
    #[arg(long = "scene", value_name = "S")]
    scenes: Vec<String>,
    /// A seed, or several such as 0..4; by default each experiment's.
    #[arg(long = "seed", value_name = "N", value_parser = parse_seeds)]
    seeds: Vec<RangeInclusive<u64>>,
    /// Where to compute.
    #[arg(long, value_enum, default_value_t = DeviceName::Auto)]
    device: DeviceName,
    /// What the configs start from; the experiments set a small network over it.
    #[arg(long, value_enum)]
    preset: Option<PresetName>,
    /// Change a key of every config, such as scene.size=100.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    limits: Limits,
    /// Folder for results, which go into its folder `reproduce`.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    out: PathBuf,
}

pub(crate) fn run(args: &ReproduceArgs) -> Result<ExitCode> {
    let selection = Selection {
        data: args.data.clone(),
        scenes: args.scenes.clone(),
        variants: Vec::new(),
        seeds: args.seeds.clone(),
        device: args.device,
        preset: args.preset,
        set: args.set.clone(),
    };
    let wanted =
        EXPERIMENTS.into_iter().filter(|&name| args.only.is_empty() || args.only.iter().any(|only| only == name));
    let sweeps = wanted.map(|name| Ok(Sweep::of(Experiment::plan(name, &selection, None)?)));
    let sweeps = sweeps.collect::<Result<Vec<_>>>()?;
    device::open(args.device)?;
    let out = args.out.join("reproduce");
    let prepared = sweeps.iter().map(|sweep| sweep.prepare(&out)).collect::<Result<Vec<_>>>()?;
    interrupt::install()?;
    let run = Run { limits: &args.limits, device: args.device, halving: None };
    let (mut chapters, mut all_failed) = (Vec::new(), 0);
    for (sweep, prepared) in sweeps.iter().zip(&prepared) {
        println!("\n{}", sweep.about.title);
        match sweep.execute(prepared, &run)? {
            Execution::Interrupted => {
                println!("stopped and saved; the same command goes on");
                return Ok(ExitCode::from(INTERRUPTED));
            }
            Execution::Ended { failed, report } => {
                all_failed += failed;
                chapters.extend(report.map(|input| Chapter { input: *input, folder: sweep.about.name.clone() }));
            }
        }
    }
    write(chapters, &out)?;
    if all_failed > 0 {
        eprintln!("{all_failed} runs failed; the same command tries them again");
        return Ok(ExitCode::from(FAILED));
    }
    Ok(ExitCode::SUCCESS)
}

/// Writes the report of all experiments and prints what became of the paper's statements.
fn write(chapters: Vec<Chapter>, out: &Path) -> Result<()> {
    let collection = Collection {
        title: "InfoNeRF's synthetic tables and figures, at a small scale".into(),
        introduction: vec![
            "Each synthetic table and figure of the paper at a scale that suits a small machine, the paper's own figures \
             beside ours. Footnotes name every difference of protocol: the absolute figures are not comparable, the order \
             of the variants is."
                .into(),
        ],
        chapters,
    };
    println!();
    for chapter in &collection.chapters {
        print_claims(&chapter.input);
    }
    let files = write_collection(&collection, out)?;
    println!("\nreport: {}", files.html.display());
    Ok(())
}
