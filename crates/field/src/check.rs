//! Checks of sizes that fields share.

use std::fmt::Display;
use std::ops::RangeInclusive;

use burn::tensor::{Device, FloatDType};
use infonerf_ops::has_host_kernels;
use infonerf_ops::mlp::Precision;
use infonerf_schedule::{Fault, Schedule};

/// Returns a fault at `key` of `[field]` with the value `found` unless `good` is true.
pub(crate) fn check(key: &str, expected: &str, found: impl ToString, good: bool) -> Result<(), Fault> {
    Fault::unless(good, key, expected, found).map_err(|fault| fault.within("field"))
}

/// Refuses a number `found` at `key` of `[field]` outside of `range`.
pub(crate) fn check_range<T: PartialOrd + Display>(key: &str, range: RangeInclusive<T>, found: T) -> Result<(), Fault> {
    check(key, &format!("{} to {}", range.start(), range.end()), &found, range.contains(&found))
}

/// Refuses a width that is odd, or not from 2 to `most`.
pub(crate) fn check_width(width: usize, most: usize) -> Result<(), Fault> {
    let good = (2..=most).contains(&width) && width.is_multiple_of(2);
    check("width", &format!("an even number from 2 to {most}"), width, good)
}

pub(crate) fn check_precision(precision: Precision, device: &Device) -> Result<(), Fault> {
    let supported = has_host_kernels(device) || device.supports_dtype(FloatDType::BF16);
    let good = precision == Precision::F32 || supported;
    check("precision", "\"f32\", as this device has no bf16", "bf16", good)
}

/// Checks s and b in σ = s·softplus(x + b).
pub(crate) fn check_density(scale: f32, bias: f32) -> Result<(), Fault> {
    check("density_scale", "above 0, at most 1e6", scale, scale > 0.0 && scale <= 1e6)?;
    check_range("density_bias", -50.0..=50.0, bias)
}

pub(crate) fn check_detail(detail: &Schedule) -> Result<(), Fault> {
    let range = format!("{} to {}", detail.least(), detail.largest());
    check("detail", "shares from 0 to 1", range, detail.least() >= 0.0 && detail.largest() <= 1.0)
}
