mod animation;
mod path;

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use clap::Args;
use image::RgbImage;
use infonerf_experiment::{RunPlan, Trained};
use infonerf_field::FieldSpec;
use infonerf_metrics::to_rgb8;
use infonerf_render::{TrainedModel, render_image, render_normals};
use infonerf_report::{counted, depth_image, normal_image, save_png};
use infonerf_scene::{Camera, resized_dimensions};

use crate::interrupt;
use crate::print::outln;
use crate::progress::counting_bar;
use crate::selection::DeviceArgs;
use crate::terminal::{open_device, read_run};
use crate::units::parse_folder;
use animation::Animation;
use path::{FRAMES, Route};

const RENDER_EXAMPLES: &str = "\
Examples:
  infonerf render runs/synthetic-4view/castle/infonerf+/seed0
      once around the scene: PNG frames with depth, and orbit.gif
  infonerf render runs/llff-3view/fern/infonerf+/seed0 --path spiral
      LLFF's spiral
  infonerf render runs/synthetic-4view/castle/infonerf+/seed0 --path camera_path.json
      the frames of nerfstudio's camera_path.json, in the coordinates of the scene's files

A path of your own is JSON: {\"keyframes\": [{\"camera_to_world\": [16 numbers, row by row], \"fov\": 50}, ...],
\"seconds\": 4, \"fps\": 20, \"is_cycle\": true, \"render_width\": 800, \"render_height\": 600}; all but the poses may be left out.";

/// Render new views of a finished run along a camera path: PNG frames with depth, an animated GIF and normals.
#[derive(Debug, Args)]
#[command(after_help = RENDER_EXAMPLES)]
pub(crate) struct RenderArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf+/seed0
    run: PathBuf,
    /// Camera path: orbit, spiral, figure-eight, interpolate (through the training views) or a JSON file
    #[arg(long, value_name = "PATH", default_value = "orbit")]
    path: String,
    /// Number of frames [default: 60, or the JSON file's]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: Option<u32>,
    /// Longest side of the frames in pixels [default: as trained, or the JSON file's]
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=8192))]
    size: Option<u32>,
    /// Also write images of normals, n as (n + 1)/2 in the camera's axes (x right, y up, z towards it); takes several times as long
    #[arg(long)]
    normals: bool,
    /// Folder for the frames [default: RUN/render]
    #[arg(long, value_name = "DIR", value_parser = parse_folder)]
    out: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Empty file that marks a folder whose frames are of this command, which may replace them.
const MARKER: &str = ".infonerf-render";

pub(crate) fn run(args: &RenderArgs) -> Result<ExitCode> {
    // Faults of the arguments are reported before anything is loaded.
    let route = Route::read(&args.path)?;
    let plan = RunPlan::of_run(&args.run)?;
    if args.normals && !plan.config.field.traits().tracks_positions {
        let expected = "a field whose density has a gradient with respect to positions";
        bail!("--normals: expected {expected}, found {}", plan.config.field);
    }
    let out = args.out.clone().unwrap_or_else(|| args.run.join("render"));
    let earlier = earlier_frames(&out, &route.name).next();
    if let Some(file) = earlier.filter(|_| args.out.is_some() && !out.join(MARKER).exists()) {
        bail!("--out {}: expected a folder without frames of another origin, found {}", out.display(), file.display());
    }
    let trained = read_run(plan, &args.run, &open_device(args.device.device)?)?;
    let cameras = route.cameras(trained.scene(), args.frames, args.size);
    interrupt::install()?;
    let (width, height) = cameras.first().map_or((0, 0), |camera| (camera.width, camera.height));
    let frames = counted(cameras.len(), "frame");
    outln!("{frames} of {width} × {height} pixels; --size makes them smaller, --frames fewer");
    let animation = write_frames(&trained, &route, &cameras, &out, args.normals)?;
    Ok(animation.map_or_else(interrupt::exit_code, |_| ExitCode::SUCCESS))
}

