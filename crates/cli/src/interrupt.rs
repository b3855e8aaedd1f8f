//! Ctrl-C: finishes the current step or picture, saves, and stops.

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use infonerf_experiment::Control;
use infonerf_experiment::execute::STOPPED;

use crate::print::errln;

static WAS_SIGNALLED: AtomicBool = AtomicBool::new(false);
static STOP_REQUESTED: AtomicBool = AtomicBool::new(false);
/// Whether no step or picture is in progress that would have to finish.
static IDLE: AtomicBool = AtomicBool::new(false);

/// Installs the handler. A second Ctrl-C ends the process at once.
pub(crate) fn install() -> anyhow::Result<()> {
    ctrlc::set_handler(|| {
        if WAS_SIGNALLED.swap(true, Ordering::SeqCst) {
            std::process::exit(STOPPED);
        }
        request_stop();
        if !IDLE.load(Ordering::SeqCst) {
            errln!("\nstopping after this step; press Ctrl-C again to stop at once");
        }
    })?;
    Ok(())
}

/// Stops after the current step or picture, as a first Ctrl-C does.
pub(crate) fn request_stop() {
    STOP_REQUESTED.store(true, Ordering::SeqCst);
}

pub(crate) fn stop_requested() -> bool {
    STOP_REQUESTED.load(Ordering::SeqCst)
}

/// Returns the user's command to a run: to stop after Ctrl-C, else to continue.
pub(crate) fn control() -> Control {
    if stop_requested() { Control::Stop } else { Control::Continue }
}

pub(crate) fn exit_code() -> ExitCode {
    ExitCode::from(STOPPED as u8)
}

/// Waits for Ctrl-C, with nothing running.
pub(crate) fn wait() {
    IDLE.store(true, Ordering::SeqCst);
    while !stop_requested() {
        std::thread::sleep(Duration::from_millis(50));
    }
}
