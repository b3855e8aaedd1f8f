//! Integration tests of infonerf-metrics, in one program.

mod common;
mod folders;
mod reference;
