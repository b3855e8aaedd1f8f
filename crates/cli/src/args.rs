//! The command line.

use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};
use infonerf_experiment::{DeviceName, OpenDevice, Selection, parse_seeds};
use infonerf_metrics::Networks;
use infonerf_train::Preset;

use crate::command::bench::{BENCH_EXAMPLES, BenchArgs};
use crate::command::launch::LaunchArgs;
use crate::command::reproduce::{REPRODUCE_EXAMPLES, ReproduceArgs};
use crate::command::sweep::{SWEEP_EXAMPLES, SweepArgs, SweepItemArgs};
use crate::command::tensorboard::{TENSORBOARD_EXAMPLES, TensorboardArgs};
use crate::command::view::{VIEW_EXAMPLES, ViewArgs};

/// Learn a 3D scene from a handful of photographs, and measure how well.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 120)]
pub(crate) struct Args {
    #[command(subcommand)]
    pub(crate) command: Command,
}

#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Learn a built-in scene from four views in a minute, and watch it appear.
    #[command(after_help = DEMO_EXAMPLES)]
    Demo(DemoArgs),
    /// Run an experiment: train every variant on every scene, evaluate on test views, write a report.
    #[command(after_help = EXP_EXAMPLES)]
    Exp(ExpArgs),
    /// Train one model on all scenes of an experiment, for other runs to begin with (`train.init`).
    #[command(after_help = PRETRAIN_EXAMPLES)]
    Pretrain(PretrainArgs),
    /// Run an experiment for every combination of some values, and tabulate and plot what came of it.
    #[command(after_help = SWEEP_EXAMPLES)]
    Sweep(SweepArgs),
    /// Run one line of a sweep's manifest, as the jobs of --launch do.
    SweepItem(SweepItemArgs),
    /// Run every table and figure of the paper at a small scale into one report, and tell whether what it says holds here.
    #[command(after_help = REPRODUCE_EXAMPLES)]
    Reproduce(ReproduceArgs),
    /// Write the training curves of runs as event files for TensorBoard.
    #[command(after_help = TENSORBOARD_EXAMPLES)]
    Tensorboard(TensorboardArgs),
    /// Measure speed: time against error, what skipping saves, where a step's time goes, how cost grows.
    #[command(after_help = BENCH_EXAMPLES)]
    Bench(BenchArgs),
    /// Evaluate finished runs again, at other image sizes too, or pictures that something else rendered.
    #[command(after_help = EVAL_EXAMPLES)]
    Eval(EvalArgs),
    /// List the published weights that metrics, losses and encoders need; fetch or import them.
    #[command(after_help = WEIGHTS_EXAMPLES)]
    Weights(WeightsListArgs),
    /// Render new views of a finished run along a camera path: PNG frames, an animation, and a film.
    #[command(after_help = RENDER_EXAMPLES)]
    Render(RenderArgs),
    /// Write a finished run as something that other programs read: a mesh, points, gaussian splats, a grid, its cameras, a web page.
    #[command(after_help = EXPORT_EXAMPLES)]
    Export(ExportArgs),
    /// Show runs in a browser on this machine, also while they train: scene, curves, test views beside their truth.
    #[command(after_help = VIEW_EXAMPLES)]
    View(ViewArgs),
    /// List or export scenes.
    #[command(subcommand)]
    Scene(SceneCommand),
    /// List the experiments that are built in.
    List,
    /// Write the results of several experiments as one Markdown document.
    Collect(CollectArgs),
    /// Print the completions of a shell: `infonerf completions bash > /etc/bash_completion.d/infonerf`.
    Completions {
        /// Which shell.
        shell: clap_complete::Shell,
    },
    /// Write the manual pages, one for each command.
    Man {
        /// Folder for them, such as /usr/local/share/man/man1.
        #[arg(long, value_name = "DIR", default_value = "man")]
        out: PathBuf,
    },
}

const DEMO_EXAMPLES: &str = "\
Examples:
  infonerf demo
      the crane, from four views
  infonerf demo --scene castle --device wgpu
      another scene, on a GPU";

#[derive(Clone, Debug, ClapArgs)]
pub(crate) struct DemoArgs {
    /// A built-in scene (see `infonerf scene list`).
    #[arg(long, default_value = "crane")]
    pub(crate) scene: String,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
    /// Folder for results.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub(crate) out: PathBuf,
}

