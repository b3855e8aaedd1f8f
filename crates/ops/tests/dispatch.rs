//! Dispatch by device: a wrong answer would make `flex` slow, or send tensors of other devices to the host kernels.

#![allow(deprecated, reason = "the older CPU backend is tested for as long as it is selectable")]

use burn::tensor::Device;
use infonerf_ops::has_host_kernels;

#[test]
fn flex_has_host_kernels() {
    assert!(has_host_kernels(&Device::flex()));
    assert!(has_host_kernels(&Device::flex().autodiff()));
}

#[test]
fn ndarray_has_no_host_kernels() {
    assert!(!has_host_kernels(&Device::ndarray()));
    assert!(!has_host_kernels(&Device::ndarray().autodiff()));
}
