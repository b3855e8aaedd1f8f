//! The live viewer: a small server whose page shows runs, also while they train.

mod answer;
mod control;
mod fields;
mod routes;
mod runs;

use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use infonerf_experiment::OpenDevice;
use oxhttp::ListeningServer;
use oxhttp::model::{Body, Request};

use answer::Answers;
pub use control::TrainingControl;

/// Connections that are open at a time, each with a thread of its own; others wait.
const MOST_CONNECTIONS: usize = 256;
/// How long a connection may keep silent.
const PATIENCE: Duration = Duration::from_secs(5);

/// Serves a page that lists the runs below a folder and shows each: its field, curves, and test views beside their truth.
///
/// Nothing is written, and only files of runs below the folder are read; a header may have 8 kB. Only GET is answered, and beside
/// training POST of what its page wants, which pages of other sites cannot send (it needs a header of its own). While
/// the server listens on a loopback address alone, requests that name another host are refused, so that no page of another
/// site can read along under a name of its own (DNS rebinding).
pub struct Server {
    address: SocketAddr,
    listening: ListeningServer,
}

impl Server {
    /// Serves the run, or the runs below the folder, `root` on `address`. Port 0 is any that is free. With `control`, the page
    /// can pause and stop the training that heeds it.
    ///
    /// # Errors
    /// If there is no such folder, or the address cannot be listened on.
    pub fn start(
        root: &Path,
        address: SocketAddr,
        device: OpenDevice,
        control: Option<TrainingControl>,
    ) -> Result<Self> {
        let folder = root.canonicalize().with_context(|| root.display().to_string())?;
        if !folder.is_dir() {
            bail!("{}: expected the folder of a run, or one that holds runs", root.display());
        }
        let address = free(address).with_context(|| format!("{address}: cannot be listened on"))?;
        let answers = Arc::new(Answers::new(folder, device, address.ip().is_loopback(), control));
        let listening = oxhttp::Server::new(move |request: &mut Request<Body>| answers.to(request))
            .bind(address)
            .with_global_timeout(PATIENCE)
            .with_max_concurrent_connections(MOST_CONNECTIONS)
            .spawn()
            .with_context(|| format!("{address}: cannot be listened on"))?;
        Ok(Self { address, listening })
    }

    /// Where the page is.
    pub fn url(&self) -> String {
        format!("http://{}/", self.address)
    }

    /// Serves until the program ends.
    ///
    /// # Errors
    /// If a listening thread panicked.
    pub fn wait(self) -> Result<()> {
        Ok(self.listening.join()?)
    }
}

/// The address with the port that it stands for, if nothing listens on it.
fn free(address: SocketAddr) -> std::io::Result<SocketAddr> {
    TcpListener::bind(address)?.local_addr()
}
