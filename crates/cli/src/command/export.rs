//! `infonerf export`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use glam::{DMat4, Vec3};
use infonerf_dataset::{SceneSource, transforms};
use infonerf_experiment::{RunPlan, Trained, TrainedVolume};
use infonerf_export::{
    Chamfer, DepthMap, ExportError, Gaussian, Grid, Mesh, Surface, Target, Volume, chamfer, gaussians, glb, npz, obj,
    ply_mesh, ply_points, ply_splats, refine, splat_picture, surface_density,
};
use infonerf_metrics::{Picture, psnr};
use infonerf_procedural as procedural;
use infonerf_render::render_image;
use infonerf_report::{VIEWER_PAGE, write_atomically};
use infonerf_scene::{Camera, Lens, Scene, ViewRegion, interpolate_views, resized_dimensions};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::print::{errln, outln};
use crate::selection::DeviceArgs;
use crate::terminal::open_device;

const EXPORT_EXAMPLES: &str = "\
Examples:
  infonerf export runs/synthetic-4view/castle/infonerf+/seed0 --format glb
      a mesh with vertex colours: runs/.../seed0/export/mesh.glb
  infonerf export runs/synthetic-4view/castle/infonerf+/seed0 --format splat --resolution 384 --out castle.ply
      gaussians on the surface, for viewers of 3D Gaussian Splatting
  infonerf export runs/synthetic-4view/castle/infonerf+/seed0 --format html
      one page that draws the scene in any browser with WebGL2; needs nothing else";

/// Export a finished run: a mesh, points, gaussian splats, a voxel grid, its cameras or a web page.
#[derive(Debug, Args)]
#[command(after_help = EXPORT_EXAMPLES)]
pub(crate) struct ExportArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf+/seed0.
    run: PathBuf,
    /// What to write.
    #[arg(long, value_enum)]
    format: FormatName,
    /// Voxels along the longest side of the scene's box, 2 to 512, by default 256, for splats 128. A page has fewer if the field is slow, or
    /// fills so much that they would be too many.
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..=512))]
    resolution: Option<u32>,
    /// What the surface is taken from.
    #[arg(long, value_enum, default_value = "density")]
    from: SurfaceName,
    /// Collapse edges until a mesh has at most this many triangles.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..))]
    triangles: Option<u32>,
    /// The file; by default one in RUN/export.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

/// What a surface is taken from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SurfaceName {
    /// The field's density: the isosurface that looks most like the field to the training cameras.
    Density,
    /// Depth as rendered from the training cameras and between them, fused: fog that pictures look through leaves nothing.
    Depth,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FormatName {
    /// Mesh with normals and vertex colours, read by MeshLab, Blender, CloudCompare, Open3D, trimesh.
    Ply,
    /// The same mesh as text, read by MeshLab, Blender, trimesh.
    Obj,
    /// The same mesh as binary glTF, read by browsers (three.js), Blender, game engines, trimesh.
    Glb,
    /// Gaussians on the surface, fitted to the field's pictures, spherical harmonics of degree 1, read by SuperSplat, Brush and other viewers of 3DGS.
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

/// Points on the exported surface, and pixels along a side of the cameras that find points of the exact one: enough for
/// distances of a fraction of a voxel.
const FOUND_POINTS: usize = 100_000;
const TRUTH_SIZE: u32 = 48;
/// Voxels along the longest side of the scene's box, where the command line does not say how many.
const RESOLUTION: usize = 256;
/// The same for splats: finer ones fit no better in the steps that they are refined for.
const SPLAT_RESOLUTION: usize = 128;
/// Test views on which splats are measured at most.
const TEST_VIEWS: usize = 8;
/// Cameras on a path through the training cameras from which depth is rendered.
const DEPTH_VIEWS: usize = 60;
/// Pictures that splats are fitted to beside those of the training cameras.
const SPLAT_VIEWS: usize = 36;
/// The greatest longest side of these pictures, and steps of the fit.
const SPLAT_SIDE: u32 = 200;
const SPLAT_STEPS: usize = 240;

pub(crate) fn run(args: &ExportArgs) -> Result<ExitCode> {
    args.check()?;
    let plan = RunPlan::of_run(&args.run)?;
    let source = plan.source.clone();
    let out = args.out.clone().unwrap_or_else(|| args.run.join(default_name(args.format)));
    prepare(&out)?;
    let Exported { bytes, summary, surface } = match args.format {
        FormatName::Ply => Sampled::read(plan, args)?.mesh(|mesh, _| Ok(ply_mesh(mesh)))?,
        FormatName::Obj => Sampled::read(plan, args)?.mesh(|mesh, _| Ok(obj(mesh).into_bytes()))?,
        FormatName::Glb => Sampled::read(plan, args)?.mesh(glb)?,
        FormatName::Splat => Sampled::read(plan, args)?.splats()?,
        FormatName::Points => Sampled::read(plan, args)?.points()?,
        FormatName::Npz => Sampled::read(plan, args)?.voxels()?,
        FormatName::Cameras => cameras(&plan)?,
        FormatName::Html => page(plan, args)?,
    };
    write_atomically(&out, &bytes)?;
    outln!("{}: {summary}, {:.1} MB", out.display(), bytes.len() as f64 / 1e6);
    if let (Some(surface), SceneSource::Procedural(name)) = (surface, &source)
        && let Some(distance) = distance(&surface, name)?
    {
        outln!(
            "chamfer distance to the exact surface that the training cameras see: {:.4} (accuracy {:.4}, completeness \
             {:.4}); a voxel is {:.4}",
            distance.mean(),
            distance.accuracy,
            distance.completeness,
            surface.voxel
        );
    }
    if let Some(help) = args.format.to_possible_value().and_then(|value| value.get_help().map(ToString::to_string)) {
        outln!("{help}");
    }
    Ok(ExitCode::SUCCESS)
}

/// A file before it is written.
struct Exported {
    bytes: Vec<u8>,
    /// A description of its contents.
    summary: String,
    /// The surface that it was made from, if it was.
    surface: Option<Surface>,
}

impl ExportArgs {
    /// Refuses what the format has no use for.
    fn check(&self) -> Result<()> {
        use FormatName::{Cameras, Glb, Html, Npz, Obj, Ply};
        if self.triangles.is_some() && !matches!(self.format, Ply | Obj | Glb) {
            bail!("--triangles: expected a mesh (ply, obj or glb)");
        }
        if self.from == SurfaceName::Depth && matches!(self.format, Npz | Cameras | Html) {
            bail!("--from depth: expected a format with a surface (ply, obj, glb, splat or points)");
        }
        Ok(())
    }
}

/// Default file of an export, in the run's folder.
fn default_name(format: FormatName) -> &'static str {
    match format {
        FormatName::Ply => "export/mesh.ply",
        FormatName::Obj => "export/mesh.obj",
        FormatName::Glb => "export/mesh.glb",
        FormatName::Splat => "export/splat.ply",
        FormatName::Points => "export/points.ply",
        FormatName::Npz => "export/grid.npz",
        FormatName::Cameras => "export/transforms.json",
        FormatName::Html => VIEWER_PAGE,
    }
}

