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
use infonerf_field::{FieldSetup, SourceView, Sources};
use infonerf_tests::picture;

/// Returns the setup of a field in the cube from −1 to 1.
fn setup(device: &Device) -> FieldSetup<'_> {
    FieldSetup { bounds: [[-1.0; 3], [1.0; 3]], seed: 0, device, body: None }
}

/// Returns no images, for a field that is conditioned on none.
fn no_sources() -> Sources {
    Sources { views: [].into(), middle: [0.0; 3] }
}

/// Returns test image `k` as the view of a camera whose principal point is the image's centre.
fn source_view(k: usize, [width, height]: [usize; 2], focal: f32, to_camera: [[f32; 4]; 3]) -> SourceView {
    let (rgb, centre) = (picture(k, width * height).into(), [width as f32 / 2.0, height as f32 / 2.0]);
    SourceView { width, height, rgb, focal: [focal; 2], centre, to_camera }
}
