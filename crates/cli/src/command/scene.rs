use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, ensure};
use clap::Subcommand;
use infonerf_dataset::{
    PoseSearch, PoseSolver, check_folder, export, from_images, info, info_page, outline, photograph_folder,
};
use infonerf_experiment::{DeviceName, RunPlan, Trained};
use infonerf_procedural as procedural;
use infonerf_report::{counted, write_atomically};
use infonerf_scene::image::{FILM_WIDTH, dimensions, list_images};
use infonerf_scene::{Camera, Format, PoseError, Scene, Similarity};

use crate::print::{errln, outln, quoted};
use crate::progress::with_spinner;
use crate::terminal::open_device;

/// List, describe, check or export scenes; find the poses of photographs.
#[derive(Debug, Subcommand)]
pub(crate) enum SceneCommand {
    /// List the built-in scenes.
    List,
    /// Describe a folder of photographs: format, cameras, lens, bounds, splits.
    Info {
        /// Folder of the scene, or of a run, whose training cameras are compared before and after training
        dir: PathBuf,
        /// Print JSON
        #[arg(long)]
        json: bool,
        /// Write a page that shows cameras, points and the scene's box in 3D
        #[arg(long, value_name = "FILE")]
        page: Option<PathBuf>,
    },
    /// Check a capture for what makes training fail: outlying cameras, poses that do not fit the photographs, blurred images,
    /// a doubtful up axis, a narrow baseline.
    Check {
        /// Folder of the scene
        dir: PathBuf,
    },
    /// Find the poses of photographs; writes DIR/sparse/0.
    FromImages {
        /// Folder of the photographs
        dir: PathBuf,
        /// Program that finds the poses: `best` tries colmap as well if some photographs have no pose, and keeps the better poses
        #[arg(long, value_parser = ["best", "own", "colmap"], default_value = "best")]
        poses: String,
        /// Focal length of the lens: image widths (of the longer side), or with a unit, `28mm` (at 35 mm) or `3100px`
        #[arg(long, value_name = "LENGTH", value_parser = focal_length)]
        focal: Option<FocalLength>,
    },
    /// Export a built-in scene in the format of a published data set.
    Export {
        /// Name of the scene
        name: String,
        /// Folder to write
        dir: PathBuf,
        /// Format of the folder; llff suits `room`, dtu `table`, zju `figure`
        #[arg(long, value_enum, default_value = "blender")]
        format: Format,
        /// Side of the images in pixels
        #[arg(long, value_parser = clap::value_parser!(u32).range(1..=16_384), default_value_t = procedural::DEFAULT_SIZE)]
        size: u32,
    },
}

/// Focal length as `--focal` takes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum FocalLength {
    /// Focal length over the longer side of the image.
    Widths(f64),
    /// Focal length in pixels of the image file.
    Pixels(f64),
}

fn focal_length(text: &str) -> Result<FocalLength, String> {
    let parse = |number: &str| number.trim().parse::<f64>().ok().filter(|v| v.is_finite() && *v > 0.0);
    let found = match (text.strip_suffix("mm"), text.strip_suffix("px")) {
        (Some(number), _) => parse(number).map(|mm| FocalLength::Widths(mm / FILM_WIDTH)),
        (_, Some(number)) => parse(number).map(FocalLength::Pixels),
        _ => parse(text).filter(|widths| *widths < 20.0).map(FocalLength::Widths),
    };
    found.ok_or_else(|| "expected image widths such as 0.8, or `28mm` or `3100px`".into())
}

