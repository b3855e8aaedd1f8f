//! Devices: the backends that this program was built with, and how one of them is opened.

use std::fmt;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::Device;
use infonerf_metrics::{METRICS, Networks};
use infonerf_pretrained::Store;

/// Name of a device, as on the command line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum DeviceName {
    /// The fastest device that is built in.
    #[default]
    Auto,
    /// CPU: Burn's flex backend with the kernels of infonerf-ops.
    Flex,
    /// CPU: Burn's older backend, with plain tensors.
    Ndarray,
    /// Any GPU: through WGSL, or through SPIR-V where `vulkan` is built in as well.
    Wgpu,
    /// GPUs with Vulkan, through SPIR-V.
    Vulkan,
    /// NVIDIA GPUs.
    Cuda,
}

impl DeviceName {
    /// The devices built in, fastest first.
    pub const BUILT_IN: &[Self] = &[
        #[cfg(feature = "cuda")]
        Self::Cuda,
        #[cfg(feature = "vulkan")]
        Self::Vulkan,
        #[cfg(feature = "wgpu")]
        Self::Wgpu,
        #[cfg(feature = "flex")]
        Self::Flex,
        #[cfg(feature = "ndarray")]
        Self::Ndarray,
    ];

    /// Returns the number of fields that are trained at a time: one on each core of a CPU, one on a GPU.
    pub fn fields_side_by_side(self) -> usize {
        if self.is_cpu() { rayon::current_num_threads() } else { 1 }
    }

    /// Returns the name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Flex => "flex",
            Self::Ndarray => "ndarray",
            Self::Wgpu => "wgpu",
            Self::Vulkan => "vulkan",
            Self::Cuda => "cuda",
        }
    }

    /// Resolves the name to a device that is built in: never [`DeviceName::Auto`]. [`open`] checks whether the machine has it.
    ///
    /// # Errors
    /// If it is not built in.
    pub fn built_in(self) -> Result<Self> {
        let found = Self::BUILT_IN.iter().copied().find(|device| self == Self::Auto || self == *device);
        found.with_context(|| {
            format!(
                "--device {self}: not built in; this program has: {}. Build with `cargo build --release --features {self}`",
                Self::BUILT_IN.iter().map(|device| device.name()).collect::<Vec<_>>().join(", ")
            )
        })
    }

    /// Whether the device is the CPU.
    pub fn is_cpu(self) -> bool {
        matches!(self, Self::Flex | Self::Ndarray)
    }
}

impl fmt::Display for DeviceName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A device with its name.
#[derive(Clone, Debug)]
pub struct OpenDevice {
    /// Device for tensors.
    pub device: Device,
    /// Name of the device; never [`DeviceName::Auto`].
    pub name: DeviceName,
    /// Name of the GPU as its driver reports it; `None` for a CPU.
    pub adapter: Option<String>,
}

/// Opens the device called `name`.
///
/// # Errors
/// If it is not built in, or there is no such GPU.
pub fn open(name: DeviceName) -> Result<OpenDevice> {
    let name = name.built_in()?;
    #[cfg(any(feature = "vulkan", feature = "cuda"))]
    keep_kernels();
    let device = match name {
        #[cfg(feature = "flex")]
        DeviceName::Flex => Device::flex(),
        #[cfg(feature = "ndarray")]
        #[allow(deprecated, reason = "kept selectable for as long as Burn ships it")]
        DeviceName::Ndarray => Device::ndarray(),
        #[cfg(feature = "wgpu")]
        DeviceName::Wgpu => Device::wgpu(burn::tensor::DeviceKind::DefaultDevice),
        #[cfg(feature = "vulkan")]
        DeviceName::Vulkan => Device::vulkan(burn::tensor::DeviceKind::DefaultDevice),
        #[cfg(feature = "cuda")]
        DeviceName::Cuda => Device::cuda(0),
        name => bail!("--device {name}: not built in"),
    };
    let adapter = if name.is_cpu() { None } else { Some(adapter(&device, name)?) };
    if let Some(adapter) = &adapter {
        check_spirv(name, adapter, cfg!(feature = "vulkan"))?;
    }
    Ok(OpenDevice { device, name, adapter })
}