/// Makes the folder of the file: what cannot be written is found out before the work.
fn prepare(out: &Path) -> Result<()> {
    if out.is_dir() {
        bail!("{}: expected a file to write, found a folder", out.display());
    }
    let folder =
        out.parent().filter(|folder| !folder.as_os_str().is_empty()).map_or(PathBuf::from("."), Path::to_owned);
    fs::create_dir_all(&folder).with_context(|| out.display().to_string())
}

fn cameras(plan: &RunPlan) -> Result<Exported> {
    let scene = plan.load()?;
    let summary = format!("{} training and {} test cameras", scene.train.len(), scene.test.len());
    let bytes = format!("{:#}\n", transforms(&scene)).into_bytes();
    Ok(Exported { bytes, summary, surface: None })
}

fn page(plan: RunPlan, args: &ExportArgs) -> Result<Exported> {
    let trained = read(plan, args)?;
    let voxels = args.resolution.map(|voxels| voxels as usize);
    let page = infonerf_view::page(&trained, voxels).with_context(|| args.run.display().to_string())?;
    Ok(Exported { bytes: page.into_bytes(), summary: "a page that draws the scene".to_owned(), surface: None })
}

/// The fields of a run.
fn read(plan: RunPlan, args: &ExportArgs) -> Result<Trained> {
    let trained = Trained::read(plan, &args.run, &open_device(args.device.device)?)?;
    for warning in &trained.warnings {
        errln!("warning: {warning}");
    }
    Ok(trained)
}

/// Cameras like the first training camera at the training cameras' poses and some `more`, with pictures of at most `side` pixels
/// along the longest side.
fn cameras_at(training: &[Camera], more: Vec<DMat4>, side: u32) -> impl Iterator<Item = Camera> {
    let like = &training[0];
    let (width, height) = resized_dimensions(like.width, like.height, like.width.max(like.height).min(side));
    let poses = training.iter().map(|camera| camera.to_world).chain(more);
    poses.map(move |pose| like.resized(width, height).with_pose(pose))
}

fn training_cameras(scene: &Scene) -> Vec<Camera> {
    scene.train.iter().map(|view| view.camera.clone()).collect()
}

/// Depth as rendered from the training cameras and from a path through them; no finer than the voxels.
fn depth_maps(trained: &Trained, resolution: usize) -> Vec<DepthMap> {
    let (models, training) = (trained.models(), training_cameras(trained.scene()));
    let of_camera = |camera| DepthMap { depth: render_image(trained.renderer(), &models, &camera).depth, camera };
    cameras_at(&training, interpolate_views(&training, DEPTH_VIEWS), resolution as u32).map(of_camera).collect()
}