pub(crate) fn run(command: &SceneCommand) -> Result<ExitCode> {
    match command {
        SceneCommand::List => procedural::NAMES.iter().for_each(|name| outln!("{name}")),
        SceneCommand::Info { dir, json, page } => show(dir, *json, page.as_deref())?,
        SceneCommand::Check { dir } => drop(print_warnings(dir)?),
        SceneCommand::FromImages { dir, poses, focal } => {
            let focal = match focal {
                Some(FocalLength::Pixels(pixels)) => Some(pixels / f64::from(longest_side(dir)?)),
                Some(FocalLength::Widths(widths)) => Some(*widths),
                None => None,
            };
            let solver = match poses.as_str() {
                "colmap" => PoseSolver::Colmap,
                "own" => PoseSolver::Own,
                _ => PoseSolver::Best,
            };
            let search = PoseSearch { solver, focal };
            from_images(dir, &search, |line| outln!("{line}"))?;
            show(dir, false, None)?;
            outln!("next: infonerf capture {}", quoted(dir));
        }
        SceneCommand::Export { name, dir, format, size } => {
            with_spinner(format!("{}: writing {name}", dir.display()), || export(name, *size, *format, dir))?;
            show(dir, false, None)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

fn show(dir: &Path, json: bool, page: Option<&Path>) -> Result<()> {
    if dir.join("config.toml").is_file() {
        ensure!(!json, "--json: expected the folder of a scene, found a run");
        return show_run(dir, page);
    }
    let info = info(dir)?;
    if json {
        outln!("{}", serde_json::to_string_pretty(&info)?);
    } else {
        outln!("{info}");
    }
    if let Some(page) = page {
        write_page(page, &outline(dir)?, &[])?;
    }
    Ok(())
}

/// Prints how far the first field of a run has moved the training cameras.
fn show_run(dir: &Path, page: Option<&Path>) -> Result<()> {
    let trained = Trained::read(RunPlan::of_run(dir)?, dir, &open_device(DeviceName::Auto)?)?;
    let (scene, learned) = (trained.scene(), trained.trainers[0].cameras());
    let given = scene.given_cameras();
    let apart = |of: &[Camera], from: &[Camera]| {
        let error = PoseError::of(of, from, scene.space.centre.as_dvec3());
        format!("{:.2}° and {:.2} % of their distance", error.rotation_deg, error.translation_percent)
    };
    outln!("learned cameras: {} from the given ones", apart(&learned, &given));
    if let Some(exact) = &scene.exact_cameras {
        outln!("error of the given cameras: {}; of the learned ones: {}", apart(&given, exact), apart(&learned, exact));
    }
    if let Some(page) = page {
        let exact = scene.exact_cameras.as_ref().unwrap_or(&given);
        let to_scene = Similarity::between(exact, &learned, scene.space.centre.as_dvec3()).inverse();
        let learned: Vec<Camera> = learned.iter().map(|camera| to_scene.camera(camera)).collect();
        let mut as_given = scene.as_ref().clone();
        as_given.train.iter_mut().zip(given).for_each(|(view, camera)| view.camera = camera);
        write_page(page, &as_given, &learned)?;
    }
    Ok(())
}

fn write_page(page: &Path, scene: &Scene, learned: &[Camera]) -> Result<()> {
    write_atomically(page, info_page(scene, learned).as_bytes())?;
    errln!("{}", page.display());
    Ok(())
}

fn longest_side(dir: &Path) -> Result<u32> {
    let first = list_images(&photograph_folder(dir))?.into_iter().next();
    let (width, height) = dimensions(&first.with_context(|| format!("{}: no photographs", dir.display()))?)?;
    Ok(width.max(height))
}

/// Prints the warnings about a capture, one per line, and returns them.
pub(crate) fn print_warnings(dir: &Path) -> Result<Vec<String>> {
    let (views, warnings, note) = with_spinner(format!("{}: checking the scene", dir.display()), || check_folder(dir))?;
    warnings.iter().for_each(|warning| outln!("{warning}"));
    if warnings.is_empty() {
        let note = note.map_or_else(String::new, |note| format!("; {note}"));
        outln!("{}: {}, no warnings{note}", dir.display(), counted(views, "view"));
    }
    Ok(warnings)
}
