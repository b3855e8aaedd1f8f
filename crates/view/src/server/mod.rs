//! The live viewer: a small server whose page shows runs, also while they train.

mod answer;
mod connection;
mod control;
mod fields;
mod guard;
mod routes;
mod runs;

use std::net::{SocketAddr, TcpListener};
use std::path::PathBuf;
use std::thread::{self, JoinHandle};

use anyhow::{Context, Result, anyhow};
use infonerf_experiment::OpenDevice;

use answer::Answers;
pub use control::TrainingControl;
use guard::Guard;
use runs::Roots;

/// Serves a page that lists the runs below some folders and shows each: its field, curves, and test views beside their truth; or
/// two of them side by side.
///
/// It writes nothing and reads only files of these runs. Other pages that are open in the browser are kept out: requests must
/// name this server as their host and, if they say where they come from, as their origin; no page can frame it; and what
/// changes something (POST, beside training) must carry a random token that the page holds.
pub struct Server {
    address: SocketAddr,
    listening: JoinHandle<()>,
}

impl Server {
    /// Serves `roots`, each a run or a folder that holds runs, on `address`. Port 0 is any that is free. With `control`, the
    /// page can pause and stop the training in this process.
    ///
    /// # Errors
    /// If there is no such folder, the address cannot be listened on, or the system has no random numbers.
    pub fn start(
        roots: &[PathBuf],
        address: SocketAddr,
        device: OpenDevice,
        control: Option<TrainingControl>,
    ) -> Result<Self> {
        let roots = Roots::new(roots)?;
        let listener = TcpListener::bind(address).with_context(|| format!("{address}: cannot be listened on"))?;
        let address = listener.local_addr()?;
        let answers = Answers::new(roots, device, Guard::new(address)?, control);
        let listening = thread::spawn(move || connection::serve(&listener, move |request| answers.to(request)));
        Ok(Self { address, listening })
    }

    /// The address of the page.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// Serves until the program ends.
    ///
    /// # Errors
    /// If the listening thread panicked.
    pub fn wait(self) -> Result<()> {
        self.listening.join().map_err(|_| anyhow!("the server's thread panicked"))
    }
}
