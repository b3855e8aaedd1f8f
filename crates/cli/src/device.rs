//! Which backend computes: one of those that this binary was built with.

use anyhow::{Result, bail};
use burn::tensor::Device;

use crate::args::DeviceName;

/// Names of the devices built in, fastest first.
const BUILT_IN: &[&str] = &[
    #[cfg(feature = "cuda")]
    "cuda",
    #[cfg(feature = "vulkan")]
    "vulkan",
    #[cfg(feature = "wgpu")]
    "wgpu",
    #[cfg(feature = "flex")]
    "flex",
    #[cfg(feature = "ndarray")]
    "ndarray",
];

const CPUS: [(&str, DeviceName); 2] = [("flex", DeviceName::Flex), ("ndarray", DeviceName::Ndarray)];

/// The devices built in that need no GPU.
pub(crate) fn cpus() -> Vec<DeviceName> {
    CPUS.into_iter().filter(|(name, _)| BUILT_IN.contains(name)).map(|(_, device)| device).collect()
}

/// Whether the device called `name` is the processor.
pub(crate) fn is_cpu(name: &str) -> bool {
    CPUS.into_iter().any(|(cpu, _)| cpu == name)
}

/// The device called `name`, and what it is called.
pub(crate) fn open(name: DeviceName) -> Result<(Device, &'static str)> {
    let wanted = match name {
        DeviceName::Auto => BUILT_IN.first().copied().unwrap_or("none"),
        DeviceName::Flex => "flex",
        DeviceName::Ndarray => "ndarray",
        DeviceName::Wgpu => "wgpu",
        DeviceName::Vulkan => "vulkan",
        DeviceName::Cuda => "cuda",
    };
    let device = match wanted {
        #[cfg(feature = "flex")]
        "flex" => Device::flex(),
        #[cfg(feature = "ndarray")]
        #[allow(deprecated, reason = "kept selectable for as long as Burn ships it")]
        "ndarray" => Device::ndarray(),
        #[cfg(feature = "wgpu")]
        "wgpu" => Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        #[cfg(feature = "vulkan")]
        "vulkan" => Device::vulkan(burn::tensor::DeviceKind::DefaultDevice),
        #[cfg(feature = "cuda")]
        "cuda" => Device::cuda(0),
        _ => bail!(
            "--device {wanted}: not built in; this binary has: {}. Build with `cargo build --release --features {wanted}`",
            BUILT_IN.join(", ")
        ),
    };
    #[cfg(any(feature = "wgpu", feature = "vulkan", feature = "cuda"))]
    if matches!(wanted, "wgpu" | "vulkan" | "cuda") {
        eprintln!("{wanted}: {}", adapter(&device, wanted)?);
    }
    Ok((device, wanted))
}

/// What the GPU calls itself.
#[cfg(any(feature = "wgpu", feature = "vulkan", feature = "cuda"))]
fn adapter(device: &Device, wanted: &str) -> Result<String> {
    use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
    // Burn panics where there is no device.
    let hook = take_hook();
    set_hook(Box::new(|_| ()));
    let identity = catch_unwind(AssertUnwindSafe(|| device.identity()));
    set_hook(hook);
    match identity {
        Ok(Some(identity)) => Ok(identity.name),
        _ => {
            bail!("--device {wanted}: no such device on this machine; expected a GPU and its driver, or --device flex")
        }
    }
}