const EXP_EXAMPLES: &str = "\
Examples:
  infonerf exp synthetic-4view
      NeRF and InfoNeRF on the built-in scenes, four views each; needs no data
  infonerf exp synthetic-4view --data nerf_synthetic --scene lego --set scene.size=400
      the same on real Blender data: reads nerf_synthetic/lego/transforms_train.json
  infonerf exp synthetic-4view --data nerf_synthetic --scene lego --variant infonerf --budget 60s
      one variant, one minute
  infonerf exp runs/synthetic-4view/lego/infonerf/seed0/config.toml
      a run again, with the same numbers";

const EVAL_EXAMPLES: &str = "\
Examples:
  infonerf eval runs/synthetic-4view/castle/infonerf/seed0 --test all
      on all 200 test views
  infonerf eval runs/scales/castle/nerf/seed0 runs/scales/castle/mipnerf/seed0 --scale 1/2,1/4,1/8
      how two runs stand smaller images than those that they were trained on
  infonerf eval --renders their/renders --truth their/test --out compared
      any PNG or JPEG pictures of the same names: a table, compared/comparison.json and a page with sliders";

const RENDER_EXAMPLES: &str = "\
Examples:
  infonerf render runs/synthetic-4view/castle/infonerf/seed0
      once around the scene: PNG frames with depth, and orbit.gif
  infonerf render runs/llff-3view/fern/nerf/seed0 --path spiral --video mp4
      LLFF's spiral, also as a film (needs `ffmpeg` on PATH)
  infonerf render runs/synthetic-4view/castle/infonerf/seed0 --path camera_path.json
      the frames of nerfstudio's camera_path.json, in the scene's own coordinates