/// Renders what `cameras` along `route` see into the folder `out`, and returns the path of the animation; `None` if stopped.
fn write_frames(
    trained: &Trained,
    route: &Route,
    cameras: &[Camera],
    out: &Path,
    normals: bool,
) -> Result<Option<PathBuf>> {
    for file in earlier_frames(out, &route.name) {
        std::fs::remove_file(&file).with_context(|| file.display().to_string())?;
    }
    std::fs::create_dir_all(out).with_context(|| out.display().to_string())?;
    std::fs::write(out.join(MARKER), "").with_context(|| out.display().to_string())?;
    let mut animation = Animation::new(&out.join(format!("{}.gif", route.name)), route.fps)?;
    let longest = cameras.iter().map(|camera| camera.width.max(camera.height)).max().unwrap_or(1);
    let (models, start) = (trained.models_for_size(longest), Instant::now());
    let bar = counting_bar("frames", cameras.len());
    for (index, camera) in cameras.iter().enumerate() {
        if interrupt::stop_requested() {
            bar.finish_and_clear();
            return Ok(None);
        }
        let picture = match cameras[..index].iter().position(|earlier| earlier == camera) {
            Some(earlier) => copy_frame(out, earlier, index)?,
            None => render_frame(trained, &models, camera, (out, index), normals)?,
        };
        animation.add(&picture)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let (path, seconds) = (animation.finish()?, start.elapsed().as_secs_f64());
    let (width, height) = cameras.first().map_or((0, 0), |camera| (camera.width, camera.height));
    let frames = counted(cameras.len(), "frame");
    outln!("{frames} of {width} × {height} pixels in {seconds:.1} s: {}", path.display());
    Ok(Some(path))
}

/// Renders what `camera` sees, with its depth and, if asked for, its normals, to the files of frame `index` in the folder `out`.
fn render_frame(
    trained: &Trained,
    models: &[TrainedModel],
    camera: &Camera,
    (out, index): (&Path, usize),
    normals: bool,
) -> Result<RgbImage> {
    let (space, image) = (&trained.scene().space, render_image(trained.renderer(), models, camera));
    let picture = to_rgb8(&image.rgb, image.width, image.height)?;
    let depth = depth_image(&image.depth, &image.acc, image.width, image.height, space.near, space.far)?;
    save_png(&picture, &frame_file(out, "", index))?;
    save_png(&depth, &frame_file(out, "depth", index))?;
    if normals {
        let image = render_normals(trained.renderer(), models, camera);
        let normals = normal_image(&image.rgb, &image.acc, image.width, image.height)?;
        save_png(&normals, &frame_file(out, "normals", index))?;
    }
    Ok(picture)
}

/// Copies the files of frame `from` in the folder `out` to those of frame `to`, which has the same camera.
fn copy_frame(out: &Path, from: usize, to: usize) -> Result<RgbImage> {
    for kind in ["", "depth", "normals"] {
        let (from, to) = (frame_file(out, kind, from), frame_file(out, kind, to));
        if from.exists() {
            std::fs::copy(from, &to).with_context(|| to.display().to_string())?;
        }
    }
    let file = frame_file(out, "", from);
    Ok(image::open(&file).with_context(|| file.display().to_string())?.to_rgb8())
}

/// Returns the path of frame `index`: an image in the folder `out`, or its depth or normals in the subfolder `kind`.
fn frame_file(out: &Path, kind: &str, index: usize) -> PathBuf {
    out.join(kind).join(format!("{index:04}.png"))
}

/// Longest side, in pixels, of the picture that is rendered to estimate the time of others, and of the smallest frames.
const SMALL_SIZE: u32 = 128;
const MIN_FRAMES: u32 = 12;
/// Share of a frame's time that rendering takes; the rest is for writing its files.
const RENDER_SHARE: f64 = 0.8;

/// Renders the orbit into `out`, at a size for which that takes about `budget`, and returns the path as [`write_frames`] does.
pub(crate) fn write_orbit(trained: &Trained, out: &Path, budget: Duration) -> Result<Option<PathBuf>> {
    let route = Route::read("orbit")?;
    let first = |size| route.cameras(trained.scene(), Some(1), size).remove(0);
    let full = first(None);
    let longest = SMALL_SIZE.min(full.width.max(full.height));
    let (small, models) = (first(Some(longest)), trained.models_for_size(longest));
    let render = || render_image(trained.renderer(), &models, &small);
    // The first picture also prepares what the others use.
    render();
    let start = Instant::now();
    render();
    let speed = RENDER_SHARE * f64::from(small.width * small.height) / start.elapsed().as_secs_f64();
    // Each training view is rendered once for its residual, and each pose of the orbit once.
    let views = if models.iter().any(|model| model.residuals.is_some()) { trained.scene().train.len() } else { 0 };
    let renders = |cameras: &[Camera]| {
        let distinct = (0..cameras.len()).filter(|&i| !cameras[..i].contains(&cameras[i])).count();
        (distinct + views) as f64
    };
    let share = f64::from(FRAMES) / renders(&route.cameras(trained.scene(), Some(FRAMES), None));
    let (frames, size) = affordable_frames((full.width, full.height), share * speed * budget.as_secs_f64());
    let cameras = route.cameras(trained.scene(), Some(frames), Some(size));
    let (width, height) = (cameras[0].width, cameras[0].height);
    let seconds = renders(&cameras) * f64::from(width * height) / speed;
    outln!("orbit: {frames} frames of {width} × {height} pixels, about {seconds:.0} s");
    write_frames(trained, &route, &cameras, out, false)
}

/// Returns the number of frames and their longest side such that all frames together have at most `pixels` pixels. From the
/// maximum size `full` on, frames get smaller down to [`SMALL_SIZE`], then fewer down to [`MIN_FRAMES`].
fn affordable_frames(full: (u32, u32), pixels: f64) -> (u32, u32) {
    let (longest, area) = (full.0.max(full.1), f64::from(full.0) * f64::from(full.1));
    let size = (f64::from(longest) * (pixels / (f64::from(FRAMES) * area)).sqrt()) as u32;
    let smallest = SMALL_SIZE.min(longest);
    if size >= smallest {
        return (FRAMES, size.min(longest));
    }
    let (width, height) = resized_dimensions(full.0, full.1, smallest);
    (((pixels / f64::from(width * height)) as u32).clamp(MIN_FRAMES, FRAMES), smallest)
}

/// Finds the frames in the folder `out`, and the animation called `name`: an earlier render's, which would mix with new ones.
fn earlier_frames(out: &Path, name: &str) -> impl Iterator<Item = PathBuf> {
    let is_frame = |stem: &str| stem.len() >= 4 && stem.bytes().all(|b| b.is_ascii_digit());
    let animations = [format!("{name}.gif"), format!("{name}.gif.part")];
    let files = [out.to_owned(), out.join("depth"), out.join("normals")].map(std::fs::read_dir);
    files.into_iter().flatten().flatten().flatten().filter_map(move |entry| {
        let file = entry.file_name().to_string_lossy().into_owned();
        (animations.contains(&file) || file.strip_suffix(".png").is_some_and(is_frame)).then(|| entry.path())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_get_smaller_then_fewer() {
        let (smaller, fewer) = (60.0 * 400.0 * 300.0, 30.0 * 128.0 * 96.0);
        for (pixels, frames) in [(1e12, (60, 800)), (smaller, (60, 400)), (fewer, (30, 128)), (1.0, (12, 128))] {
            assert_eq!(affordable_frames((800, 600), pixels), frames, "{pixels}");
        }
        assert_eq!(affordable_frames((24, 24), 1e12), (60, 24));
    }
}
