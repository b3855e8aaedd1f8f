//! `infonerf scene`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result};
use clap::{Subcommand, ValueEnum};
use infonerf_dataset::{SceneSource, check, export, from_images, info, info_page, load, outline};
use infonerf_procedural as procedural;
use infonerf_report::write_atomically;
use infonerf_scene::{Format, SceneRequest, TestProtocol, ViewSelection};

/// List or export scenes.
#[derive(Debug, Subcommand)]
pub(crate) enum SceneCommand {
    /// List the built-in scenes.
    List,
    /// What is in a folder of photographs: format, cameras, lens, bounds, splits; with a page that shows them in 3D.
    Info {
        /// The folder.
        dir: PathBuf,
        /// As JSON.
        #[arg(long)]
        json: bool,
        /// Write a page that shows cameras, points and the scene's box.
        #[arg(long, value_name = "FILE")]
        page: Option<PathBuf>,
    },
    /// Look for what makes captures fail: cameras far off, blurred images, a doubtful up axis, a narrow baseline.
    Check {
        /// The folder.
        dir: PathBuf,
    },
    /// Find the poses of photographs with an installed `colmap`: writes DIR/sparse/0.
    FromImages {
        /// The folder that holds the photographs.
        dir: PathBuf,
    },
    /// Write a built-in scene as a folder in the format of a published data set.
    Export {
        /// Name of the scene.
        name: String,
        /// Folder to write.
        dir: PathBuf,
        /// The format.
        #[arg(long, value_enum, default_value = "blender")]
        format: SceneFormatName,
        /// Side of the images in pixels.
        #[arg(long, default_value_t = infonerf_procedural::DEFAULT_SIZE)]
        size: u32,
    },
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SceneFormatName {
    /// Training and test images with coverage, and exact depth, as NeRF's synthetic scenes.
    Blender,
    /// Forty photographs, poses and depth bounds, as the captures of LLFF; suits `room`.
    Llff,
    /// Forty-nine photographs, projection matrices and masks, as DTU in IDR's and NeuS's copies; suits `table`.
    Dtu,
    /// A frame of 23 cameras that distort, masks and a body, as ZJU-MoCap; suits `figure`.
    Zju,
}

/// Longest side of the images that are looked at for blur, in pixels: enough to tell, little to read.
const CHECKED_SIZE: u32 = 512;

pub(crate) fn run(command: &SceneCommand) -> Result<ExitCode> {
    match command {
        SceneCommand::List => procedural::NAMES.iter().for_each(|name| println!("{name}")),
        SceneCommand::Info { dir, json, page } => show(dir, *json, page.as_deref())?,
        SceneCommand::Check { dir } => warn(dir)?,
        SceneCommand::FromImages { dir } => {
            from_images(dir, |line| println!("{line}"))?;
            show(dir, false, None)?;
        }
        SceneCommand::Export { name, dir, format, size } => {
            export(name, *size, format_of(*format), dir)?;
            show(dir, false, None)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn format_of(format: SceneFormatName) -> Format {
    match format {
        SceneFormatName::Blender => Format::Blender,
        SceneFormatName::Llff => Format::Llff,
        SceneFormatName::Dtu => Format::Dtu,
        SceneFormatName::Zju => Format::Zju,
    }
}

fn show(dir: &Path, json: bool, page: Option<&Path>) -> Result<()> {
    let info = info(dir)?;
    if json {
        println!("{}", serde_json::to_string_pretty(&info)?);
    } else {
        println!("{info}");
    }
    if let Some(page) = page {
        write_atomically(page, info_page(&outline(dir)?).as_bytes())?;
        eprintln!("{}", page.display());
    }
    Ok(())
}

/// Prints what may be wrong, a line each; nothing is a good sign.
fn warn(dir: &Path) -> Result<()> {
    let request = SceneRequest {
        train: ViewSelection::All,
        test: TestProtocol::All,
        image_size: Some(CHECKED_SIZE),
        ..SceneRequest::default()
    };
    let scene = load(&SceneSource::Folder { path: dir.to_owned() }, &request).context("the scene cannot be loaded")?;
    let warnings = check(&scene);
    for warning in &warnings {
        println!("{warning}");
    }
    if warnings.is_empty() {
        println!("{}: {} views, nothing to warn of", dir.display(), scene.train.len() + scene.test.len());
    }
    Ok(())
}
