use std::net::{IpAddr, Ipv4Addr, SocketAddr, ToSocketAddrs};
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Result;
use clap::Args;
use infonerf_view::Server;

use crate::print::{errln, outln};
use crate::selection::DeviceArgs;
use crate::terminal::open_device;

const VIEW_EXAMPLES: &str = "\
Examples:
  infonerf view runs
      all runs below a folder, at http://127.0.0.1:7007/; those that train are followed
  infonerf view runs/synthetic-4view/castle/infonerf+/seed0 --open
      one run, in the browser
  infonerf view runs/synthetic-4view/castle/nerf/seed0 runs/synthetic-4view/castle/infonerf/seed0
      two runs, which the page shows side by side under one camera (\"Compare with\")
  ssh -L 7007:127.0.0.1:7007 HOST infonerf view runs
      runs of another machine, at the same address on this one (the port must be the same)";

/// Show runs in a browser on this machine, also while they train: scene, curves, test views next to their truth.
#[derive(Debug, Args)]
#[command(after_help = VIEW_EXAMPLES)]
pub(crate) struct ViewArgs {
    /// Folders of runs, or folders that hold runs. The page compares any two of them.
    #[arg(value_name = "RUNS", required = true)]
    runs: Vec<PathBuf>,
    /// Port to listen on; 0 for any that is free.
    #[arg(long, default_value_t = 7007)]
    port: u16,
    /// Address of this machine to listen on, or a name of it. With one that other machines reach, whoever reaches it can look
    /// at the runs.
    #[arg(long, value_name = "ADDRESS", value_parser = parse_host, default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    host: IpAddr,
    /// Open the page in the browser.
    #[arg(long)]
    open: bool,
    #[command(flatten)]
    device: DeviceArgs,
}

/// Returns the address that `text` is or, as a name, stands for: one of IPv4 if there is one.
fn parse_host(text: &str) -> Result<IpAddr, String> {
    let found =
        (text, 0).to_socket_addrs().into_iter().flatten().map(|address| address.ip()).min_by_key(IpAddr::is_ipv6);
    found.ok_or_else(|| "expected an address or a name of this machine, such as 0.0.0.0, ::1 or localhost".to_owned())
}

pub(crate) fn run(args: &ViewArgs) -> Result<ExitCode> {
    let device = open_device(args.device.device)?;
    let server = Server::start(&args.runs, SocketAddr::new(args.host, args.port), device, None)?;
    let shown: Vec<String> = args.runs.iter().map(|run| run.display().to_string()).collect();
    outln!("{} shows {} (Ctrl-C ends)", server.url(), shown.join(", "));
    if !server.has_runs {
        outln!("no run is there yet: the page waits for one");
    }
    if args.open
        && let Err(error) = open::that(server.url())
    {
        errln!("warning: --open: no browser could be started: {error}");
    }
    server.wait()?;
    Ok(ExitCode::SUCCESS)
}
