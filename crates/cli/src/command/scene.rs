use std::process::ExitCode;

use anyhow::Result;
use infonerf_scene::{export, procedural};

use crate::args::SceneCommand;

pub(crate) fn run(command: &SceneCommand) -> Result<ExitCode> {
    match command {
        SceneCommand::List => {
            for name in procedural::NAMES {
                println!("{name}");
            }
        }
        SceneCommand::Export { name, dir, size } => {
            export(name, *size, dir)?;
            println!("{name}: 100 training and 200 test views of {size}x{size} in {}", dir.display());
        }
    }
    Ok(ExitCode::SUCCESS)
}
