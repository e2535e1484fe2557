//! Backends of this build.

use burn::tensor::Device;
#[cfg(any(feature = "cuda", feature = "vulkan"))]
use burn::tensor::DeviceType;
use elunar_raster::{Error, Result};

/// A compute backend. Each is a Cargo feature of the same name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// Pure-Rust CPU with SIMD and threads (default).
    Flex,
    /// Reference CPU.
    Ndarray,
    /// libtorch.
    Tch,
    /// NVIDIA GPUs.
    Cuda,
    /// GPUs through Vulkan.
    Vulkan,
}

impl Backend {
    /// Returns the backend's first device.
    ///
    /// # Errors
    /// [`Error::Usage`] if this build lacks the backend's feature.
    #[allow(deprecated)] // ndarray and libtorch serve for comparison as long as the pinned release has them
    pub fn device(self) -> Result<Device> {
        match self {
            #[cfg(feature = "flex")]
            Self::Flex => Ok(Device::flex()),
            #[cfg(feature = "ndarray")]
            Self::Ndarray => Ok(Device::ndarray()),
            #[cfg(feature = "tch")]
            Self::Tch => Ok(Device::libtorch()),
            #[cfg(feature = "cuda")]
            Self::Cuda => Ok(Device::cuda(0)),
            #[cfg(feature = "vulkan")]
            Self::Vulkan => Ok(Device::vulkan(burn::tensor::DeviceKind::DefaultDevice)),
            #[allow(unreachable_patterns)]
            other => {
                let name = format!("{other:?}").to_lowercase();
                Err(Error::usage(format!(
                    "backend {name}: not in this build; build with `--features {name}` (found: {})",
                    Self::available().join(", ")
                )))
            }
        }
    }

    /// Returns `count` devices that share the work. On GPUs these are the first ones. The CPU is one device, so it is returned `count`
    /// times.
    ///
    /// # Errors
    /// [`Error::Usage`] if this build lacks the backend's feature, or the machine has too few devices.
    pub fn devices(self, count: usize) -> Result<Vec<Device>> {
        let first = self.device()?;
        let all: Vec<Device> = match self {
            _ if count == 1 => return Ok(vec![first]),
            #[cfg(feature = "cuda")]
            Self::Cuda => Device::enumerate(DeviceType::Cuda).into_vec(),
            #[cfg(feature = "vulkan")]
            Self::Vulkan => Device::enumerate(DeviceType::Vulkan).into_vec(),
            _ => vec![first; count],
        };
        if all.len() < count {
            let what = format!("devices: expected at least {count} of {self:?}, found {}", all.len());
            return Err(Error::usage(what));
        }
        Ok(all.into_iter().take(count).collect())
    }

    /// Returns the names of the backends in this build.
    pub fn available() -> Vec<&'static str> {
        let all = [
            (cfg!(feature = "flex"), "flex"),
            (cfg!(feature = "ndarray"), "ndarray"),
            (cfg!(feature = "tch"), "tch"),
            (cfg!(feature = "cuda"), "cuda"),
            (cfg!(feature = "vulkan"), "vulkan"),
        ];
        all.into_iter().filter_map(|(built, name)| built.then_some(name)).collect()
    }
}
