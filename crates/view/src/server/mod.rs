//! Live viewer: a small server whose page shows runs, also while they train.

mod answer;
mod connection;
mod control;
mod fields;
mod guard;
mod runs;

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener, UdpSocket};
use std::path::PathBuf;
use std::thread::{self, JoinHandle};

use anyhow::{Context, Result, anyhow};
use infonerf_experiment::OpenDevice;
use serde_json::json;

use answer::Answers;
pub use control::TrainingControl;
use fields::Fields;
use guard::Guard;
use runs::Roots;

/// Server of a page that lists the runs below some folders and shows each: its field, curves, and test views next to
/// their truth; or two of them under one camera.
///
/// The server reads only files of these runs, and keeps the package of a finished one next to its checkpoint. Other pages that
/// are open in the browser are kept out: requests must name this server as their host and, if they have an origin, as
/// their origin; no page can frame it; and commands (POST, where a training runs in this process) must carry its random token.
pub struct Server {
    /// Whether there was a run at the start.
    pub has_runs: bool,
    address: SocketAddr,
    listening: JoinHandle<()>,
}

impl Server {
    /// Serves `roots`, each a run or a folder that holds runs, on `address`. Port 0 is any that is free. With
    /// `control`, the page can pause and stop the training in this process.
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
        let has_runs = roots.list() != json!([]);
        let answers = Answers { roots, fields: Fields::new(device), guard: Guard::new(address)?, control };
        let listening = thread::spawn(move || connection::serve(&listener, move |request| answers.to(request)));
        Ok(Self { has_runs, address, listening })
    }

    /// Returns an address of the page for a browser: where other machines reach it if the server listens on every address.
    pub fn url(&self) -> String {
        let ip = if self.address.ip().is_unspecified() { own_ip(self.address.ip()) } else { self.address.ip() };
        format!("http://{}/", SocketAddr::new(ip, self.address.port()))
    }

    /// Serves until the program ends.
    pub fn wait(self) -> Result<()> {
        self.listening.join().map_err(|_| anyhow!("the server's thread panicked"))
    }
}

/// Returns this machine's address for other machines, of the kind (IPv4 or IPv6) of `unspecified`; loopback without a network.
fn own_ip(unspecified: IpAddr) -> IpAddr {
    // Connecting a datagram socket sends nothing, but chooses the interface. Both targets are reserved (RFC 5737, 3849).
    let (loopback, target): (IpAddr, IpAddr) = match unspecified {
        IpAddr::V4(_) => (Ipv4Addr::LOCALHOST.into(), Ipv4Addr::new(192, 0, 2, 1).into()),
        IpAddr::V6(_) => (Ipv6Addr::LOCALHOST.into(), Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1).into()),
    };
    let socket = UdpSocket::bind(SocketAddr::new(unspecified, 0));
    let own = socket.and_then(|socket| socket.connect((target, 9)).and_then(|()| socket.local_addr()));
    own.map_or(loopback, |own| own.ip())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn url_can_be_opened_whatever_the_server_listens_on() {
        let folder = tempfile::tempdir().unwrap();
        let device = infonerf_experiment::open(infonerf_experiment::DeviceName::Flex).unwrap();
        let server = Server::start(&[folder.path().to_owned()], "0.0.0.0:0".parse().unwrap(), device, None).unwrap();
        assert!(!server.has_runs);
        let url = server.url();
        let address: SocketAddr = url.trim_start_matches("http://").trim_end_matches('/').parse().unwrap();
        assert!(!address.ip().is_unspecified(), "{url}");
        std::net::TcpStream::connect(address).unwrap();
    }
}
