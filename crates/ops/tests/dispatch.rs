//! Which devices the host kernels serve: every operation asks `has_host_kernels`, so that a wrong answer would make `flex`
//! slow or send another device's tensors to it.

#![allow(deprecated, reason = "the older CPU backend is tested for as long as it is selectable")]

use burn::tensor::Device;
use infonerf_ops::has_host_kernels;

#[test]
fn flex_runs_the_host_kernels() {
    assert!(has_host_kernels(&Device::flex()));
    assert!(has_host_kernels(&Device::flex().autodiff()));
}

#[test]
fn other_devices_run_tensor_operations() {
    assert!(!has_host_kernels(&Device::ndarray()));
    assert!(!has_host_kernels(&Device::ndarray().autodiff()));
}
