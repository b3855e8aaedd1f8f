use std::fs::File;
use std::process::ExitCode;

use anyhow::{Context, Result};
use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, Frame, buffer::ConvertBuffer};
use infonerf_metrics::to_rgb8;
use infonerf_render::render_image;
use infonerf_report::depth_image;
use infonerf_scene::{Camera, orbit, resized_dimensions};

use crate::args::{PathName, RenderArgs};
use crate::command::eval::trained;
use crate::experiment::RunPlan;
use crate::run::{learned, save_png};

/// Milliseconds that a frame of the animation is shown.
const FRAME_MS: u32 = 50;

pub(crate) fn run(args: &RenderArgs) -> Result<ExitCode> {
    let plan = RunPlan::of_run(&args.run)?;
    let trainers = trained(&plan, &args.run, args.device)?;
    let trainer = &trainers[0];
    let out = args.out.clone().unwrap_or_else(|| args.run.join("render"));
    let cameras: Vec<Camera> = trainer.scene().train.iter().map(|view| view.camera.clone()).collect();
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
    let members = learned(&trainers);
    let (near, far) = (trainer.scene().near, trainer.scene().far);
    let start = std::time::Instant::now();
    let mut frames = Vec::new();
    for (index, pose) in poses.into_iter().enumerate() {
        let image = render_image(trainer.renderer(), &members, &camera.with_pose(pose));
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
