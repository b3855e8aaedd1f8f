use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::DeviceName;

/// The program that runs items, and how.
#[derive(Clone, Debug)]
pub struct Runner {
    /// The program of which `PROGRAM sweep-item MANIFEST ITEM` runs an item.
    pub program: PathBuf,
    /// Where to compute.
    pub device: DeviceName,
    /// A file or folder of weights of learned metrics, beside the places where they are looked for.
    pub weights: Option<PathBuf>,
    /// Time after which a run is given up.
    pub timeout: Option<Duration>,
}

impl Runner {
    /// The command that runs the item whose number is put at its end.
    pub(super) fn command(&self, manifest: &Path) -> Vec<OsString> {
        let mut command: Vec<OsString> =
            vec![self.program.clone().into(), "sweep-item".into(), "--device".into(), self.device.name().into()];
        if let Some(weights) = &self.weights {
            command.extend(["--weights".into(), weights.into()]);
        }
        if let Some(timeout) = self.timeout {
            command.extend(["--timeout".into(), format!("{}s", timeout.as_secs_f64()).into()]);
        }
        command.push(manifest.into());
        command
    }
}
