//! Checks of sizes that fields share.

use burn::tensor::{Device, FloatDType};
use infonerf_ops::has_host_kernels;
use infonerf_ops::mlp::Precision;
use infonerf_schedule::{Fault, Schedule};

/// Refuses the value `found` at `key` of `[field]` unless it is `good`.
pub(crate) fn check(key: &str, expected: &str, found: impl ToString, good: bool) -> Result<(), Fault> {
    Fault::unless(good, key, expected, found).map_err(|fault| fault.within("field"))
}

pub(crate) fn check_precision(precision: Precision, device: &Device) -> Result<(), Fault> {
    let supported = has_host_kernels(device) || device.supports_dtype(FloatDType::BF16);
    let good = precision == Precision::F32 || supported;
    check("precision", "\"f32\", as this device has no bf16", "bf16", good)
}

/// Checks s and b in σ = s·softplus(x + b).
pub(crate) fn check_density(scale: f32, bias: f32) -> Result<(), Fault> {
    check("density_scale", "above 0, at most 1e6", scale, scale > 0.0 && scale <= 1e6)?;
    check("density_bias", "-50 to 50", bias, (-50.0..=50.0).contains(&bias))
}

pub(crate) fn check_detail(detail: &Schedule) -> Result<(), Fault> {
    let range = format!("{} to {}", detail.least(), detail.largest());
    check("detail", "shares from 0 to 1", range, detail.least() >= 0.0 && detail.largest() <= 1.0)
}