/// Keeps compiled kernels in the user's cache, for later processes. All other settings come
/// from CubeCL's own `cubecl.toml` and environment variables.
#[cfg(any(feature = "vulkan", feature = "cuda"))]
fn keep_kernels() {
    use burn::cubecl::config::cache::CacheConfig;
    use burn::cubecl::config::{CubeClRuntimeConfig, RuntimeConfig};
    let mut config = CubeClRuntimeConfig::from_current_dir().override_from_env();
    config.compilation.cache = true;
    if let CacheConfig::Target = config.environment.path {
        config.environment.path = CacheConfig::Global;
    }
    // Returns false if an earlier call has set this configuration already.
    let _ = CubeClRuntimeConfig::try_set(config);
}

/// Returns an error for a device whose driver would crash. CubeCL 0.11.3 (`lower_shared_implicit` of cubecl-spirv) declares
/// shared memory wrongly on devices without `VK_KHR_workgroup_memory_explicit_layout`. The only one known is Mesa's lavapipe.
/// With `vulkan` built in, `wgpu` compiles to SPIR-V as well.
fn check_spirv(name: DeviceName, adapter: &str, spirv: bool) -> Result<()> {
    let affected = spirv && matches!(name, DeviceName::Wgpu | DeviceName::Vulkan) && adapter.contains("llvmpipe");
    ensure!(
        !affected,
        "--device {name}: {adapter} lacks VK_KHR_workgroup_memory_explicit_layout, without which CubeCL's SPIR-V is invalid; \
         expected another device, or a program built with `--features wgpu` alone"
    );
    Ok(())
}

/// Returns the networks of learned metrics whose weights are found: in `weights` (a file or a folder), in the folder that
/// the environment variable `INFONERF_WEIGHTS` names, or in the user's cache.
///
/// # Errors
/// If weights are there and cannot be read, or `weights` is a folder without any.
pub fn networks(weights: Option<&Path>, device: &OpenDevice) -> Result<Networks> {
    if let Some(folder) = weights.filter(|path| path.is_dir()) {
        let found = Store::in_folder(folder).status().any(|(_, path)| path.is_some());
        ensure!(found, "--weights {}: expected a file that `infonerf weights` lists, found none", folder.display());
    }
    Ok(Store::new(weights)?.networks(METRICS, &device.device)?)
}

#[cfg(not(any(feature = "wgpu", feature = "vulkan", feature = "cuda")))]
fn adapter(_device: &Device, name: DeviceName) -> Result<String> {
    bail!("--device {name}: not built in")
}

/// Returns the name of the GPU as its driver reports it.
#[cfg(any(feature = "wgpu", feature = "vulkan", feature = "cuda"))]
fn adapter(device: &Device, name: DeviceName) -> Result<String> {
    use std::panic::{AssertUnwindSafe, catch_unwind, set_hook, take_hook};
    // Burn panics where there is no device.
    let hook = take_hook();
    set_hook(Box::new(|_| ()));
    let identity = catch_unwind(AssertUnwindSafe(|| device.identity()));
    set_hook(hook);
    match identity {
        Ok(Some(identity)) => Ok(identity.name),
        _ => bail!("--device {name}: no such device on this machine; expected a GPU and its driver, or --device flex"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spirv_is_refused_on_lavapipe_alone() {
        let lavapipe = "llvmpipe (LLVM 15.0.6, 256 bits)";
        for name in [DeviceName::Wgpu, DeviceName::Vulkan] {
            let error = check_spirv(name, lavapipe, true).unwrap_err().to_string();
            assert!(error.starts_with(&format!("--device {name}: llvmpipe")), "{error}");
        }
        assert!(check_spirv(DeviceName::Wgpu, lavapipe, false).is_ok(), "through WGSL");
        assert!(check_spirv(DeviceName::Vulkan, "NVIDIA H100 PCIe", true).is_ok());
    }
}