A path of your own is JSON: {\"keyframes\": [{\"camera_to_world\": [16 numbers, row by row], \"fov\": 50}, ...],
\"seconds\": 4, \"fps\": 20, \"is_cycle\": true, \"render_width\": 800, \"render_height\": 600}; all but the poses may be left out.";

const EXPORT_EXAMPLES: &str = "\
Examples:
  infonerf export runs/synthetic-4view/castle/infonerf/seed0 --format glb
      a mesh with vertex colours: runs/.../seed0/export/mesh.glb
  infonerf export runs/synthetic-4view/castle/infonerf/seed0 --format splat --resolution 384 --out castle.ply
      gaussians on the surface, for viewers of 3D Gaussian Splatting
  infonerf export runs/synthetic-4view/castle/infonerf/seed0 --format html
      one page that draws the scene in any browser with WebGL2; needs nothing else";

const WEIGHTS_EXAMPLES: &str = "\
Examples:
  infonerf weights
      what there is, what needs it, and whether it is here
  infonerf weights fetch lpips-vgg
      download it, check its SHA-256, and keep it in the user's cache
  infonerf weights import vgg16-397923af.pth
      take a file that is here already: PyTorch's or safetensors";

#[derive(Clone, Debug, ClapArgs)]
pub(crate) struct ExpArgs {
    /// A built-in experiment (see `infonerf list`) or a TOML file, such as the config.toml of a run.
    pub(crate) experiment: String,
    #[command(flatten)]
    pub(crate) selection: SelectionArgs,
    /// Training time for each run, such as 60s or 5m; the schedule follows the clock.
    #[arg(long, value_name = "TIME", value_parser = parse_duration, allow_hyphen_values = true)]
    pub(crate) budget: Option<Duration>,
    /// Folder for results.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub(crate) out: PathBuf,
    /// Go on with runs that were interrupted; finished ones are kept, as --jobs and --launch always do.
    #[arg(long)]
    pub(crate) resume: bool,
    #[command(flatten)]
    pub(crate) launch: LaunchArgs,
    /// Show the runs in a browser while they train, at http://127.0.0.1:7007/ or another port (0: any that is free), with pause
    /// and stop.
    #[arg(long, value_name = "PORT", num_args = 0..=1, require_equals = true, default_missing_value = "7007")]
    pub(crate) view: Option<u16>,
    /// Print where time went and what skipping saved.
    #[arg(long)]
    pub(crate) profile: bool,
    /// Print nothing but warnings and errors.
    #[arg(long, conflicts_with = "json")]
    pub(crate) quiet: bool,
    /// Print events as JSON, one per line, for other programs.
    #[arg(long)]
    pub(crate) json: bool,
}

const PRETRAIN_EXAMPLES: &str = "\
Examples:
  infonerf pretrain pixelnerf-pretrain
      PixelNeRF on procedural scenes drawn at random; leaves runs/pixelnerf-pretrain
  infonerf pretrain pixelnerf-pretrain --data nerf_synthetic
      the same on all scenes in a folder
  infonerf exp integration-pixelnerf --set train.init=runs/pixelnerf-pretrain
      fine-tune what came of it on a few views of another scene";

#[derive(Clone, Debug, ClapArgs)]
pub(crate) struct PretrainArgs {
    /// A built-in experiment (see `infonerf list`) or a TOML file: one variant, one seed, the scenes to learn from.
    pub(crate) experiment: String,
    #[command(flatten)]
    pub(crate) selection: SelectionArgs,
    /// Folder for results: weights go to a folder of the experiment's name in it.
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub(crate) out: PathBuf,
    /// Go on if interrupted.
    #[arg(long)]
    pub(crate) resume: bool,
}

/// Which runs of an experiment, and what they change.
#[derive(Clone, Debug, ClapArgs)]
pub(crate) struct SelectionArgs {
    /// Folder that holds the scenes' folders; without it the built-in procedural scenes are used.
    #[arg(long, value_name = "DIR")]
    pub(crate) data: Option<PathBuf>,
    /// A scene to run on, again for more; by default the experiment's, or all in DIR.
    #[arg(long = "scene", value_name = "S")]
    pub(crate) scenes: Vec<String>,
    /// A variant to run, again for more; by default all of the experiment.
    #[arg(long = "variant", value_name = "V")]
    pub(crate) variants: Vec<String>,
    /// A seed, or several such as 0..4 (0 to 4): decides the training views and all random numbers. Again for more.
    #[arg(long = "seed", value_name = "N", value_parser = parse_seeds)]
    pub(crate) seeds: Vec<RangeInclusive<u64>>,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
    #[command(flatten)]
    pub(crate) weights: WeightsArgs,
    /// What the config starts from.
    #[arg(long, value_enum)]
    pub(crate) preset: Option<PresetName>,
    /// Change any key of the config, such as loss.entropy.weight=0.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub(crate) set: Vec<String>,
}

impl SelectionArgs {
    /// The same with a time budget for each run.
    pub(crate) fn selection(&self, budget: Option<Duration>) -> Selection {
        Selection {
            data: self.data.clone(),
            scenes: self.scenes.clone(),
            variants: self.variants.clone(),
            seeds: self.seeds.iter().cloned().flatten().collect(),
            preset: self.preset.map(PresetName::preset),
            set: self.set.clone(),
            budget: budget.map(|budget| budget.as_secs_f64()),
        }
    }
}

/// Networks of learned metrics.
#[derive(Clone, Debug, ClapArgs)]
pub(crate) struct WeightsArgs {
    /// A file or folder of weights of learned metrics, beside the places where `infonerf weights` looks for them.
    #[arg(long, value_name = "PATH")]
    pub(crate) weights: Option<PathBuf>,
}

impl WeightsArgs {
    /// The networks whose weights are at hand.
    pub(crate) fn networks(&self, device: &OpenDevice) -> anyhow::Result<Networks> {
        infonerf_experiment::networks(self.weights.as_deref(), device)
    }
}

/// Where to compute.
#[derive(Clone, Copy, Debug, ClapArgs)]
pub(crate) struct DeviceArgs {
    /// Where to compute: auto (the fastest one that is built in), flex, ndarray, wgpu, vulkan or cuda.
    #[arg(long, value_name = "DEVICE", default_value_t = DeviceName::Auto)]
    pub(crate) device: DeviceName,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct CollectArgs {
    /// Folder of an experiment, such as runs/synthetic-4view.
    #[arg(required = true, value_name = "DIR")]
    pub(crate) folders: Vec<PathBuf>,
    /// Heading of the document.
    #[arg(long, default_value = "Results")]
    pub(crate) title: String,
    /// File to write.
    #[arg(long, value_name = "FILE", default_value = "results.md")]
    pub(crate) out: PathBuf,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct EvalArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf/seed0; more of them are compared.
    #[arg(required_unless_present = "renders", conflicts_with = "renders", value_name = "RUN")]
    pub(crate) runs: Vec<PathBuf>,
    #[command(flatten)]
    pub(crate) pictures: PicturesArgs,
    /// Test views: all, split, every-8, first-3, 0,8,16 or a published protocol; by default as the run says.
    #[arg(long, value_name = "PROTOCOL")]
    pub(crate) test: Option<String>,
    /// Also render at smaller sizes, such as 1/2,1/4,1/8, against the test views averaged over areas; one table.
    #[arg(long = "scale", value_name = "1/N", value_delimiter = ',', value_parser = parse_scale)]
    pub(crate) scales: Vec<u32>,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
    #[command(flatten)]
    pub(crate) weights: WeightsArgs,
}

/// Pictures that something else rendered.
#[derive(Debug, ClapArgs)]
#[command(next_help_heading = "Pictures of other programs")]
pub(crate) struct PicturesArgs {
    /// Folder of rendered pictures, PNG or JPEG.
    #[arg(long, value_name = "DIR", requires = "truth", conflicts_with_all = ["test", "scales"])]
    renders: Option<PathBuf>,
    /// Folder of photographs, called as the renders but for the extension.
    #[arg(long, value_name = "DIR", requires = "renders")]
    truth: Option<PathBuf>,
    /// Folder of masks for the masked metrics, black where pixels do not count.
    #[arg(long, value_name = "DIR", requires = "renders")]
    pub(crate) masks: Option<PathBuf>,
    /// How pictures are measured: infonerf, regnerf or neural-body; see docs/protocol.md.
    #[arg(long, value_name = "NAME", requires = "renders", default_value = "infonerf")]
    pub(crate) protocol: String,
    /// A metric by its key, such as lpips_vgg, which then has to have a value; again for more. By default all that can be
    /// measured.
    #[arg(long = "metric", value_name = "KEY", requires = "renders")]
    pub(crate) metrics: Vec<String>,
    /// Leave photographs without a render out; otherwise they are an error.
    #[arg(long, requires = "renders")]
    pub(crate) partial: bool,
    /// Folder for comparison.json and comparison.html.
    #[arg(long, value_name = "DIR", requires = "renders")]
    pub(crate) out: Option<PathBuf>,
}

impl PicturesArgs {
    /// Renders and truth, if they are given.
    pub(crate) fn folders(&self) -> Option<(PathBuf, PathBuf)> {
        self.renders.clone().zip(self.truth.clone())
    }
}

#[derive(Debug, ClapArgs)]
pub(crate) struct WeightsListArgs {
    #[command(subcommand)]
    pub(crate) command: Option<WeightsCommand>,
    #[command(flatten)]
    pub(crate) weights: WeightsArgs,
}

#[derive(Debug, Subcommand)]
pub(crate) enum WeightsCommand {
    /// Download weights, check their sum, and keep what is needed; goes on where a download was cut off.
    Fetch {
        /// Names, as `infonerf weights` lists them.
        #[arg(required = true, value_name = "NAME")]
        names: Vec<String>,
    },
    /// Take a file of weights that is here: safetensors, or what PyTorch saves.
    Import {
        /// The file.
        file: PathBuf,
    },
}

#[derive(Debug, ClapArgs)]
pub(crate) struct RenderArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf/seed0.
    pub(crate) run: PathBuf,
    /// Where the camera goes: orbit, spiral, figure-eight, interpolate (through the training views) or a JSON file.
    #[arg(long, value_name = "PATH", default_value = "orbit")]
    pub(crate) path: PathName,
    /// Number of frames; by default 60, or as many as the file says.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    pub(crate) frames: Option<u32>,
    /// Longest side of a frame in pixels; by default as trained, or as the file says.
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=8192))]
    pub(crate) size: Option<u32>,
    /// Also write a film, with an installed `ffmpeg`.
    #[arg(long, value_enum)]
    pub(crate) video: Option<VideoName>,
    /// Folder for the frames; by default RUN/render.
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
}

