//! Weights and images by the rule of `rule.py`, so that neither is stored; and the devices.

use std::path::Path;

use burn::tensor::Device;
use infonerf_metrics::Picture;
use infonerf_pretrained::TensorShape;
use safetensors::Dtype;
use safetensors::tensor::{TensorView, serialize_to_file};

/// Generates `count` pseudorandom values in [−1, 1), different for each name.
fn hashed(name: &str, count: usize) -> impl Iterator<Item = f64> {
    let seed = name.bytes().fold(0x811C_9DC5u32, |seed, byte| (seed ^ u32::from(byte)).wrapping_mul(0x0100_0193));
    (0..count).map(move |i| {
        let x = (i as u32).wrapping_mul(0x9E37_79B1).wrapping_add(seed);
        let x = (x ^ (x >> 15)).wrapping_mul(0x2C1B_3C6D);
        let x = (x ^ (x >> 12)).wrapping_mul(0x297A_2D39);
        f64::from((x ^ (x >> 15)) >> 8) / f64::from(1 << 23) - 1.0
    })
}

/// Generates the values of the tensor `name`.
pub fn values_of(name: &str, shape: &[usize]) -> Vec<f32> {
    let fan_in: usize = shape.iter().skip(1).product();
    let value = |u: f64| match shape {
        _ if name.starts_with("lin") => u.abs() / shape[1] as f64,
        [_] if name.ends_with("bn.weight") || name.ends_with("running_var") => 1.0 + 0.2 * u,
        [_] => 0.1 * u,
        _ => u * (6.0 / fan_in as f64).sqrt(),
    };
    hashed(name, shape.iter().product()).map(|u| value(u) as f32).collect()
}

/// Writes a safetensors file of `tensors`.
pub fn write_weights(path: &Path, tensors: &[TensorShape]) {
    let bytes = |(name, shape): &TensorShape| values_of(name, shape).into_iter().flat_map(f32::to_le_bytes).collect();
    let bytes: Vec<Vec<u8>> = tensors.iter().map(bytes).collect();
    let stored = tensors.iter().zip(&bytes);
    let views = stored.map(|((name, shape), bytes)| (name, TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap()));
    serialize_to_file(views, &None, path).unwrap();
}

/// Generates image `index`: a few waves and some noise.
pub fn picture(index: usize, height: usize, width: usize) -> Picture {
    let value = |c: usize, y: usize, x: usize| {
        let waves = (x * (index + 2) * 3 + y * (c + 1) * 5) % 128 + (x * y / (3 + index) + 40 * c) % 64;
        let noise = (x * 7919 + y * 104_729 + c * 31 + index * 17) % 64;
        (waves + noise).min(255) as f32 / 255.0
    };
    let pixel = |at: usize| std::array::from_fn(|c| value(c, at / width, at % width));
    Picture::new((0..height * width).map(pixel).collect(), width, height).unwrap()
}

/// Returns both CPU backends.
#[allow(deprecated, reason = "the older CPU backend stays tested")]
pub fn devices() -> [Device; 2] {
    [Device::flex(), Device::ndarray()]
}
