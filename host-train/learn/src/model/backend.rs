//! Backends of this build, and the devices that each finds on this machine.

#[cfg(any(feature = "cuda", feature = "vulkan-plain"))]
use burn::tensor::DeviceType;
use burn::tensor::{Device, FloatDType, Tensor};
use clap::builder::{PossibleValuesParser, TypedValueParser};
use elunar_base::{Error, Result};
use std::panic::AssertUnwindSafe;

/// A compute backend. Each is a Cargo feature of the same name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// Pure-Rust CPU with SIMD and threads (default).
    Flex,
    /// Reference CPU.
    Ndarray,
    /// NVIDIA GPUs.
    Cuda,
    /// GPUs through Vulkan.
    Vulkan,
}

/// A device as the command `devices` lists it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    /// Name of the device.
    pub name: String,
    /// Whether it is a GPU. Vulkan also finds drivers that compute on the CPU.
    pub gpu: bool,
    /// Whether it computes in bfloat16.
    pub bf16: bool,
}

impl Backend {
    /// All backends. The first are the first choice of [`Self::automatic`].
    pub const ALL: [Self; 4] = [Self::Cuda, Self::Vulkan, Self::Flex, Self::Ndarray];

    /// Returns the name on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Flex => "flex",
            Self::Ndarray => "ndarray",
            Self::Cuda => "cuda",
            Self::Vulkan => "vulkan",
        }
    }

    /// Returns whether this build has the backend.
    #[must_use]
    pub fn is_built(self) -> bool {
        match self {
            Self::Flex => true,
            Self::Ndarray => cfg!(feature = "ndarray"),
            Self::Cuda => cfg!(feature = "cuda"),
            Self::Vulkan => cfg!(feature = "vulkan-plain"),
        }
    }

    /// Returns a parser of `--backend`: a name, or `auto` for [`Self::automatic`].
    pub fn parser() -> impl TypedValueParser<Value = Self> {
        let names = Self::ALL.map(Self::name).into_iter().chain(["auto"]);
        PossibleValuesParser::new(names)
            .map(|name| Self::ALL.into_iter().find(|backend| backend.name() == name).unwrap_or_else(Self::automatic))
    }

    /// Returns the first backend of [`Self::ALL`] that finds a GPU, otherwise flex, and says on stderr which.
    #[must_use]
    pub fn automatic() -> Self {
        let gpu = |backend: &Self| backend.found().ok().and_then(|all| all.into_iter().find(|found| found.gpu));
        let first =
            Self::ALL.into_iter().filter(|backend| backend.is_built()).find_map(|b| gpu(&b).map(|d| (b, d.name)));
        let (backend, name) = first.unwrap_or((Self::Flex, processor()));
        elunar_base::say::note(&format!("backend: {} ({name})", backend.name()));
        backend
    }

    /// Returns the backend's first device, after a computation on it.
    ///
    /// # Errors
    /// [`Error::Usage`] if this build lacks the backend's feature, the machine has no such device, or the device does not work.
    pub fn device(self) -> Result<Device> {
        Ok(self.devices(1)?.remove(0))
    }

    /// Returns `count` devices that share the work, each after a computation on it. On GPUs these are the first ones. The CPU is one device,
    /// so it is returned `count` times.
    ///
    /// # Errors
    /// As [`Self::device`], also if the machine has too few devices.
    pub fn devices(self, count: usize) -> Result<Vec<Device>> {
        let mut all = self.enumerate()?;
        if all.first().is_some_and(on_processor) {
            all = vec![all[0].clone(); count];
        }
        if all.len() < count {
            let (name, found) = (self.name(), all.len());
            return Err(match found {
                0 => Error::usage(format!("backend {name}: expected {}, found none", self.wants())),
                _ => Error::usage(format!("devices: expected at least {count} of {name}, found {found}")),
            });
        }
        all.truncate(count);
        all.iter().try_for_each(|device| self.try_out(device))?;
        Ok(all)
    }

    /// Returns all devices that the backend finds on this machine.
    ///
    /// # Errors
    /// [`Error::Usage`] if this build lacks the backend's feature.
    pub fn found(self) -> Result<Vec<Found>> {
        Ok(self.enumerate()?.iter().filter_map(|device| quietly(|| describe(device)).ok()).collect())
    }

    /// Returns what the backend needs on the machine.
    #[must_use]
    pub fn wants(self) -> &'static str {
        match self {
            Self::Flex | Self::Ndarray => "a processor",
            Self::Cuda => "an NVIDIA GPU with its driver (libcuda)",
            Self::Vulkan => "a Vulkan loader (libvulkan) and a driver",
        }
    }

    #[allow(deprecated)] // ndarray serves for comparison as long as the pinned release has it
    fn enumerate(self) -> Result<Vec<Device>> {
        #[cfg(feature = "tuned")]
        keep_kernels();
        match self {
            Self::Flex => Ok(vec![Device::flex()]),
            #[cfg(feature = "ndarray")]
            Self::Ndarray => Ok(vec![Device::ndarray()]),
            #[cfg(feature = "cuda")]
            Self::Cuda => Ok(Device::enumerate(DeviceType::Cuda).into_vec()),
            #[cfg(feature = "vulkan-plain")]
            Self::Vulkan => Ok(Device::enumerate(DeviceType::Vulkan).into_vec()),
            #[allow(unreachable_patterns)]
            other => {
                let name = other.name();
                let built: Vec<&str> = Self::ALL.into_iter().filter(|b| b.is_built()).map(Self::name).collect();
                Err(Error::usage(format!(
                    "backend {name}: not in this build; build with `--features {name}` (found: {})",
                    built.join(", ")
                )))
            }
        }
    }

    /// Computes exp(0) + 1. Burn's GPU backends panic if a library is missing, and CUDA's has `exp` in a library of its own.
    fn try_out(self, device: &Device) -> Result<()> {
        let work = || Tensor::<1>::zeros([2], device).exp().add_scalar(1.0).into_data().try_to_vec::<f32>();
        let broken = |what: &str| {
            Error::usage(format!("backend {}: expected a working device, found: {}", self.name(), reason(what)))
        };
        match quietly(work) {
            Ok(Ok(sums)) if sums == [2.0, 2.0] => Ok(()),
            Ok(Ok(sums)) => Err(broken(&format!("exp(0) + 1 = {sums:?}"))),
            Ok(Err(error)) => Err(broken(&format!("{error:?}"))),
            Err(panic) => Err(broken(&panic)),
        }
    }
}

