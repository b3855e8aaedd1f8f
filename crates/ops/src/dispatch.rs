//! Choice of an operation's body by the device of its tensors.

use burn::backend::DispatchDevice;
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
        match $crate::dispatch::BodyKind::serving($device) {
            $(#[cfg(feature = "flex")]
            $crate::dispatch::BodyKind::Host $(if $host_serves)? => $host,)?
            $(#[cfg(feature = "cube")]
            $crate::dispatch::BodyKind::Cube $(if $cube_serves)? => $cube,)?
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

pub(crate) enum BodyKind {
    #[cfg(feature = "flex")]
    Host,
    #[cfg(feature = "cube")]
    Cube,
    Plain,
}

impl BodyKind {
    pub(crate) fn serving(device: &Device) -> Self {
        match device.clone().inner().as_dispatch() {
            #[cfg(feature = "flex")]
            DispatchDevice::Flex(_) => Self::Host,
            #[cfg(feature = "cube")]
            DispatchDevice::Cube(_) => Self::Cube,
            _ => Self::Plain,
        }
    }
}
