//! Benchmarks: speed, quality against speed, exactness under stress, and agreement of devices.
//!
//! Each benchmark is one file with one function that measures, prints the results, and writes `results.json`, and in most
//! cases a table as CSV, to the folder of its [`Bench`]. An error is a failed run or write. Benchmarks with bounds return whether all hold.

mod agreement;
mod context;
mod output;
mod pareto;
mod render;
mod skip;
mod step;
mod stress;
mod stress_training;
mod trial;
mod values;

pub use agreement::run as agreement;
pub use context::Bench;
pub use pareto::run as pareto;
pub use render::run as render;
pub use skip::run as skip;
pub use step::run as step;
pub use stress::run as stress;
pub use stress_training::run as stress_training;
