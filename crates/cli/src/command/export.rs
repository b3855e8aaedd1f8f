use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, anyhow, ensure};
use clap::{Args, ValueEnum};
use indicatif::DecimalBytes;
use infonerf_dataset::SceneSource;
use infonerf_experiment::{RunPlan, Trained};
use infonerf_export::{Mesh, Surface, glb, ply_mesh, ply_points, ply_splats};
use infonerf_report::{VIEWER_PAGE, counted, write_atomically};

use crate::print::outln;
use crate::progress::with_spinner;
use crate::selection::DeviceArgs;
use crate::terminal::{open_device, read_run};
use crate::units::check_extension;

const EXPORT_EXAMPLES: &str = "\
Examples:
  infonerf export runs/synthetic-4view/castle/infonerf+/seed0 --format glb
      a mesh with vertex colours: runs/.../seed0/export/mesh.glb
  infonerf export runs/synthetic-4view/castle/infonerf+/seed0 --format splat --resolution 384 --out castle.ply
      gaussians on the surface, for viewers of 3D Gaussian Splatting
  infonerf export runs/synthetic-4view/castle/infonerf+/seed0 --format html
      one page that draws the scene in any browser with WebGL2; needs nothing else";

/// Export a run: a mesh, points, gaussian splats, its cameras or a web page.
#[derive(Debug, Args)]
#[command(after_help = EXPORT_EXAMPLES)]
pub(crate) struct ExportArgs {
    /// Folder of a run, such as runs/synthetic-4view/castle/infonerf+/seed0.
    run: PathBuf,
    /// Format of the file.
    #[arg(long, value_enum)]
    format: FormatName,
    /// Voxels along the longest side of the scene's box, 2 to 512; by default 256, for splats 128. A page uses fewer if
    /// the field is slow to evaluate or fills much of the box.
    #[arg(long, value_parser = clap::value_parser!(u32).range(2..=512))]
    resolution: Option<u32>,
    /// Collapse edges until a mesh has at most this many triangles.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..))]
    triangles: Option<u32>,
    /// File to write; by default one in RUN/export, a page RUN/viewer.html.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    device: DeviceArgs,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FormatName {
    /// Mesh with normals and vertex colours, read by MeshLab, Blender, CloudCompare, Open3D, trimesh.
    Ply,
    /// Mesh as binary glTF, read by browsers (three.js), Blender, game engines, trimesh.
    Glb,
    /// Gaussians on the surface, fitted to the field's renders, spherical harmonics of degree 1, read by SuperSplat, Brush and other viewers of 3DGS.
    Splat,
    /// Points on the surface with normals and colours, read by MeshLab, CloudCompare, Open3D, plyfile.
    Points,
    /// Training and test cameras as transforms.json, read by nerfstudio, instant-ngp, Brush next to the image files.
    Cameras,
    /// A page that draws the field: orbit, depth, normals, training cameras; read by browsers with WebGL2. A factored field
    /// is drawn as it is, any other is baked to voxels.
    Html,
}

/// Default number of voxels along the longest side of the scene's box.
const RESOLUTION: usize = 256;
/// Default number of voxels for splats: with more, splats do not fit better in their number of steps.
const SPLAT_RESOLUTION: usize = 128;

