//! Named float tensors as in a file. The Burn network, the checker and the exporter exchange weights in this form.

use elunar_base::{Error, Result, read};
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

/// One tensor, row-major, in the reference's (PyTorch) layout: linear `[out, in]`, convolution `[out, in, kh, kw]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    /// Extents, slowest axis first.
    pub shape: Vec<usize>,
    /// Samples. Their number is `shape.iter().product()`.
    pub data: Vec<f32>,
}

/// Tensors by interchange name, plus the file's string metadata (`config` holds [`super::config::NetConfig`] as JSON).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct NetWeights {
    /// Tensors by name, e.g. `decoder.0.main.0.conv.weight`.
    pub tensors: BTreeMap<String, Array>,
    /// Free text by key.
    pub metadata: BTreeMap<String, String>,
}

impl NetWeights {
    /// Reads a safetensors file of f32 tensors. Integer tensors (index buffers, batch counters of PyTorch state dicts) are left out.
    ///
    /// # Errors
    /// [`Error::Io`] if unreadable, [`Error::Broken`] if the format is violated, [`Error::Unsupported`] for other sample types.
    pub fn read(path: &Path) -> Result<Self> {
        let bytes = read::bytes(path, read::MOST_WEIGHTS_BYTES)?;
        Self::from_bytes(path, &bytes)
    }

    /// Reads the file from memory, as [`Self::read`]. Messages call it `path`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn from_bytes(path: &Path, bytes: &[u8]) -> Result<Self> {
        let bad = |e: safetensors::SafeTensorError| Error::broken(path, format!("expected a safetensors file: {e}"));
        let (_, header) = SafeTensors::read_metadata(bytes).map_err(bad)?;
        let file = SafeTensors::deserialize(bytes).map_err(bad)?;
        let mut tensors = BTreeMap::new();
        for (name, view) in file.tensors() {
            if matches!(view.dtype(), Dtype::I32 | Dtype::I64) {
                continue;
            }
            if view.dtype() != Dtype::F32 {
                let what = format!("tensor {name}: expected F32 samples, found {:?}", view.dtype());
                return Err(Error::unsupported(path, what));
            }
            let data = view.data().chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
            tensors.insert(name, Array { shape: view.shape().to_vec(), data });
        }
        let metadata = header.metadata().clone().unwrap_or_default().into_iter().collect();
        Ok(Self { tensors, metadata })
    }

    /// Adds the numbers of another file, tensor by tensor. The metadata stay.
    ///
    /// # Errors
    /// A text with what was expected, if names or shapes differ. Some tensors may already have been added.
    pub fn add(&mut self, other: &Self) -> std::result::Result<(), String> {
        if let Some(name) = other.tensors.keys().find(|name| !self.tensors.contains_key(*name)) {
            return Err(format!("{name}: expected no such tensor"));
        }
        for (name, sum) in &mut self.tensors {
            let more = other.tensors.get(name).filter(|more| more.shape == sum.shape);
            let more = more.ok_or_else(|| format!("{name}: expected {:?}", sum.shape))?;
            sum.data.iter_mut().zip(&more.data).for_each(|(a, b)| *a += b);
        }
        Ok(())
    }

    /// Returns the bytes of the file.
    pub fn to_bytes(&self) -> Vec<u8> {
        let raw: Vec<(&String, Vec<usize>, Vec<u8>)> = self
            .tensors
            .iter()
            .map(|(name, a)| (name, a.shape.clone(), a.data.iter().flat_map(|v| v.to_le_bytes()).collect()))
            .collect();
        let views = raw.iter().map(|(name, shape, bytes)| {
            (name.as_str(), TensorView::new(Dtype::F32, shape.clone(), bytes).expect("length follows from the shape"))
        });
        let metadata: HashMap<String, String> = self.metadata.clone().into_iter().collect();
        safetensors::serialize(views, Some(metadata)).expect("names and shapes are plain")
    }

    /// Writes a safetensors file, whole or not at all. A temporary file beside it is written, then renamed.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        elunar_base::atomic_write(path, &self.to_bytes())
    }
}
