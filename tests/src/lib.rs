//! What tests across crates share: numbers that follow from a rule, so that fixtures need no weights.

use std::collections::BTreeMap;
use std::path::Path;

use burn::tensor::Device;
use safetensors::{Dtype, tensor::TensorView};

/// Every device that the tests were built for: the CPU's, and with a GPU's feature that GPU or what plays one.
#[allow(deprecated, reason = "the older backend stays selectable, so it stays tested")]
pub fn devices() -> Vec<Device> {
    vec![
        Device::flex(),
        Device::ndarray(),
        #[cfg(feature = "gpu")]
        gpu(),
    ]
}

/// The GPU, as the feature says.
#[cfg(feature = "gpu")]
pub fn gpu() -> Device {
    #[cfg(feature = "cuda")]
    let gpu = Device::cuda(0);
    #[cfg(all(feature = "vulkan", not(feature = "cuda")))]
    let gpu = Device::vulkan(burn::tensor::DeviceKind::DefaultDevice);
    #[cfg(not(any(feature = "vulkan", feature = "cuda")))]
    let gpu = Device::wgpu(burn::tensor::DeviceKind::DefaultDevice);
    gpu
}

/// Number `n` of tensor `l`, in [−1, 1): 24 bits of SplitMix64's finaliser, as `fixtures/pixelnerf.py` has it.
pub fn hashed(l: usize, n: usize) -> f64 {
    let mut z = (((l as u64) << 40) + n as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    (z >> 40) as f64 / (1u64 << 23) as f64 - 1.0
}

/// Colours in [0, 1] of picture `k`, row-major.
pub fn picture(k: usize, pixels: usize) -> Vec<[f32; 3]> {
    (0..pixels).map(|p| [0, 1, 2].map(|c| (0.5 + 0.5 * hashed(1000 + k, 3 * p + c)) as f32)).collect()
}

/// Writes `(name, shape, numbers)` as a safetensors file.
///
/// # Panics
/// If a shape does not fit its numbers, or the file cannot be written.
pub fn write_weights(path: &Path, tensors: impl Iterator<Item = (String, Vec<usize>, Vec<f32>)>) {
    let bytes: Vec<(String, Vec<usize>, Vec<u8>)> = tensors
        .map(|(name, shape, values)| (name, shape, values.iter().flat_map(|value| value.to_le_bytes()).collect()))
        .collect();
    let view = |shape: &[usize], bytes| TensorView::new(Dtype::F32, shape.to_vec(), bytes).expect("shapes fit");
    let views: BTreeMap<&str, TensorView<'_>> =
        bytes.iter().map(|(name, shape, bytes)| (name.as_str(), view(shape, bytes))).collect();
    safetensors::serialize_to_file(views, &None, path).expect("a file to write to");
}
