//! Tests across crates, in one program.

mod clip;
mod density_gradient;
mod documents;
mod gpu_check;
mod mip_forward;
mod nerf_forward;
mod neural_body;
mod neural_volumes;
mod parity;
mod pixelnerf;
