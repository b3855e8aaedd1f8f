//! Integration tests of infonerf-train, in one program.

mod cameras;
mod common;
mod exact_pictures;
mod exposure;
mod faults;
mod fuzz;
mod pretrain;
mod repeatability;
mod residuals;
