use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, Result};
use infonerf_report::write_atomically;
use infonerf_scene::{
    Format, SceneRequest, SceneSource, TestProtocol, ViewSelection, check, export, from_images, info, info_page, load,
    outline, procedural,
};

use crate::args::{SceneCommand, SceneFormatName};

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