/// Has CubeCL keep compiled kernels on disk, where it keeps its choice of kernels. By default it compiles all of them anew in every process.
/// Everything else is as the user's `cubecl.toml` and environment say.
#[cfg(feature = "tuned")]
fn keep_kernels() {
    use burn::cubecl::config::{CubeClRuntimeConfig, RuntimeConfig};
    static ONCE: std::sync::Once = std::sync::Once::new();
    ONCE.call_once(|| {
        let mut config = CubeClRuntimeConfig::from_current_dir().override_from_env();
        config.compilation.cache = true;
        // Another configuration that was read before stays.
        let _ = CubeClRuntimeConfig::try_set(config);
    });
}

/// Returns what `devices` lists of a device.
#[must_use]
pub fn describe(device: &Device) -> Found {
    let bf16 = computes_in_bf16(device);
    #[cfg(feature = "cubecl")]
    if let Some(identity) = device.identity() {
        return Found { name: identity.name, gpu: identity.physical.is_some(), bf16 };
    }
    let gpu = !on_processor(device);
    Found { name: if gpu { format!("{device:?}") } else { processor() }, gpu, bf16 }
}

/// Returns whether the device computes in bfloat16. Some devices only store it.
#[must_use]
pub fn computes_in_bf16(device: &Device) -> bool {
    device.supports_dtype(FloatDType::BF16)
}

/// Returns whether Burn's bilinear interpolation and GELU have their own gradients on the device, as they do on flex (Burn 0.22.1).
/// On ndarray and CubeCL, which computes on GPUs, the first panics, and the second is that of an approximation by tanh, up to 9e-4 off.
#[must_use]
pub fn has_exact_gradients(device: &Device) -> bool {
    *device == Device::flex()
}

/// Returns whether the device is the processor, which is one device for all threads.
#[must_use]
#[allow(deprecated)] // as `enumerate`
pub fn on_processor(device: &Device) -> bool {
    let processors = [
        Device::flex(),
        #[cfg(feature = "ndarray")]
        Device::ndarray(),
    ];
    processors.contains(device)
}

fn processor() -> String {
    format!("CPU, {} threads", rayon::current_num_threads())
}

/// Returns the line of a message that says why: the first after its last "Caused by:", otherwise the first.
fn reason(message: &str) -> &str {
    let last = message.rsplit("Caused by:").next().unwrap_or(message);
    let line = last.lines().map(str::trim).find(|line| !line.is_empty()).unwrap_or("no reason given");
    line.trim_start_matches(|c: char| c.is_ascii_digit() || c == ':' || c == ' ')
}

/// Runs `work` and returns the message of a panic. The message is not printed.
fn quietly<T>(work: impl FnOnce() -> T) -> std::result::Result<T, String> {
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(|_| ()));
    let found = std::panic::catch_unwind(AssertUnwindSafe(work));
    std::panic::set_hook(hook);
    found.map_err(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        text.or_else(|| panic.downcast_ref::<&str>().map(|text| (*text).into())).unwrap_or_else(|| "a panic".into())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_processor_is_as_many_devices_as_are_asked_for() {
        let devices = Backend::Flex.devices(3).unwrap();
        assert!(devices.len() == 3 && devices.iter().all(|device| *device == Device::flex()));
        let found = Backend::Flex.found().unwrap();
        assert!(found.len() == 1 && !found[0].gpu && found[0].name.contains("threads"), "{found:?}");
    }

    #[test]
    fn a_backend_that_is_not_built_is_named_with_those_that_are() {
        for backend in Backend::ALL.into_iter().filter(|backend| !backend.is_built()) {
            let error = backend.device().unwrap_err().to_string();
            let feature = format!("build with `--features {}`", backend.name());
            assert!(error.contains(&feature) && error.contains("found: ") && error.contains("flex"), "{error}");
        }
    }

    #[test]
    fn names_are_those_of_records_and_of_the_command_line() {
        for backend in Backend::ALL {
            assert_eq!(serde_json::to_string(&backend).unwrap(), format!("\"{}\"", backend.name()));
        }
    }

    #[test]
    fn the_reason_of_a_chain_of_errors_is_its_last() {
        let chain = "reading failed\n\nCaused by:\n    0: an error\nCaused by:\n    no libdevice\n\nBacktrace:";
        assert_eq!(
            [reason(chain), reason("\nno driver\nmore"), reason("")],
            ["no libdevice", "no driver", "no reason given"]
        );
    }

    #[test]
    fn a_panic_becomes_its_message() {
        assert_eq!(quietly(|| -> u8 { panic!("no {}", "library") }), Err("no library".into()));
        assert_eq!(quietly(|| -> u8 { panic!("none") }), Err("none".into()));
        assert_eq!(quietly(|| 3), Ok(3));
    }
}
