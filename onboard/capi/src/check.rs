//! The validation of a model in pieces: the caller keeps its position, and its result, as words under a checksum.

use crate::info;
use crate::layout::Layout;
use crate::sealed::{copy_bytes, decode, encode};
use crate::status::*;
use crate::types::{eld_check_t, eld_status_t};
use elunar_core::nn::file::{u32_at, word};
use elunar_core::nn::slots::ModelId;
use elunar_core::nn::{Model, Validation};

/// "ELDCHK" and its version.
const CHECK: u64 = u64::from_le_bytes(*b"ELDCHK\x00\x01");
/// Number of words: what binds them to the file, and those of the validation.
const WORDS: usize = 1 + Validation::WORDS;
/// Number of bytes with magic and checksum.
pub(crate) const CHECK_BYTES: usize = copy_bytes(WORDS);

/// Returns the length of a file and the checksum of its header, which depends on all other bytes.
fn identity(file: &[u8]) -> u64 {
    u64::from(u32_at(file, 4 * word::HEADER_CRC)) | (file.len() as u64) << 32
}

/// Returns the validation that is kept; a new one for zeros.
fn read(block: &[u8], file: &[u8]) -> Result<Validation, eld_status_t> {
    if block.iter().all(|byte| *byte == 0) {
        return Ok(Validation::default());
    }
    let mut words = [0; WORDS];
    let whole = decode(block, CHECK, &mut words);
    let [owner, position @ ..] = words;
    let validation = Validation::from_words(position).filter(|_| whole && owner == identity(file));
    validation.ok_or(ELD_FAULT_CHECK)
}

/// Validates a piece of a file; returns the model when all is done. After an error the words are zero.
pub(crate) fn go_on<'m>(
    block: &mut [u8],
    file: &'m [u8],
    budget_macs: u64,
) -> Result<Option<(Model<'m>, Layout)>, eld_status_t> {
    let worked = read(block, file).and_then(|mut validation| {
        let found = info::go_on(&mut validation, file, budget_macs)?;
        let mut words = [0; WORDS];
        let [owner, position @ ..] = &mut words;
        (*owner, *position) = (identity(file), validation.to_words());
        encode(block, CHECK, &words);
        Ok(found)
    });
    worked.inspect_err(|_| block.fill(0))
}

/// Returns the words of a finished validation.
pub(crate) fn of(validation: &Validation, id: ModelId) -> eld_check_t {
    let (mut words, mut block, mut out) = ([0; WORDS], [0; CHECK_BYTES], eld_check_t::default());
    let [owner, position @ ..] = &mut words;
    *owner = u64::from(id.header_crc) | u64::from(id.file_bytes) << 32;
    *position = validation.to_words();
    encode(&mut block, CHECK, &words);
    out.words.iter_mut().zip(block.as_chunks::<8>().0).for_each(|(to, bytes)| *to = u64::from_ne_bytes(*bytes));
    out
}

/// Opens a file whose validation is finished.
///
/// # Errors
/// [`ELD_REFUSED_NOT_CHECKED`], [`ELD_FAULT_CHECK`].
pub(crate) fn finished<'m>(block: &[u8], file: &'m [u8]) -> Result<(Model<'m>, Layout), eld_status_t> {
    let mut validation = read(block, file)?;
    if !validation.is_done() {
        return Err(ELD_REFUSED_NOT_CHECKED);
    }
    info::go_on(&mut validation, file, 1)?.ok_or(ELD_FAULT_CHECK)
}
