//! Choice of an operation's body by the device of its tensors.

use burn::tensor::Device;

/// Evaluates the body of an operation for a device: `host` on `flex`, `cube` on GPUs, `plain` on all other devices.
/// `plain` also replaces an arm that is left out, or whose condition is false.
macro_rules! dispatch {
    (
        $device:expr;
        $(host $(if $host_serves:expr)? => $host:expr,)?
        $(cube $(if $cube_serves:expr)? => $cube:expr,)?
        plain => $plain:expr $(,)?
    ) => {
        match $device.clone().inner().as_dispatch() {
            $(#[cfg(feature = "flex")]
            burn::backend::DispatchDevice::Flex(_) $(if $host_serves)? => $host,)?
            $(#[cfg(feature = "cube")]
            burn::backend::DispatchDevice::Cube(_) $(if $cube_serves)? => $cube,)?
            _ => $plain,
        }
    };
}
pub(crate) use dispatch;

/// Returns whether `device` is a GPU, which works asynchronously: the host waits for it to read a tensor.
pub fn is_gpu(device: &Device) -> bool {
    dispatch! { device; cube => true, plain => false }
}

/// Returns whether tensors on `device` are served by the host kernels.
pub fn has_host_kernels(device: &Device) -> bool {
    dispatch! { device; host => true, plain => false }
}
