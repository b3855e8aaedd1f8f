use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;
use clap::{Args, Subcommand};
use indicatif::{DecimalBytes, ProgressBar, ProgressStyle};
use infonerf_pretrained::{DownloadProgress, KnownWeights, Store};

use crate::print::outln;
use crate::selection::NetworkArgs;

const WEIGHTS_EXAMPLES: &str = "\
Examples:
  infonerf weights
      lists the weights, what needs them, and whether they are here
  infonerf weights fetch lpips-vgg
      downloads a file, verifies its SHA-256, and keeps it in the user's cache
  infonerf weights import vgg16-397923af.pth
      imports a local file, PyTorch's or safetensors";

/// List, download or import the published weights of metrics, losses and encoders.
#[derive(Debug, Args)]
#[command(after_help = WEIGHTS_EXAMPLES)]
pub(crate) struct WeightsArgs {
    #[command(subcommand)]
    command: Option<WeightsCommand>,
    #[command(flatten)]
    networks: NetworkArgs,
}

#[derive(Debug, Subcommand)]
enum WeightsCommand {
    /// Download weights and verify their checksums; resumes an interrupted download.
    Fetch {
        /// Names, as `infonerf weights` lists them
        #[arg(required = true, value_name = "NAME")]
        names: Vec<String>,
    },
    /// Import a local file of weights, safetensors or PyTorch's.
    Import {
        /// The file
        file: PathBuf,
    },
}

pub(crate) fn run(args: &WeightsArgs) -> Result<ExitCode> {
    let store = Store::new(args.networks.weights.as_deref())?;
    match &args.command {
        None => list(&store),
        Some(WeightsCommand::Fetch { names }) => fetch(&store, names)?,
        Some(WeightsCommand::Import { file }) => import(&store, file)?,
    }
    Ok(ExitCode::SUCCESS)
}

/// Lists the known weights: what needs them, where they are published, and where they are on this machine.
fn list(store: &Store) {
    for (weights, path) in store.status() {
        let place = path.as_ref().map_or_else(|| "not here".to_owned(), |path| path.display().to_string());
        outln!("{:17} {}", weights.name, weights.needed_by);
        outln!("{:17} {} ({})\n{:17} SHA-256 {}", "", weights.url, DecimalBytes(weights.bytes), "", weights.sha256);
        outln!("{:17} {place}", "");
    }
    outln!("\nSearched in this order:");
    for folder in store.folders() {
        outln!("  {}", folder.display());
    }
    outln!("`infonerf weights fetch NAME` downloads a file, `infonerf weights import FILE` takes a local one.");
}

fn fetch(store: &Store, names: &[String]) -> Result<()> {
    let bar = ProgressBar::new(0);
    bar.set_style(ProgressStyle::with_template("{prefix} {wide_bar} {bytes}/{total_bytes} {bytes_per_sec}")?);
    for name in names {
        let files = store.fetch(name, &mut |DownloadProgress { weights, done, total }| {
            bar.set_prefix(weights);
            bar.set_length(total);
            bar.set_position(done);
        })?;
        for file in files {
            bar.suspend(|| outln!("{}", file.display()));
        }
    }
    bar.finish_and_clear();
    Ok(())
}

fn import(store: &Store, file: &Path) -> Result<()> {
    let imported = store.import(file)?;
    for (weights, path) in &imported {
        outln!("{}: {}", weights.name, path.display());
    }
    let is_missing = |name: &&&str| KnownWeights::named(name).is_some_and(|weights| store.find(weights).is_none());
    for (KnownWeights { name: backbone, companions, .. }, _) in &imported {
        for name in companions.iter().filter(is_missing) {
            let fetch = format!("`infonerf weights fetch {name}` downloads it");
            outln!("{backbone} alone measures nothing: {name} is missing; {fetch}");
        }
    }
    Ok(())
}
