use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, Result, bail};
use infonerf_experiment::{RunPlan, Trained};
use infonerf_export::{
    Chamfer, Gaussian, Grid, Mesh, Surface, Volume, chamfer, gaussians, glb, npz, obj, ply_mesh, ply_points,
    ply_splats, splat_picture,
};
use infonerf_metrics::{Picture, psnr};
use infonerf_report::write_atomically;
use infonerf_scene::{Scene, SceneSource, procedural, transforms};

use crate::args::{ExportArgs, FormatName};
use crate::terminal::open_device;

/// Points on the exported surface, and pixels along a side of the cameras that find points of the exact one: enough for
/// distances of a fraction of a voxel.
const FOUND_POINTS: usize = 400_000;
const TRUTH_SIZE: u32 = 96;
/// Test views on which splats are measured at most.
const TEST_VIEWS: usize = 8;

pub(crate) fn run(args: &ExportArgs) -> Result<ExitCode> {
    let plan = RunPlan::of_run(&args.run)?;
    let out = args.out.clone().unwrap_or_else(|| args.run.join("export").join(default_name(args.format)));
    prepare(&out)?;
    let source = plan.source.clone();
    let Exported { bytes, summary, surface } = match args.format {
        FormatName::Cameras => cameras(&plan)?,
        format => {
            let trained = Trained::read(plan, &args.run, &open_device(args.device.device)?)?;
            for warning in &trained.warnings {
                eprintln!("warning: {warning}");
            }
            let volume = trained.volume();
            let grid = Grid::sample(&volume, args.resolution as usize)?;
            write(format, &grid, &volume, trained.scene())?
        }
    };
    write_atomically(&out, &bytes)?;
    println!("{}: {summary}, {:.1} MB", out.display(), bytes.len() as f64 / 1e6);
    if let (Some(surface), SceneSource::Procedural(name)) = (surface, &source)
        && let Some(Chamfer { accuracy, completeness }) = distance(&surface, name)?
    {
        println!(
            "chamfer distance to the exact surface that the training cameras see: {:.4} (accuracy {accuracy:.4}, \
             completeness {completeness:.4}); a voxel is {:.4}",
            Chamfer { accuracy, completeness }.mean(),
            surface.voxel
        );
    }
    println!("read by: {}", readers(args.format));
    Ok(ExitCode::SUCCESS)
}

/// A file before it is written.
struct Exported {
    bytes: Vec<u8>,
    /// What is in it.
    summary: String,
    /// The surface that it was made from, if it was.
    surface: Option<Surface>,
}

/// What an export is called in a run's folder.
fn default_name(format: FormatName) -> &'static str {
    match format {
        FormatName::Ply => "mesh.ply",
        FormatName::Obj => "mesh.obj",
        FormatName::Glb => "mesh.glb",
        FormatName::Splat => "splat.ply",
        FormatName::Points => "points.ply",
        FormatName::Npz => "grid.npz",
        FormatName::Cameras => "transforms.json",
    }
}

fn readers(format: FormatName) -> &'static str {
    match format {
        FormatName::Ply => "MeshLab, Blender, CloudCompare, Open3D, trimesh",
        FormatName::Obj => "MeshLab, Blender, trimesh",
        FormatName::Glb => "browsers (three.js, model-viewer), Blender, Windows 3D Viewer, trimesh",
        FormatName::Splat => "SuperSplat, Brush, the viewers of 3D Gaussian Splatting",
        FormatName::Points => "MeshLab, CloudCompare, Open3D, plyfile",
        FormatName::Npz => "numpy.load",
        FormatName::Cameras => "nerfstudio, instant-ngp, Brush, beside the images that it names",
    }
}

/// Makes the folder of the file: what cannot be written is found out before the work.
fn prepare(out: &Path) -> Result<()> {
    if out.is_dir() {
        bail!("{}: expected a file to write, found a folder", out.display());
    }
    let folder =
        out.parent().filter(|folder| !folder.as_os_str().is_empty()).map_or(PathBuf::from("."), Path::to_owned);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())
}

fn cameras(plan: &RunPlan) -> Result<Exported> {
    let scene = plan.load()?;
    let summary = format!("{} training and {} test cameras", scene.train.len(), scene.test.len());
    let bytes = format!("{:#}\n", transforms(&scene)).into_bytes();
    Ok(Exported { bytes, summary, surface: None })
}

/// What `grid`, sampled from `volume`, is in a format.
fn write(format: FormatName, grid: &Grid, volume: &dyn Volume, scene: &Scene) -> Result<Exported> {
    if format == FormatName::Npz {
        let [x, y, z] = grid.size.to_array();
        let summary = format!("density and colour of {x}x{y}x{z} voxels");
        return Ok(Exported { bytes: npz(grid, volume)?, summary, surface: None });
    }
    let surface = Surface::extract(grid)?;
    if format == FormatName::Splat {
        let splats = gaussians(&surface, volume);
        let summary = format!("{} gaussians of degree 1{}", splats.len(), fidelity(&splats, scene)?);
        return Ok(Exported { bytes: ply_splats(&splats), summary, surface: Some(surface) });
    }
    let mesh = Mesh::new(surface, volume);
    let bytes = match format {
        FormatName::Obj => obj(&mesh).into_bytes(),
        FormatName::Glb => glb(&mesh, scene.up)?,
        FormatName::Points => ply_points(&mesh),
        _ => ply_mesh(&mesh),
    };
    let surface = mesh.surface;
    let summary = match format {
        FormatName::Points => format!("{} points", surface.positions.len()),
        _ => format!("{} vertices, {} triangles", surface.positions.len(), surface.triangles.len()),
    };
    let left_out = match surface.dropped {
        0 => String::new(),
        dropped => format!(" ({dropped} small components left out)"),
    };
    Ok(Exported { bytes, summary: summary + &left_out, surface: Some(surface) })
}

/// The mean PSNR of pictures of `splats` on test views of `scene`, as a part of a sentence; nothing without test views or
/// behind a lens, which splats are not rendered through.
fn fidelity(splats: &[Gaussian], scene: &Scene) -> Result<String> {
    let views: Vec<_> = scene.test.iter().filter(|view| view.camera.lens.is_perspective()).take(TEST_VIEWS).collect();
    let mut sum = 0.0;
    for view in &views {
        let [width, height] = [view.image.width, view.image.height].map(|side| side as usize);
        let shown = splat_picture(splats, &view.camera, scene.background);
        let truth = Picture::new(view.image.rgb.clone(), width, height)?;
        sum += psnr(&Picture::new(shown, width, height)?.rounded(), &truth)?;
    }
    Ok(match views.len() {
        0 => String::new(),
        count => format!(", {:.2} dB PSNR on {count} test views as splats", sum / count as f64),
    })
}

/// How far `surface` is from that of the built-in scene `name`.
fn distance(surface: &Surface, name: &str) -> Result<Option<Chamfer>> {
    let truth = procedural::surface_points(name, TRUTH_SIZE)?;
    Ok(chamfer(&surface.sample(FOUND_POINTS), &truth))
}
