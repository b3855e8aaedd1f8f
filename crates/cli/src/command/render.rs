use std::fs::File;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, buffer::ConvertBuffer};
use infonerf_experiment::{RunPlan, Trained, save_png};
use infonerf_metrics::to_rgb8;
use infonerf_render::render_image;
use infonerf_report::depth_image;
use infonerf_scene::{Camera, orbit, resized_dimensions};

use crate::args::{PathName, RenderArgs};
use crate::terminal::open_device;

/// Milliseconds that a frame of the animation is shown.
const FRAME_MS: u32 = 50;

pub(crate) fn run(args: &RenderArgs) -> Result<ExitCode> {
    let trained = Trained::read(RunPlan::of_run(&args.run)?, &args.run, &open_device(args.device.device)?)?;
    for warning in &trained.warnings {
        eprintln!("warning: {warning}");
    }
    let out = args.out.clone().unwrap_or_else(|| args.run.join("render"));
    clear(&out)?;
    let cameras: Vec<Camera> = trained.scene().train.iter().map(|view| view.camera.clone()).collect();
    let camera = match args.size {
        Some(size) => {
            let (width, height) = resized_dimensions(cameras[0].width, cameras[0].height, size);
            cameras[0].resized(width, height)
        }
        None => cameras[0].clone(),
    };
    let poses = match args.path {
        PathName::Orbit => orbit(&cameras, args.frames as usize),
    };
    let models = trained.models();
    let (near, far) = (trained.scene().near, trained.scene().far);
    let start = std::time::Instant::now();
    let mut frames = Vec::new();
    for (index, pose) in poses.into_iter().enumerate() {
        let image = render_image(trained.renderer(), &models, &camera.with_pose(pose));
        let picture = to_rgb8(&image.rgb, image.width, image.height)?;
        save_png(&picture, &out.join(format!("{index:04}.png")))?;
        let depth = depth_image(&image.depth, &image.acc, image.width, image.height, near, far)?;
        save_png(&depth, &out.join(format!("depth/{index:04}.png")))?;
        frames.push(picture);
    }
    let seconds = start.elapsed().as_secs_f64();
    let animation = out.join("orbit.gif");
    let file = File::create(&animation).with_context(|| animation.display().to_string())?;
    let mut encoder = GifEncoder::new_with_speed(file, 10);
    encoder.set_repeat(Repeat::Infinite)?;
    for picture in &frames {
        let delay = Delay::from_numer_denom_ms(FRAME_MS, 1);
        encoder.encode_frame(Frame::from_parts(picture.convert(), 0, 0, delay))?;
    }
    println!(
        "{} frames of {}x{} in {:.1} s: {}",
        frames.len(),
        camera.width,
        camera.height,
        seconds,
        animation.display()
    );
    Ok(ExitCode::SUCCESS)
}

/// Removes the frames and the animation of an earlier render, which would stand among the new ones; nothing else.
fn clear(out: &Path) -> Result<()> {
    let is_ours = |name: &str| {
        let frame =
            name.strip_suffix(".png").is_some_and(|stem| stem.len() >= 4 && stem.bytes().all(|b| b.is_ascii_digit()));
        frame || name == "orbit.gif"
    };
    for folder in [out.to_owned(), out.join("depth")] {
        let Ok(entries) = std::fs::read_dir(&folder) else { continue };
        for entry in entries.flatten().filter(|entry| is_ours(&entry.file_name().to_string_lossy())) {
            std::fs::remove_file(entry.path()).with_context(|| entry.path().display().to_string())?;
        }
    }
    Ok(())
}