pub(crate) fn run(args: &ExportArgs) -> Result<ExitCode> {
    let is_mesh = matches!(args.format, FormatName::Ply | FormatName::Glb);
    ensure!(is_mesh || args.triangles.is_none(), "--triangles: expected a mesh (ply or glb)");
    let has_voxels = args.format != FormatName::Cameras;
    ensure!(has_voxels || args.resolution.is_none(), "--resolution: expected another format than cameras");
    let plan = RunPlan::of_run(&args.run)?;
    let out = args.out.clone().unwrap_or_else(|| args.run.join(args.format.file()));
    ensure!(!out.is_dir(), "{}: expected a file to write, found a folder", out.display());
    check_extension(&out, args.format.file().rsplit('.').next().unwrap_or_default())?;
    // An impossible path is reported before the work begins.
    let above = out.ancestors().skip(1).find(|part| part.exists());
    ensure!(above.is_none_or(Path::is_dir), "{}: expected a file to write in a folder", out.display());
    let read = || read_run(plan.clone(), &args.run, &open_device(args.device.device)?);
    let ((bytes, summary), surface) = match args.format {
        FormatName::Cameras => (cameras(&plan)?, None),
        FormatName::Html => (page(&read()?, args)?, None),
        _ => {
            let trained = read()?;
            let measuring = format!("{}: measuring the surface", args.run.display());
            let (exported, surface) = with_spinner(measuring, || from_surface(&trained, args))?;
            (exported, trained.surface_error(&surface)?.zip(Some(surface.voxel)))
        }
    };
    write_atomically(&out, &bytes)?;
    outln!("{}: {summary}, {}", out.display(), DecimalBytes(bytes.len() as u64));
    if let Some((error, voxel)) = surface {
        let (mean, accuracy, completeness) = (error.mean(), error.accuracy, error.completeness);
        outln!(
            "chamfer distance to the exact surface that the training cameras see: {mean:.4} (accuracy {accuracy:.4}, \
             completeness {completeness:.4}); a voxel is {voxel:.4}"
        );
    }
    let note = plan.export_note(&args.run, args.format == FormatName::Html);
    if let Some(note) = note.filter(|_| has_voxels) {
        outln!("exported: {note}");
    }
    if let Some(help) = args.format.to_possible_value().and_then(|value| value.get_help().map(ToString::to_string)) {
        outln!("{help}");
    }
    Ok(ExitCode::SUCCESS)
}

impl FormatName {
    fn file(self) -> &'static str {
        match self {
            Self::Ply => "export/mesh.ply",
            Self::Glb => "export/mesh.glb",
            Self::Splat => "export/splat.ply",
            Self::Points => "export/points.ply",
            Self::Cameras => "export/transforms.json",
            Self::Html => VIEWER_PAGE,
        }
    }
}

/// Bytes of a file, and a description of its contents.
type Exported = (Vec<u8>, String);

fn cameras(plan: &RunPlan) -> Result<Exported> {
    let cameras = plan.cameras()?;
    let count = |key: &str| cameras[key].as_array().map_or(0, Vec::len);
    let place = match &plan.source {
        SceneSource::Folder { path } => format!("; its image paths start in {}", path.display()),
        SceneSource::Procedural(_) => String::new(),
    };
    let summary = format!("{} training and {} test cameras{place}", count("train_filenames"), count("test_filenames"));
    Ok((format!("{cameras:#}\n").into_bytes(), summary))
}

fn page(trained: &Trained, args: &ExportArgs) -> Result<Exported> {
    let voxels = args.resolution.map(|voxels| voxels as usize);
    let page = infonerf_view::page(trained, &args.run, voxels).with_context(|| args.run.display().to_string())?;
    Ok((page.into_bytes(), "a page that draws the scene".to_owned()))
}

fn from_surface(trained: &Trained, args: &ExportArgs) -> Result<(Exported, Surface)> {
    let usual = if args.format == FormatName::Splat { SPLAT_RESOLUTION } else { RESOLUTION };
    let surface = trained.surface(args.resolution.map_or(usual, |voxels| voxels as usize));
    let run = args.run.display();
    let mut surface =
        surface.map_err(|fault| anyhow!("{run}: {fault}, or take --format html, which needs no surface"))?;
    if args.format == FormatName::Splat {
        let splats = trained.splats(&surface);
        let fidelity = trained.splat_fidelity(&splats)?.map_or(String::new(), |found| {
            let (views, splats, fields) = (counted(found.views, "test view"), found.splats, found.fields);
            format!(", which show {views} with {splats:.2} dB PSNR (the field itself: {fields:.2} dB)")
        });
        let bytes = ply_splats(&splats, trained.scene().origin);
        return Ok(((bytes, format!("{} gaussians{fidelity}", splats.len())), surface));
    }
    if let Some(triangles) = args.triangles {
        surface = surface.simplified(triangles as usize);
    }
    let mesh = Mesh::new(surface, trained);
    let scene = trained.scene();
    let bytes = match args.format {
        FormatName::Points => ply_points(&mesh, scene.origin),
        FormatName::Glb => glb(&mesh, scene.space.up, scene.origin)?,
        _ => ply_mesh(&mesh, scene.origin),
    };
    let Surface { positions, triangles, dropped, .. } = &mesh.surface;
    let (vertices, triangles) = (positions.len(), triangles.len());
    let summary = match args.format {
        FormatName::Points => format!("{vertices} points"),
        _ => format!("{vertices} vertices, {triangles} triangles ({dropped} small components left out)"),
    };
    Ok(((bytes, summary), mesh.surface))
}
