//! Integration tests of infonerf-metrics, in one program.

mod common;
mod distribution;
mod folders;
mod reference;