#[derive(Debug, ClapArgs)]
pub(crate) struct ExportArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf/seed0.
    pub(crate) run: PathBuf,
    /// What to write.
    #[arg(long, value_enum)]
    pub(crate) format: FormatName,
    /// Voxels along the longest side of the scene's box, 2 to 512, by default 256; the surface is where a voxel is half
    /// opaque. A page has fewer if the field is slow, or fills so much that they would be too many.
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..=512))]
    pub(crate) resolution: Option<u32>,
    /// What the surface is taken from.
    #[arg(long, value_enum, default_value = "density")]
    pub(crate) from: SurfaceName,
    /// Collapse edges until a mesh has at most this many triangles.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..))]
    pub(crate) triangles: Option<u32>,
    /// The file; by default one in RUN/export.
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) device: DeviceArgs,
}

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
        #[arg(long, default_value_t = infonerf_scene::procedural::DEFAULT_SIZE)]
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum PresetName {
    /// Small and quick.
    Fast,
    /// The same for photographs.
    Capture,
    /// The text of the paper.
    Paper,
    /// The authors' code.
    Released,
}

impl PresetName {
    fn preset(self) -> Preset {
        match self {
            Self::Fast => Preset::Fast,
            Self::Capture => Preset::Capture,
            Self::Paper => Preset::Paper,
            Self::Released => Preset::Released,
        }
    }
}

