//! Integration tests of infonerf-report, in one program.

mod browser;
mod charts;
mod report;
mod schema;
mod tensorboard;
