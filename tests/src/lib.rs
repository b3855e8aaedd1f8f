//! Helpers of the tests across crates: parameters that follow from a rule, so that fixtures need no weights.

use std::collections::BTreeMap;
use std::path::Path;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Device, Gradients, Tensor, TensorData};
use safetensors::{Dtype, tensor::TensorView};
use serde_json::Value;

/// Every device that the tests were built for: the CPU's, and with a GPU's feature that GPU or a software device.
#[allow(deprecated, reason = "the older backend stays selectable, so it stays tested")]
pub fn devices() -> Vec<Device> {
    vec![
        Device::flex(),
        Device::ndarray(),
        #[cfg(feature = "gpu")]
        gpu(),
    ]
}

/// The GPU that the features choose.
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

/// Element `n` of tensor `l`, in [−1, 1): 24 bits of SplitMix64's finaliser, as in `fixtures/hashed.py`.
pub fn hashed(l: usize, n: usize) -> f64 {
    let mut z = (((l as u64) << 40) + n as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    (z >> 40) as f64 / (1u64 << 23) as f64 - 1.0
}

/// Reads `fixtures/<name>.json`.
///
/// # Panics
/// If the file is missing or not JSON.
pub fn fixture(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name).with_extension("json");
    serde_json::from_slice(&std::fs::read(path).expect("a fixture")).expect("JSON")
}

/// Returns `module` with new parameters and their number: parameter `l`, in the module's order, becomes `values(l, shape)`, row by
/// row; it stays if that is `None`.
pub fn with_parameters<M: Module>(module: M, values: impl FnMut(usize, &[usize]) -> Option<Vec<f32>>) -> (M, usize) {
    struct Overwrite<V> {
        values: V,
        next: usize,
    }

    impl<V: FnMut(usize, &[usize]) -> Option<Vec<f32>>> ModuleMapper for Overwrite<V> {
        fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
            let shape = param.val().dims();
            let values = (self.values)(self.next, &shape);
            self.next += 1;
            let Some(values) = values else { return param };
            param.map(|old| {
                let new = Tensor::from_data(TensorData::new(values, shape), &old.device());
                if new.is_autodiff() { new.require_grad() } else { new }
            })
        }
    }

    let mut overwrite = Overwrite { values, next: 0 };
    let module = module.map(&mut overwrite);
    (module, overwrite.next)
}

/// Returns `module` with parameters that follow from a rule, and their number: element `n` of parameter `l`, in the module's order,
/// is `rule(l, shape, hashed(l, n))`.
pub fn overwritten<M: Module>(module: M, rule: impl Fn(usize, &[usize], f64) -> f64) -> (M, usize) {
    with_parameters(module, |l, shape| {
        Some((0..shape.iter().product()).map(|n| rule(l, shape, hashed(l, n)) as f32).collect())
    })
}

/// Returns the rank and gradient of every parameter, in the module's order.
///
/// # Panics
/// If a parameter has no gradient.
pub fn gradients_of(module: &impl Module, gradients: &Gradients) -> Vec<(usize, Vec<f32>)> {
    struct Visitor<'a> {
        gradients: &'a Gradients,
        found: Vec<(usize, Vec<f32>)>,
    }

    impl ModuleVisitor for Visitor<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let gradient = param.val().grad(self.gradients).expect("every parameter has a gradient");
            self.found.push((D, gradient.into_data().try_to_vec().expect("f32")));
        }
    }

    let mut visitor = Visitor { gradients, found: Vec::new() };
    module.visit(&mut visitor);
    visitor.found
}

/// Returns the elements of a fixture's list of numbers.
///
/// # Panics
/// If the value is not a list of numbers.
pub fn numbers(value: &Value) -> Vec<f32> {
    let number = |x: &Value| x.as_f64().expect("a number") as f32;
    value.as_array().expect("a list").iter().map(number).collect()
}

/// Returns the largest magnitude.
pub fn largest(values: &[f32]) -> f64 {
    values.iter().map(|x| f64::from(x.abs())).fold(0.0, f64::max)
}

/// Checks that no element is further than `tolerance` from the expected one.
///
/// # Panics
/// If an element is, or the lengths differ.
pub fn compare(got: &[f32], want: &[f32], tolerance: f64, what: &str) {
    assert_eq!(got.len(), want.len(), "{what}");
    for (index, (got, want)) in got.iter().zip(want).enumerate() {
        let error = (f64::from(*got) - f64::from(*want)).abs();
        assert!(error <= tolerance, "{what}, {index}: {got} against {want}");
    }
}

/// Returns the colours in [0, 1] of test image `k`, row-major.
pub fn picture(k: usize, pixels: usize) -> Vec<[f32; 3]> {
    (0..pixels).map(|p| [0, 1, 2].map(|c| (0.5 + 0.5 * hashed(1000 + k, 3 * p + c)) as f32)).collect()
}

/// Writes `(name, shape, elements)` as a safetensors file.
///
/// # Panics
/// If a shape does not fit its elements, or the file cannot be written.
pub fn write_weights(path: &Path, tensors: impl Iterator<Item = (String, Vec<usize>, Vec<f32>)>) {
    let bytes: Vec<(String, Vec<usize>, Vec<u8>)> = tensors
        .map(|(name, shape, values)| (name, shape, values.iter().flat_map(|value| value.to_le_bytes()).collect()))
        .collect();
    let view = |shape: &[usize], bytes| TensorView::new(Dtype::F32, shape.to_vec(), bytes).expect("shapes fit");
    let views: BTreeMap<&str, TensorView<'_>> =
        bytes.iter().map(|(name, shape, bytes)| (name.as_str(), view(shape, bytes))).collect();
    safetensors::serialize_to_file(views, &None, path).expect("a file to write to");
}
