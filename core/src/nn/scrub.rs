//! Compares a model with its checksums chunk by chunk, a few bytes at a time, in spare time.

use super::crc::Crc32c;
use super::file::RawModel;
use crate::part::part;

/// The position of an incremental check of the chunks.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Scrub {
    chunk: u32,
    offset: usize,
    crc: Crc32c,
}

impl Scrub {
    /// Returns the current chunk, the number of its bytes read, and their checksum.
    pub(super) fn position(&self) -> (u32, usize, u32) {
        (self.chunk, self.offset, self.crc.value())
    }

    /// Makes a check at this position; `None` if the file does not have it.
    pub(super) fn at(raw: &RawModel<'_>, chunk: u32, offset: usize, crc: u32) -> Option<Self> {
        let exists = chunk < raw.chunks().max(1) && offset <= raw.chunk(chunk).len();
        exists.then(|| Self { chunk, offset, crc: Crc32c::after(crc) })
    }

    /// Checks up to `max_bytes` further bytes. Returns how many were read, and whether a pass is complete.
    ///
    /// # Errors
    /// The chunk whose checksum does not match; the next call continues behind it.
    pub(super) fn advance(&mut self, raw: &RawModel<'_>, max_bytes: usize) -> Result<(usize, bool), u32> {
        let mut done = 0;
        while done < max_bytes {
            let chunk = raw.chunk(self.chunk);
            let take = (max_bytes - done).min(chunk.len().saturating_sub(self.offset));
            self.crc.update(part(chunk, self.offset, take));
            (self.offset, done) = (self.offset + take, done + take);
            if self.offset < chunk.len() {
                break;
            }
            let (index, good) = (self.chunk, self.crc.value() == raw.chunk_crc(self.chunk));
            let last = index + 1 >= raw.chunks();
            *self = Self { chunk: if last { 0 } else { index + 1 }, ..Self::default() };
            if !good {
                return Err(index);
            }
            if last {
                return Ok((done, true));
            }
        }
        Ok((done, false))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nn::file::CHUNK_BYTES;
    use crate::nn::tests::draft::Draft;

    #[test]
    fn every_chunk_is_compared_and_the_wrong_one_is_named() {
        let mut draft = Draft::new((4, 4));
        draft.constant(vec![3; 2 * CHUNK_BYTES]);
        draft.finish();
        draft.in_order();
        let file = draft.file();
        let body = RawModel::new(&file).unwrap().body_offset();
        for wrong in 0..3 {
            let mut file = file.clone();
            file[body + wrong * CHUNK_BYTES] ^= 1;
            let raw = RawModel::new(&file).unwrap();
            assert_eq!(raw.chunks(), 3);
            for piece in [1000, CHUNK_BYTES, usize::MAX] {
                let (mut scrub, mut passes, mut faults) = (Scrub::default(), 0, 0);
                for _ in 0..200 {
                    match scrub.advance(&raw, piece) {
                        Ok((done, pass)) => {
                            assert!(done <= piece, "{done} bytes read, at most {piece} asked for");
                            passes += pass as usize;
                        }
                        Err(chunk) => {
                            assert_eq!(chunk, wrong as u32);
                            faults += 1;
                        }
                    }
                }
                // A fault in the last chunk ends its pass.
                assert!(faults > 1 && (passes > 1 || wrong == 2), "{piece}: {faults} faults, {passes} passes");
            }
            let mut scrub = Scrub::default();
            assert_eq!(scrub.advance(&raw, 0), Ok((0, false)), "nothing is read for nothing");
        }
    }
}
