//! Choice of an operation's body by the device of its tensors.

use burn::backend::DispatchDevice;
use burn::tensor::Device;

/// Evaluates the body of an operation that serves a device: `host` on `flex`, `cube` on GPUs, `plain` on all other devices.
/// An arm that is left out, or whose condition is false, leaves its devices to `plain`.
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

/// Returns whether `device` works asynchronously, so that the host waits when it reads a tensor.
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
