//! A file with some of its bytes replaced, and others behind its end. The file itself stays as it is.

use crate::bytes::Bytes;
use std::io::{BufReader, Read, Result, Seek, SeekFrom};

/// An open file under pieces of bytes at their offsets. Pieces do not overlap.
pub(super) struct Overlaid {
    file: BufReader<Bytes>,
    pieces: Vec<(u64, Vec<u8>)>,
    /// Position, if there are pieces.
    at: u64,
}

impl Overlaid {
    pub(super) fn new(file: Bytes, mut pieces: Vec<(u64, Vec<u8>)>) -> Self {
        pieces.sort_unstable();
        Self { file: BufReader::new(file), pieces, at: 0 }
    }

    /// Returns the file itself.
    pub(super) fn bytes(&self) -> &Bytes {
        self.file.get_ref()
    }
}

impl Read for Overlaid {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        if self.pieces.is_empty() {
            return self.file.read(out);
        }
        let at = self.at;
        let next = self.pieces.iter().find(|(start, bytes)| at < start + bytes.len() as u64);
        let read = match next {
            Some((start, bytes)) if *start <= at => (&bytes[(at - start) as usize..]).read(out)?,
            other => {
                let room = other.map_or(u64::MAX, |(start, _)| start - at);
                let most = usize::try_from(room).unwrap_or(usize::MAX).min(out.len());
                self.file.seek(SeekFrom::Start(at))?;
                self.file.read(&mut out[..most])?
            }
        };
        self.at += read as u64;
        Ok(read)
    }
}

impl Seek for Overlaid {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        if self.pieces.is_empty() {
            return self.file.seek(to);
        }
        self.at = match to {
            SeekFrom::Start(at) => at,
            SeekFrom::Current(by) => self.at.saturating_add_signed(by),
            SeekFrom::End(by) => self.file.get_ref().length()?.saturating_add_signed(by),
        };
        Ok(self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn pieces_hide_the_file_and_follow_it() {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(b"0123456789").unwrap();
        file.rewind().unwrap();
        let pieces = vec![(12, b"yz".to_vec()), (2, b"ab".to_vec())];
        let mut all = Overlaid::new(Bytes::File(file), pieces);
        let mut head = [0; 10];
        all.read_exact(&mut head).unwrap();
        assert_eq!(&head, b"01ab456789");
        let mut two = [0; 2];
        all.seek(SeekFrom::Start(12)).unwrap();
        all.read_exact(&mut two).unwrap();
        assert_eq!(&two, b"yz");
        all.seek(SeekFrom::Current(-11)).unwrap();
        all.read_exact(&mut two).unwrap();
        assert_eq!(&two, b"ba".map(|b| if b == b'b' { b'b' } else { b'4' }).as_slice());
        assert_eq!(all.seek(SeekFrom::End(-1)).unwrap(), 9);
    }
}
