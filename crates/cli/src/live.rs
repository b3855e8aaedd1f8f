use std::cell::Cell;
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use infonerf_experiment::{Control, OpenDevice};
use infonerf_view::{Server, TrainingControl};

use crate::interrupt;
use crate::print::{outln, quoted};
use crate::terminal::is_terminal;

/// Minimum time between two checkpoints that are saved for an open page.
const REFRESH: Duration = Duration::from_secs(3);
/// Time after its last request during which a page counts as open.
const OPEN: Duration = Duration::from_secs(6);
/// Time between two checks of whether a pause has ended.
const PAUSE: Duration = Duration::from_millis(50);

/// A server of the runs that train in this process.
pub(crate) struct Live {
    server: Server,
    control: TrainingControl,
    saved: Cell<Instant>,
}

impl Live {
    /// Serves the runs below `folder`, which is created if necessary, on `port` of this machine alone.
    pub(crate) fn start(folder: &Path, port: u16, device: OpenDevice) -> Result<Self> {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        let control = TrainingControl::default();
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, port));
        let server = Server::start(&[folder.to_owned()], address, device, Some(control.clone())).context("--view")?;
        Ok(Self { server, control, saved: Cell::new(Instant::now()) })
    }

    pub(crate) fn url(&self) -> String {
        self.server.url()
    }

    /// Keeps serving the finished runs in `folder` until Ctrl-C if standard output is a terminal, and prints how to view them
    /// again. Does nothing of this unless output is `as_text`.
    pub(crate) fn serve_after_training(&self, folder: &Path, as_text: bool) {
        self.control.end();
        if !as_text {
            return;
        }
        if is_terminal() {
            outln!("{} still shows the runs (Ctrl-C ends)", self.url());
            interrupt::wait();
        }
        outln!("to look at the runs again: infonerf view {}", quoted(folder));
    }

    /// Returns the command of the page or of Ctrl-C; waits while training is paused.
    pub(crate) fn control(&self) -> Control {
        while self.control.is_paused() && !self.control.is_stopped() && !interrupt::stop_requested() {
            std::thread::sleep(PAUSE);
        }
        if self.control.is_stopped() || interrupt::stop_requested() {
            return Control::Stop;
        }
        if self.saved.get().elapsed() < REFRESH || !self.control.is_watched(OPEN) {
            return Control::Continue;
        }
        self.saved.set(Instant::now());
        Control::Save
    }
}
