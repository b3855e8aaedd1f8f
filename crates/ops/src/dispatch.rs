//! Which body of an operation runs where.

use burn::backend::DispatchDevice;
use burn::tensor::Device;

/// Evaluates the body of an operation that serves a device: the host kernel on `flex`, the CubeCL kernel on GPUs, where
/// there is one and its condition holds, and plain tensors elsewhere.
macro_rules! dispatch {
    (
        $device:expr;
        host $(if $host_serves:expr)? => $host:expr,
        $(cube $(if $cube_serves:expr)? => $cube:expr,)?
        plain => $plain:expr $(,)?
    ) => {
        match $crate::dispatch::Body::serving($device) {
            #[cfg(feature = "flex")]
            $crate::dispatch::Body::Host $(if $host_serves)? => $host,
            $(#[cfg(feature = "cube")]
            $crate::dispatch::Body::Cube $(if $cube_serves)? => $cube,)?
            _ => $plain,
        }
    };
}
pub(crate) use dispatch;

/// Whether `device` works on its own time, so that the host waits where it reads something back.
pub fn is_gpu(device: &Device) -> bool {
    dispatch! { device; host => false, cube => true, plain => false }
}

/// Which kernels a device runs.
pub(crate) enum Body {
    #[cfg(feature = "flex")]
    Host,
    #[cfg(feature = "cube")]
    Cube,
    Plain,
}

impl Body {
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
