//! `infonerf render`: new views of a run along a camera path.

mod animation;
mod path;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::Args;
use infonerf_experiment::{RunPlan, Trained, save_png};
use infonerf_field::FieldSpec;
use infonerf_metrics::to_rgb8;
use infonerf_render::{render_image, render_normals};
use infonerf_report::{depth_image, normal_image};

use crate::print::{errln, outln};
use crate::progress::counting_bar;
use crate::selection::DeviceArgs;
use crate::terminal::open_device;
use animation::{Animation, Film, VideoName};
use path::{PathName, Route};

const RENDER_EXAMPLES: &str = "\
Examples:
  infonerf render runs/synthetic-4view/castle/infonerf+/seed0
      once around the scene: PNG frames with depth, and orbit.gif
  infonerf render runs/llff-3view/fern/infonerf+/seed0 --path spiral --video mp4
      LLFF's spiral, also as a video (needs `ffmpeg` on PATH)
  infonerf render runs/synthetic-4view/castle/infonerf+/seed0 --path camera_path.json
      the frames of nerfstudio's camera_path.json, in the scene's own coordinates

A path of your own is JSON: {\"keyframes\": [{\"camera_to_world\": [16 numbers, row by row], \"fov\": 50}, ...],
\"seconds\": 4, \"fps\": 20, \"is_cycle\": true, \"render_width\": 800, \"render_height\": 600}; all but the poses may be left out.";

/// Render new views of a finished run along a camera path: PNG frames with depth, an animated GIF, normals and a video.
#[derive(Debug, Args)]
#[command(after_help = RENDER_EXAMPLES)]
pub(crate) struct RenderArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf+/seed0
    run: PathBuf,
    /// Camera path: orbit, spiral, figure-eight, interpolate (through the training views) or a JSON file
    #[arg(long, value_name = "PATH", default_value = "orbit")]
    path: PathName,
    /// Number of frames [default: 60, or the JSON file's]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: Option<u32>,
    /// Longest side of the frames in pixels [default: as trained, or the JSON file's]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=8192))]
    size: Option<u32>,
    /// Also write images of normals, n as (n + 1)/2 in the camera's axes (x right, y up, z towards it); takes several times as long
    #[arg(long)]
    normals: bool,
    /// Also write a video, with the installed `ffmpeg`
    #[arg(long, value_enum)]
    video: Option<VideoName>,
    /// Folder for the frames [default: RUN/render]
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Names of animations and films, next to those of path files.
const PATHS: [&str; 4] = ["orbit", "spiral", "figure-eight", "interpolate"];
/// Extensions of animations and films.
const EXTENSIONS: [&str; 4] = ["gif", "mp4", "webm", "part"];

pub(crate) fn run(args: &RenderArgs) -> Result<ExitCode> {
    // Faults of the arguments are reported before anything is loaded.
    let film = args.video.map(Film::new).transpose()?;
    let route = Route::read(&args.path)?;
    let plan = RunPlan::of_run(&args.run)?;
    if args.normals && !plan.config.field.traits().tracks_positions {
        bail!(
            "--normals: expected a field whose density has a gradient with respect to positions, found {}",
            plan.config.field
        );
    }
    let trained = Trained::read(plan, &args.run, &open_device(args.device.device)?)?;
    for warning in &trained.warnings {
        errln!("warning: {warning}");
    }
    let scene = trained.scene();
    let cameras = route.cameras(scene, args.frames, args.size);
    let (width, height) = cameras.first().map_or((0, 0), |camera| (camera.width, camera.height));
    let out = args.out.clone().unwrap_or_else(|| args.run.join("render"));
    if out.exists() && !out.is_dir() {
        bail!("{}: expected a folder for pictures, found a file", out.display());
    }
    clear(&out, route.name())?;
    std::fs::create_dir_all(&out).with_context(|| out.display().to_string())?;
    let mut animation = Animation::new(&out.join(format!("{}.gif", route.name())), route.fps())?;
    let models = trained.models_with_residuals();
    let start = Instant::now();
    outln!("{} frames of {width}×{height}; --size and --frames make fewer and smaller ones", cameras.len());
    let bar = counting_bar("frames", cameras.len());
    for (index, camera) in cameras.iter().enumerate() {
        let image = render_image(trained.renderer(), &models, camera);
        let picture = to_rgb8(&image.rgb, image.width, image.height)?;
        save_png(&picture, &out.join(format!("{index:04}.png")))?;
        let depth =
            depth_image(&image.depth, &image.acc, image.width, image.height, scene.space.near, scene.space.far)?;
        save_png(&depth, &out.join(format!("depth/{index:04}.png")))?;
        if args.normals {
            let image = render_normals(trained.renderer(), &models, camera);
            let normals = normal_image(&image.rgb, &image.acc, image.width, image.height)?;
            save_png(&normals, &out.join(format!("normals/{index:04}.png")))?;
        }
        animation.add(&picture)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let seconds = start.elapsed().as_secs_f64();
    outln!("{} frames of {width}×{height} in {seconds:.1} s: {}", cameras.len(), animation.finish()?.display());
    if let Some(film) = film {
        outln!("{}", film.write(&out, route.name(), route.fps())?.display());
    }
    Ok(ExitCode::SUCCESS)
}

/// Removes the frames and the animations of an earlier render, which would stand among the new ones; nothing else.
fn clear(out: &Path, name: &str) -> Result<()> {
    let is_frame = |stem: &str| stem.len() >= 4 && stem.bytes().all(|b| b.is_ascii_digit());
    let is_ours = |file: &str| match file.rsplit_once('.') {
        Some((stem, "png")) => is_frame(stem),
        Some((stem, extension)) => {
            let stem = stem.strip_suffix(".gif").or(stem.strip_suffix(".part")).unwrap_or(stem);
            EXTENSIONS.contains(&extension) && (PATHS.contains(&stem) || stem == name)
        }
        None => false,
    };
    for folder in [out.to_owned(), out.join("depth"), out.join("normals")] {
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        for entry in entries.flatten().filter(|entry| is_ours(&entry.file_name().to_string_lossy())) {
            std::fs::remove_file(entry.path()).with_context(|| entry.path().display().to_string())?;
        }
    }
    Ok(())
}
