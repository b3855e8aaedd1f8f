//! Integration tests of infonerf-pretrained, in one program.

mod common;
mod inception;
mod lpips;
mod weights;
