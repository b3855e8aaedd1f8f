//! Tests across crates, in one program.

mod clip;
mod density_gradient;
mod documents;
mod forward;
mod gpu_check;
mod neural_body;
mod neural_volumes;
mod parity;
mod pixelnerf;
