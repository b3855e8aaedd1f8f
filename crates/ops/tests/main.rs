//! Integration tests of infonerf-ops, in one program.

mod agreement;
mod common;
mod encodings;
mod factored;
mod mlp;
