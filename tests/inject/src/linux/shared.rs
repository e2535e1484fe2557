//! Memory that a process and those that it is copied into have in common: what a disturbed tile became.
#![allow(unsafe_code)] // a mapping

use elunar_base::{Error, Result};
use nix::sys::mman::{MapFlags, ProtFlags, mmap_anonymous};
use std::num::NonZeroUsize;
use std::ptr::NonNull;
use std::sync::atomic::{AtomicU64, Ordering::SeqCst};

/// Most bytes of an error's text.
const TEXT_BYTES: usize = 200;

/// What is written first, before heights and bits.
#[repr(C)]
pub(crate) struct Head {
    /// Number of the unit at work.
    pub(crate) unit: AtomicU64,
    /// An address of the stack of the library's caller, while the library works.
    pub(crate) caller: AtomicU64,
    /// Checksum of all memory behind the disturbed unit; 0 before.
    pub(crate) state: AtomicU64,
    /// [`RUNNING`], [`DONE`] or [`REPORTED`].
    pub(crate) end: AtomicU64,
    text: [u8; TEXT_BYTES],
}

/// The tile is in progress.
pub(crate) const RUNNING: u64 = 0;
/// Heights and bits are written.
pub(crate) const DONE: u64 = 1;
/// The text of an error is written.
pub(crate) const REPORTED: u64 = 2;

/// The common memory.
pub(crate) struct Shared {
    head: NonNull<Head>,
    pixels: usize,
}

impl Shared {
    /// Maps memory for a tile of `pixels`.
    ///
    /// # Errors
    /// If there is none.
    pub(crate) fn new(pixels: usize) -> Result<Self> {
        let bytes = size_of::<Head>() + 4 * pixels + pixels.div_ceil(8);
        let length = NonZeroUsize::new(bytes).ok_or_else(|| Error::input("inject: a tile without pixels"))?;
        // SAFETY: new memory, anywhere.
        let map =
            unsafe { mmap_anonymous(None, length, ProtFlags::PROT_READ | ProtFlags::PROT_WRITE, MapFlags::MAP_SHARED) };
        let head = map.map_err(|e| Error::input(format!("inject: memory of two processes: {e}")))?.cast();
        Ok(Self { head, pixels })
    }

    /// Returns the head.
    pub(crate) fn head(&self) -> &Head {
        // SAFETY: mapped and never unmapped; zeros are a legal head.
        unsafe { self.head.as_ref() }
    }

    #[expect(clippy::mut_from_ref, reason = "another process writes it, too")]
    fn bytes(&self, offset: usize, count: usize) -> &mut [u8] {
        // SAFETY: within the mapping; the other process is stopped or has ended whenever this one reads.
        unsafe { std::slice::from_raw_parts_mut(self.head.as_ptr().cast::<u8>().add(offset), count) }
    }

    /// Forgets the last tile.
    pub(crate) fn clear(&self) {
        self.head().state.store(0, SeqCst);
        self.head().end.store(RUNNING, SeqCst);
    }

    /// Writes a finished tile.
    pub(crate) fn write(&self, heights_m: &[f32], valid: &[u8]) {
        let to = self.bytes(size_of::<Head>(), 4 * self.pixels);
        to.as_chunks_mut().0.iter_mut().zip(heights_m).for_each(|(to, z)| *to = z.to_le_bytes());
        let to = self.bytes(size_of::<Head>() + 4 * self.pixels, self.pixels.div_ceil(8));
        to.iter_mut().zip(valid).for_each(|(to, from)| *to = *from);
        self.head().end.store(DONE, SeqCst);
    }

    /// Writes an error.
    pub(crate) fn write_error(&self, text: &str) {
        let to = self.bytes(std::mem::offset_of!(Head, text), TEXT_BYTES);
        to.fill(0);
        to.iter_mut().zip(text.as_bytes()).for_each(|(to, from)| *to = *from);
        self.head().end.store(REPORTED, SeqCst);
    }

    /// Returns the heights and the bits of valid ones.
    pub(crate) fn read(&self) -> (Vec<f32>, Vec<u8>) {
        let heights = self.bytes(size_of::<Head>(), 4 * self.pixels);
        let valid = self.bytes(size_of::<Head>() + 4 * self.pixels, self.pixels.div_ceil(8));
        (heights.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect(), valid.to_vec())
    }

    /// Returns the error.
    pub(crate) fn read_error(&self) -> String {
        let text = self.bytes(std::mem::offset_of!(Head, text), TEXT_BYTES);
        String::from_utf8_lossy(text).trim_end_matches('\0').to_string()
    }
}
