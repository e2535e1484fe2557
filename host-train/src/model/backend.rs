//! Which backends this build can run on.

use crate::{Error, Result};
use burn::tensor::Device;

/// A compute backend; each is a Cargo feature of the same name.
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
    /// The backend's first device.
    ///
    /// # Errors
    /// [`Error::Usage`] if this build lacks the backend's feature.
    #[allow(deprecated)] // ndarray and libtorch are second opinions as long as the pinned release has them
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

    /// Names of the backends in this build.
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
