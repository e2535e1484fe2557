//! An exported model file as a model for the tile loop.

use super::network::{TileModel, TileNetwork};
use elunar_base::digest::sha256_hex;
use elunar_base::{Error, Result};
use elunar_core::nn::file::{RawModel, word};
use elunar_core::nn::{self, InputRules, Kernel, Progress, Runner, Verdict, required};
use elunar_core::tile::Shape;
use elunar_net::export::large_steps::{LINE, large_steps};
use elunar_net::{kernels, shipped};
use std::path::Path;

/// Multiply-accumulates per step of the runner. The value is large, because no watchdog runs on the ground.
const STEP_MACS: u64 = 1 << 28;

/// One tile of so many looks for changed memory, which takes a tenth of a tile's time (our choice: memory in flight changes, that of the ground
/// hardly ever).
const PROTECTED_EVERY: u64 = 32;

/// A validated `.eld` file in memory.
pub struct Int8Model {
    kernel: Kernel,
    bytes: LineBytes,
    verdict: Verdict,
    description: String,
    protected_every: u64,
}

/// Bytes of a model file whose constants begin a line of the cache, as AMX and AVX-512 like it.
struct LineBytes {
    padded: Vec<u8>,
    start: usize,
}

impl LineBytes {
    fn new(bytes: &[u8]) -> Self {
        let mut padded = vec![0; bytes.len() + LINE];
        let constants = RawModel::new(bytes).map_or(0, |raw| raw.word(word::CONSTANTS) as usize);
        let start = (LINE - (padded.as_ptr().addr() + constants) % LINE) % LINE;
        padded[start..start + bytes.len()].copy_from_slice(bytes);
        padded.truncate(start + bytes.len());
        Self { padded, start }
    }

    fn get(&self) -> &[u8] {
        &self.padded[self.start..]
    }
}

/// Opens a model, a shipped one ([`elunar_net::shipped`]) or a file, and validates all of it.
///
/// # Errors
/// [`Error::Io`] if it cannot be read, [`Error::Broken`] if any byte or record is not valid.
pub fn open(path: &Path) -> Result<Int8Model> {
    let (name, bytes) = shipped::model(path)?;
    let verdict = nn::Model::new(&bytes).map_err(|e| Error::broken(path, e.to_string()))?.verdict();
    let hash = sha256_hex(&bytes);
    let bytes = LineBytes::new(&bytes);
    let description = format!("int8 network {name} sha256:{hash}");
    Ok(Int8Model { kernel: kernels::best(), bytes, verdict, description, protected_every: PROTECTED_EVERY })
}

impl Int8Model {
    /// Replaces the kernel. The default is the fastest kernel. Results are the same with every kernel; the speed differs.
    #[must_use]
    pub fn with_kernel(self, kernel: Kernel) -> Self {
        Self { kernel, ..self }
    }

    /// Returns the kernel.
    #[must_use]
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// Sets that of so many tiles of a thread one looks for changed memory ([`Runner::protect`]), the first among them; a model that has changed
    /// ends the run. The default is 32, as memory on the ground hardly ever changes; in flight it is 1.
    #[must_use]
    pub fn with_protected_every(self, tiles: u64) -> Self {
        Self { protected_every: tiles, ..self }
    }

    /// Replaces the file's steps by larger ones ([`large_steps`]): the same bytes, sooner, with more memory.
    ///
    /// # Errors
    /// As [`large_steps`].
    pub fn in_large_steps(self) -> Result<Self> {
        let bytes = large_steps(&self.model())?;
        let verdict = nn::Model::new(&bytes).map_err(|e| Error::input(format!("larger steps: {e}")))?.verdict();
        Ok(Self { bytes: LineBytes::new(&bytes), verdict, ..self })
    }

    /// Returns the validated model. Its bytes are validated when the file is opened, not again.
    ///
    /// # Panics
    /// Never: [`open`] has validated these bytes.
    pub fn model(&self) -> nn::Model<'_> {
        nn::Model::reopen(self.bytes.get(), &self.verdict).expect("validated when opened")
    }
}

impl TileModel for Int8Model {
    fn tile(&self) -> Shape {
        self.model().tile()
    }

    fn input_rules(&self) -> InputRules {
        self.model().input_rules()
    }

    fn description(&self) -> String {
        self.description.clone()
    }

    fn worker(&self) -> Result<Box<dyn TileNetwork + '_>> {
        let (model, &Self { kernel, protected_every, .. }) = (self.model(), self);
        Ok(Box::new(Worker { kernel, model, protected_every, arena: vec![0; required(&model) + LINE], tiles: 0 }))
    }
}

struct Worker<'a> {
    kernel: Kernel,
    model: nn::Model<'a>,
    protected_every: u64,
    arena: Vec<u8>,
    tiles: u64,
}

impl TileNetwork for Worker<'_> {
    fn predict(&mut self, image: &[f32], coarse: &[f32], output: &mut [f32]) -> Result<()> {
        let fault = |e: nn::RunError| Error::input(format!("int8 network: {e}"));
        // The arena begins a line of the cache, too.
        let start = self.arena.as_ptr().align_offset(LINE).min(LINE);
        let mut runner = Runner::with_kernel(self.kernel, self.model, &mut self.arena[start..]).map_err(fault)?;
        runner.protect(self.tiles.is_multiple_of(self.protected_every));
        self.tiles += 1;
        runner.begin(image, coarse).map_err(fault)?;
        while runner.step(STEP_MACS).map_err(fault)? == Progress::Running {}
        runner.output(output).map_err(fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first tile of a thread finds it, and so does one of so many; the others do not look.
    #[test]
    fn a_model_that_changes_in_memory_is_found() {
        let mut model = open(Path::new("nano")).unwrap().with_protected_every(2);
        let (pixels, rules) = (model.tile().pixels(), model.input_rules());
        let (image, coarse_m) = (vec![0.5; pixels * rules.illumination.image_maps()], vec![25.0; pixels]);
        let constants = RawModel::new(model.bytes.get()).unwrap().word(word::CONSTANTS) as usize;
        let at = model.bytes.start + constants + 1000;
        model.bytes.padded[at] ^= 1;
        let (mut worker, mut output) = (model.worker().unwrap(), vec![0.0; pixels]);
        let found = [(); 3].map(|()| worker.predict(&image, &coarse_m, &mut output).is_err());
        assert_eq!(found, [true, false, true]);
    }
}
