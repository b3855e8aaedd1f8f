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

use burn::tensor::Device;
use infonerf_field::{FieldSetup, Sources};

/// Returns the setup of a field in the cube from −1 to 1.
fn setup(device: &Device) -> FieldSetup<'_> {
    FieldSetup { bounds: [[-1.0; 3], [1.0; 3]], seed: 0, device, body: None }
}

/// Returns the images of a field that is conditioned on none.
fn no_sources() -> Sources {
    Sources { views: [].into(), middle: [0.0; 3] }
}
