//! Networks that others trained: reading their published weights, and the image encoder of CLIP, which judges renders.
//!
//! Nothing here is trained, and no weights are part of this program.

mod clip;
mod file;

pub use clip::{ClipConfig, ClipVision};
pub use file::WeightFile;
