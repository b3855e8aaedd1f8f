//! `infonerf sweep`.
mod args;
pub(crate) use args::{SWEEP_EXAMPLES, SweepArgs, SweepItemArgs};
pub(crate) fn run(_: &SweepArgs) -> anyhow::Result<std::process::ExitCode> {
    anyhow::bail!("not yet")
}
pub(crate) fn run_item(_: &SweepItemArgs) -> anyhow::Result<std::process::ExitCode> {
    anyhow::bail!("not yet")
}
