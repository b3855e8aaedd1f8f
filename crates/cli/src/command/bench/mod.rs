//! `infonerf bench`.
mod args;
pub(crate) use args::{BENCH_EXAMPLES, BenchArgs, BenchName};
pub(crate) fn run(_: &BenchArgs) -> anyhow::Result<std::process::ExitCode> {
    anyhow::bail!("not yet")
}