/// Where the camera goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum PathName {
    Orbit,
    Spiral,
    FigureEight,
    Interpolate,
    File(PathBuf),
}

impl From<&str> for PathName {
    /// What is no name of a path is a file.
    fn from(text: &str) -> Self {
        match text {
            "orbit" => Self::Orbit,
            "spiral" => Self::Spiral,
            "figure-eight" => Self::FigureEight,
            "interpolate" => Self::Interpolate,
            file => Self::File(file.into()),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum VideoName {
    /// H.264, which everything plays.
    Mp4,
    /// VP9, free of patents.
    Webm,
}

/// What a surface is taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SurfaceName {
    /// The field's density: the surface is where a voxel is half opaque.
    Density,
    /// Depth as rendered from the training cameras and between them, fused: fog that pictures look through leaves nothing.
    Depth,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FormatName {
    /// Mesh with normals and vertex colours, read by MeshLab, Blender, CloudCompare, Open3D, trimesh.
    Ply,
    /// The same mesh as text, read by MeshLab, Blender, trimesh.
    Obj,
    /// The same mesh as binary glTF, read by browsers (three.js), Blender, game engines, trimesh.
    Glb,
    /// Gaussians on the surface, spherical harmonics of degree 1, read by SuperSplat, Brush and other viewers of 3DGS.
    Splat,
    /// Points on the surface with normals and colours, read by MeshLab, CloudCompare, Open3D, plyfile.
    Points,
    /// Density and colour of every voxel, read by NumPy.
    Npz,
    /// Training and test cameras as transforms.json, read by nerfstudio, instant-ngp, Brush beside the images.
    Cameras,
    /// A page that draws the field: orbit, depth, normals, training cameras; read by browsers with WebGL2. A factored field
    /// is drawn as it is, any other is baked to voxels.
    Html,
}

/// `90s`, `5m`, `1h`, `1500ms`, or seconds without a unit.
pub(crate) fn parse_duration(text: &str) -> Result<Duration, String> {
    let fault = || format!("expected a time above 0 such as 60s or 5m, found `{text}`");
    let split = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (number, unit) = text.split_at(split);
    let scale = match unit {
        "ms" => 1e-3,
        "s" | "" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(fault()),
    };
    let seconds = number.trim().parse::<f64>().map_err(|_| fault())? * scale;
    if seconds > 0.0 { Duration::try_from_secs_f64(seconds).map_err(|_| fault()) } else { Err(fault()) }
}

/// `1/8` gives 8.
fn parse_scale(text: &str) -> Result<u32, String> {
    let factor = text.trim().strip_prefix("1/").and_then(|factor| factor.parse().ok());
    factor
        .filter(|factor| (2..=64).contains(factor))
        .ok_or_else(|| format!("expected a scale from 1/2 to 1/64, found `{text}`"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales() {
        assert_eq!(parse_scale("1/8"), Ok(8));
        for text in ["", "8", "1/1", "1/0", "1/65", "2/4", "1/-2", "1/1.5"] {
            assert!(parse_scale(text).is_err(), "{text}");
        }
    }

    #[test]
    fn durations() {
        for (text, seconds) in [("60s", 60.0), ("5m", 300.0), ("1500ms", 1.5), ("7", 7.0), ("0.5h", 1800.0)] {
            assert_eq!(parse_duration(text).unwrap().as_secs_f64(), seconds);
        }
        for text in ["", "s", "0s", "-1s", "nan", "5 parsecs", "1e400s"] {
            assert!(parse_duration(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_command_line_is_consistent() {
        use clap::CommandFactory;
        Args::command().debug_assert();
    }
}
