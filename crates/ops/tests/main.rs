//! Integration tests of infonerf-ops, in one program.
#![allow(deprecated, reason = "the older CPU backend is tested for as long as it is selectable")]

mod agreement;
mod common;
mod encodings;
mod factored;
mod mlp;