/// Pictures of the field for splats to be fitted to: from the training cameras and from random poses in the region that they span.
/// Splats have no lens, so these have none; test views have no part in them.
fn targets(trained: &Trained) -> Vec<Target> {
    let (models, training) = (trained.models(), training_cameras(trained.scene()));
    let (region, mut rng) = (ViewRegion::new(&training), ChaCha8Rng::seed_from_u64(0));
    let poses = (0..SPLAT_VIEWS).map(|_| region.sample(&mut rng)).collect();
    let of_camera = |camera: Camera| {
        let camera = camera.with_lens(Lens::default());
        Target { picture: render_image(trained.renderer(), &models, &camera).rgb, camera }
    };
    cameras_at(&training, poses, SPLAT_SIDE).map(of_camera).collect()
}

/// The fields of a run and their densities.
struct Sampled {
    trained: Trained,
    volume: TrainedVolume,
    grid: Grid,
    /// Triangles of a mesh, at most.
    triangles: Option<usize>,
}

impl Sampled {
    fn read(plan: RunPlan, args: &ExportArgs) -> Result<Self> {
        let trained = read(plan, args)?;
        let volume = trained.volume();
        let usual = if args.format == FormatName::Splat { SPLAT_RESOLUTION } else { RESOLUTION };
        let resolution = args.resolution.map_or(usual, |voxels| voxels as usize);
        let grid = match args.from {
            SurfaceName::Density => {
                Grid::sample(&volume, resolution, surface_density(&volume, &training_cameras(trained.scene()))?)?
            }
            SurfaceName::Depth => Grid::fuse(volume.bounds(), resolution, &depth_maps(&trained, resolution))?,
        };
        Ok(Self { trained, volume, grid, triangles: args.triangles.map(|triangles| triangles as usize) })
    }

    /// A mesh, which `encode` makes a file of, given the scene's up direction.
    fn mesh(&self, encode: fn(&Mesh, Vec3) -> Result<Vec<u8>, ExportError>) -> Result<Exported> {
        let mut surface = Surface::extract(&self.grid)?;
        if let Some(triangles) = self.triangles {
            surface = surface.simplified(triangles);
        }
        let mesh = Mesh::new(surface, &self.volume);
        let bytes = encode(&mesh, self.trained.scene().space.up)?;
        let Mesh { surface, .. } = mesh;
        let (vertices, triangles) = (surface.positions.len(), surface.triangles.len());
        let dropped = surface.dropped;
        let summary = format!("{vertices} vertices, {triangles} triangles ({dropped} small components left out)");
        Ok(Exported { bytes, summary, surface: Some(surface) })
    }

    fn points(&self) -> Result<Exported> {
        let mesh = Mesh::new(Surface::extract(&self.grid)?, &self.volume);
        let summary = format!("{} points", mesh.colors.len());
        Ok(Exported { bytes: ply_points(&mesh), summary, surface: Some(mesh.surface) })
    }

    fn splats(&self) -> Result<Exported> {
        let surface = Surface::extract(&self.grid)?;
        let mut splats = gaussians(&surface, &self.volume);
        let scene = self.trained.scene();
        refine(&mut splats, &targets(&self.trained), scene.background, SPLAT_STEPS);
        let summary = format!("{} gaussians{}", splats.len(), fidelity(&splats, &self.trained)?);
        Ok(Exported { bytes: ply_splats(&splats), summary, surface: Some(surface) })
    }

    fn voxels(&self) -> Result<Exported> {
        let [x, y, z] = self.grid.size.to_array();
        let summary = format!("density and colour of {x}x{y}x{z} voxels");
        Ok(Exported { bytes: npz(&self.grid, &self.volume)?, summary, surface: None })
    }
}

/// The mean PSNR of pictures of `splats` on test views, and of the field's own, as a part of a sentence; nothing without test
/// views or behind a lens, which splats are not rendered through.
fn fidelity(splats: &[Gaussian], trained: &Trained) -> Result<String> {
    let (scene, models) = (trained.scene(), trained.models());
    let views: Vec<_> = scene.test.iter().filter(|view| view.camera.lens.is_perspective()).take(TEST_VIEWS).collect();
    let mut sums = [0.0; 2];
    for view in &views {
        let [width, height] = [view.image.width, view.image.height].map(|side| side as usize);
        let truth = Picture::new(view.image.rgb.clone(), width, height)?;
        let shown = splat_picture(splats, &view.camera, scene.background);
        let field = render_image(trained.renderer(), &models, &view.camera).rgb;
        for (sum, picture) in sums.iter_mut().zip([shown, field]) {
            *sum += psnr(&Picture::new(picture, width, height)?.rounded(), &truth)? / views.len() as f64;
        }
    }
    let [splats, field] = sums;
    Ok(match views.len() {
        0 => String::new(),
        count => format!(", which show {count} test views with {splats:.2} dB PSNR (the field itself: {field:.2} dB)"),
    })
}

/// How far `surface` is from that of the built-in scene `name`.
fn distance(surface: &Surface, name: &str) -> Result<Option<Chamfer>> {
    let truth = procedural::surface_points(name, TRUTH_SIZE)?;
    Ok(chamfer(&surface.sample(FOUND_POINTS), &truth))
}
