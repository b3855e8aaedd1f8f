//! Integration tests of infonerf-view, in one program.

mod browser;
mod common;
mod server;
