//! Helpers of the tests across crates: parameters that follow from a rule, so that fixtures need no weights. They panic if a
//! fixture or a file is not as expected.

use std::path::Path;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::tensor::{Device, Gradients, Tensor, TensorData};
use glam::Vec3;
use infonerf_scene::{Aabb, Range, Space};
use safetensors::{Dtype, tensor::TensorView};
use serde_json::Value;

/// Tolerance of the values of fixtures.
pub const TOLERANCE: f64 = 1e-4;

/// Returns every device that the tests were built for: the CPU's, and with a GPU's feature that GPU or a software device.
#[allow(deprecated, reason = "the older backend stays selectable, so it stays tested")]
pub fn devices() -> Vec<Device> {
    vec![
        Device::flex(),
        Device::ndarray(),
        #[cfg(feature = "cuda")]
        Device::cuda(0),
        #[cfg(all(feature = "vulkan", not(feature = "cuda")))]
        Device::vulkan(burn::tensor::DeviceKind::DefaultDevice),
        #[cfg(all(feature = "wgpu", not(any(feature = "vulkan", feature = "cuda"))))]
        Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
    ]
}

/// Returns element `n` of tensor `l` in [−1, 1): 24 bits of SplitMix64's finaliser, as in `fixtures/hashed.py`.
pub fn hashed(l: usize, n: usize) -> f64 {
    let mut z = (((l as u64) << 40) + n as u64).wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^= z >> 31;
    (z >> 40) as f64 / (1u64 << 23) as f64 - 1.0
}

/// Reads `fixtures/<name>.json`.
pub fn fixture(name: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures").join(name).with_extension("json");
    serde_json::from_slice(&std::fs::read(path).expect("a fixture")).expect("JSON")
}

/// Returns `module` with new parameters and their number: parameter `l`, in the module's order, becomes `values(l, shape)`, row by
/// row; a parameter whose values are `None` stays.
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

/// Returns [`with_parameters`] whose elements follow from a rule: element `n` of parameter `l` is `rule(l, shape, hashed(l, n))`.
pub fn overwritten<M: Module>(module: M, rule: impl Fn(usize, &[usize], f64) -> f64) -> (M, usize) {
    with_parameters(module, |l, shape| {
        Some((0..shape.iter().product()).map(|n| rule(l, shape, hashed(l, n)) as f32).collect())
    })
}

/// Returns shape and elements of every parameter, or of its gradient among `gradients`, in the module's order.
pub fn parameters_of(module: &impl Module, gradients: Option<&Gradients>) -> Vec<(Vec<usize>, Vec<f32>)> {
    struct Visitor<'a> {
        gradients: Option<&'a Gradients>,
        found: Vec<(Vec<usize>, Vec<f32>)>,
    }

    impl ModuleVisitor for Visitor<'_> {
        fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
            let gradient = |gradients| param.val().grad(gradients).expect("every parameter has a gradient");
            let values = self.gradients.map_or_else(|| param.val(), gradient);
            self.found.push((values.dims().to_vec(), values.into_data().try_to_vec().expect("f32")));
        }
    }

    let mut visitor = Visitor { gradients, found: Vec::new() };
    module.visit(&mut visitor);
    visitor.found
}

/// Returns the gradients of the parameters of a rank, in the module's order.
pub fn gradients_of_rank(rank: usize, module: &impl Module, gradients: &Gradients) -> Vec<Vec<f32>> {
    let all = parameters_of(module, Some(gradients)).into_iter();
    all.filter(|(shape, _)| shape.len() == rank).map(|(_, values)| values).collect()
}

/// Returns the elements of a fixture's list of numbers, or its one number.
pub fn floats(value: &Value) -> Vec<f64> {
    let number = |x: &Value| x.as_f64().expect("a number");
    value.as_array().map_or_else(|| vec![number(value)], |items| items.iter().map(number).collect())
}

/// Returns [`floats`] in single precision.
pub fn numbers(value: &Value) -> Vec<f32> {
    floats(value).into_iter().map(|x| x as f32).collect()
}

/// Returns the elements of a fixture's list of whole numbers.
pub fn wholes(value: &Value) -> Vec<usize> {
    value.as_array().expect("a list").iter().map(whole).collect()
}

/// Returns a whole number of a fixture.
pub fn whole(value: &Value) -> usize {
    value.as_u64().expect("a whole number") as usize
}

/// Returns the three elements of a fixture's vector.
pub fn triple(value: &Value) -> [f32; 3] {
    numbers(value).try_into().expect("three numbers")
}

/// Returns the space of a scene within a cube of `half_edge` about the origin, between the fixture's near and far.
pub fn space(fixture: &Value, half_edge: f32) -> Space {
    let [near, far] = ["near", "far"].map(|key| floats(&fixture[key])[0] as f32);
    let bounds = Aabb::cube(Vec3::ZERO, half_edge);
    Space { near, far, range: Range::Distance { near, far }, bounds, ..Space::default() }
}

/// Checks that each element differs from the expected one `want` by at most `tolerance(want)`.
pub fn compare_within<A, B>(got: &[A], want: &[B], tolerance: impl Fn(f64) -> f64, what: &str)
where
    A: Copy + Into<f64>,
    B: Copy + Into<f64>,
{
    assert_eq!(got.len(), want.len(), "{what}");
    for (index, (got, want)) in got.iter().zip(want).enumerate() {
        let (got, want) = ((*got).into(), (*want).into());
        assert!((got - want).abs() <= tolerance(want), "{what}, {index}: {got} against {want}");
    }
}

/// Checks that elements differ by at most [`TOLERANCE`] times the largest expected magnitude, or `floor` if that is larger.
pub fn close(got: &[f32], want: &[f32], floor: f64, what: &str) {
    let scale = want.iter().map(|x| f64::from(x.abs())).fold(floor, f64::max);
    compare_within(got, want, |_| TOLERANCE * scale, what);
}

/// Returns the colours in [0, 1] of test image `k`, row-major.
pub fn picture(k: usize, pixels: usize) -> Vec<[f32; 3]> {
    (0..pixels).map(|p| [0, 1, 2].map(|c| (0.5 + 0.5 * hashed(1000 + k, 3 * p + c)) as f32)).collect()
}

/// Writes tensors of these names and shapes as a safetensors file: element `n` of tensor `l` is `rule(name, shape, hashed(l, n))`.
pub fn write_weights(path: &Path, tensors: &[(String, Vec<usize>)], rule: impl Fn(&str, &[usize], f64) -> f64) {
    let bytes = |(l, (name, shape)): (usize, &(String, Vec<usize>))| -> Vec<u8> {
        let values = (0..shape.iter().product()).map(|n| rule(name, shape, hashed(l, n)) as f32);
        values.flat_map(f32::to_le_bytes).collect()
    };
    let bytes: Vec<Vec<u8>> = tensors.iter().enumerate().map(bytes).collect();
    let views = tensors.iter().zip(&bytes).map(|((name, shape), bytes)| {
        (name.as_str(), TensorView::new(Dtype::F32, shape.clone(), bytes).expect("shapes fit"))
    });
    safetensors::serialize_to_file(views, &None, path).expect("a file to write to");
}
