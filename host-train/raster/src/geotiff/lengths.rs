//! Lengths of strips and tiles that a file does not state, as libtiff finds them.
//!
//! Some programs leave StripByteCounts out, or write 0 for data that are there. Without compression the size gives the length; a compressed
//! single strip reaches to the end of the file. The decoder gets the amended directory behind the file's end ([`Overlaid`]).
//!
//! [`Overlaid`]: super::overlaid::Overlaid

use std::collections::BTreeMap;
use std::io::{Read, Result, Seek, SeekFrom};

/// Most entries of a directory, and most strips or tiles, that are looked at.
const MOST_ENTRIES: u64 = 1 << 12;
const MOST_CHUNKS: u64 = 1 << 24;

/// Tags of strips: offsets and lengths. Those of tiles follow.
const STRIPS: (u16, u16) = (273, 279);
const TILES: (u16, u16) = (324, 325);

/// Returns the bytes that replace those of a file of `file_bytes`, by their offsets: none if all lengths are stated. What is no TIFF, or
/// broken, is left to the decoder.
pub(super) fn amended(file: &mut (impl Read + Seek), file_bytes: u64) -> Result<Vec<(u64, Vec<u8>)>> {
    let Some(directory) = Directory::read(file)? else { return Ok(vec![]) };
    let lengths = directory.lengths(file, file_bytes)?;
    Ok(lengths.and_then(|(tag, lengths)| directory.with(tag, &lengths, file_bytes)).unwrap_or_default())
}

/// The first directory of a file, as stored.
struct Directory {
    little: bool,
    /// BigTIFF.
    big: bool,
    /// By tag: type, count, and the bytes of the value or of its offset.
    entries: BTreeMap<u16, (u16, u64, Vec<u8>)>,
    /// Offset of the next directory, as stored.
    next: Vec<u8>,
}

impl Directory {
    fn read(file: &mut (impl Read + Seek)) -> Result<Option<Self>> {
        let mut head = [0; 16];
        file.rewind()?;
        let mut found = 0;
        while found < head.len() {
            match file.read(&mut head[found..])? {
                0 => return Ok(None),
                more => found += more,
            }
        }
        let (little, big) = match &head[..4] {
            b"II*\0" => (true, false),
            b"MM\0*" => (false, false),
            b"II+\0" => (true, true),
            b"MM\0+" => (false, true),
            _ => return Ok(None),
        };
        let (mut directory, word) =
            (Self { little, big, entries: BTreeMap::new(), next: vec![] }, 4 + 4 * usize::from(big));
        let start = directory.number(&head[word..2 * word]);
        let Some(count) = read_at(file, start, if big { 8 } else { 2 })? else { return Ok(None) };
        let (count, count_bytes) = (directory.number(&count), count.len() as u64);
        if count > MOST_ENTRIES {
            return Ok(None);
        }
        let entry_bytes = 4 + 2 * word;
        let Some(bytes) = read_at(file, start + count_bytes, count as usize * entry_bytes + word)? else {
            return Ok(None);
        };
        let (entries, next) = bytes.split_at(bytes.len() - word);
        for entry in entries.chunks_exact(entry_bytes) {
            let (tag, kind) = (directory.number(&entry[..2]) as u16, directory.number(&entry[2..4]) as u16);
            let count = directory.number(&entry[4..4 + word]);
            directory.entries.insert(tag, (kind, count, entry[4 + word..].to_vec()));
        }
        directory.next = next.to_vec();
        Ok(Some(directory))
    }

    fn number(&self, bytes: &[u8]) -> u64 {
        let each = |number: u64, &byte: &u8| number << 8 | u64::from(byte);
        if self.little { bytes.iter().rev().fold(0, each) } else { bytes.iter().fold(0, each) }
    }

    fn bytes(&self, number: u64, length: usize) -> Vec<u8> {
        if self.little { number.to_le_bytes()[..length].into() } else { number.to_be_bytes()[8 - length..].into() }
    }

    /// Returns the numbers of a tag; `None` if it is absent, or holds something else.
    fn numbers(&self, file: &mut (impl Read + Seek), tag: u16) -> Result<Option<Vec<u64>>> {
        let Some((kind, count, value)) = self.entries.get(&tag) else { return Ok(None) };
        let size = match kind {
            3 => 2,
            4 | 13 => 4,
            16 => 8,
            _ => return Ok(None),
        };
        if *count > MOST_CHUNKS {
            return Ok(None);
        }
        let length = *count as usize * size;
        let bytes = match value.get(..length) {
            Some(bytes) => Some(bytes.to_vec()),
            None => read_at(file, self.number(value), length)?,
        };
        Ok(bytes.map(|bytes| bytes.chunks_exact(size).map(|bytes| self.number(bytes)).collect()))
    }

    /// Returns the tag of the lengths and all lengths, if some had to be found. Those that cannot be found are 0.
    fn lengths(&self, file: &mut (impl Read + Seek), file_bytes: u64) -> Result<Option<(u16, Vec<u64>)>> {
        let tiled = self.entries.contains_key(&TILES.0);
        let (at, long) = if tiled { TILES } else { STRIPS };
        let Some(offsets) = self.numbers(file, at)? else { return Ok(None) };
        let stated = self.numbers(file, long)?;
        if stated.is_none() && self.entries.contains_key(&long) {
            return Ok(None);
        }
        let lengths = stated.clone().unwrap_or_else(|| vec![0; offsets.len()]);
        let plain = self.first(file, 259, 1)? == 1;
        let (Some(sizes), true) = (self.sizes(file, offsets.len(), tiled)?, lengths.len() == offsets.len()) else {
            return Ok(None);
        };
        let single = offsets.len() == 1;
        let looks_bad = |i: usize| {
            let stated_of_all = plain && single && !tiled;
            let wrong = lengths[i] < sizes[i] || offsets[i].saturating_add(lengths[i]) > file_bytes;
            offsets[i] != 0 && (lengths[i] == 0 || stated_of_all && wrong)
        };
        let mut sorted = offsets.clone();
        sorted.sort_unstable();
        // Data that would reach into those of others are somewhere else.
        let alone = |i: usize| {
            let others = &sorted[sorted.partition_point(|&other| other < offsets[i])..];
            others.get(1).is_none_or(|&next| offsets[i].saturating_add(sizes[i]) <= next)
        };
        let found = |i: usize| match (looks_bad(i), plain) {
            (false, _) => lengths[i],
            (true, true) if alone(i) => sizes[i],
            (true, false) if single => file_bytes.saturating_sub(offsets[i]),
            _ => 0,
        };
        let found: Vec<u64> = (0..offsets.len()).map(found).collect();
        Ok((stated.as_ref() != Some(&found)).then_some((long, found)))
    }

    fn first(&self, file: &mut (impl Read + Seek), tag: u16, default: u64) -> Result<u64> {
        Ok(self.numbers(file, tag)?.and_then(|numbers| numbers.first().copied()).unwrap_or(default))
    }

    /// Returns the bytes of `chunks` strips or tiles without compression; `None` if tags are missing or out of range.
    fn sizes(&self, file: &mut (impl Read + Seek), chunks: usize, tiled: bool) -> Result<Option<Vec<u64>>> {
        let (cols, rows) = (self.first(file, 256, 0)?, self.first(file, 257, 0)?);
        let samples = if self.first(file, 284, 1)? == 2 { 1 } else { self.first(file, 277, 1)? };
        let bits = self.first(file, 258, 1)?.saturating_mul(samples);
        let size = |rows: u64, cols: u64| cols.checked_mul(bits)?.div_ceil(8).checked_mul(rows);
        if tiled {
            let (cols, rows) = (self.first(file, 322, 0)?, self.first(file, 323, 0)?);
            return Ok(size(rows, cols).map(|size| vec![size; chunks]));
        }
        let each = self.first(file, 278, rows)?.min(rows);
        if each == 0 {
            return Ok(None);
        }
        let strips = rows.div_ceil(each);
        Ok((0..chunks as u64).map(|strip| size(each.min(rows - strip % strips * each), cols)).collect())
    }

    /// Returns the header's offset and this directory with other lengths; `None` beyond 4 GiB of a classic file.
    fn with(&self, tag: u16, lengths: &[u64], file_bytes: u64) -> Option<Vec<(u64, Vec<u8>)>> {
        let (word, kind) = if self.big { (8, 16) } else { (4, 4) };
        let at = file_bytes.next_multiple_of(8);
        let mut entries = self.entries.clone();
        entries.insert(tag, (kind, lengths.len() as u64, vec![]));
        let values_at = at + (if self.big { 8 } else { 2 } + entries.len() * (4 + 2 * word) + word) as u64;
        let values: Vec<u8> = lengths.iter().flat_map(|&length| self.bytes(length, word)).collect();
        if !self.big && lengths.iter().chain([&values_at]).any(|&number| u32::try_from(number).is_err()) {
            return None;
        }
        let is_inline = lengths.len() == 1;
        entries.get_mut(&tag)?.2 = if is_inline { values.clone() } else { self.bytes(values_at, word) };
        let mut bytes = self.bytes(entries.len() as u64, if self.big { 8 } else { 2 });
        for (tag, (kind, count, value)) in &entries {
            bytes.extend(
                [self.bytes((*tag).into(), 2), self.bytes((*kind).into(), 2), self.bytes(*count, word)].concat(),
            );
            bytes.extend(value);
        }
        bytes.extend(&self.next);
        bytes.extend(values);
        Some(vec![(word as u64, self.bytes(at, word)), (at, bytes)])
    }
}

/// Reads `length` bytes; `None` if the file ends before.
fn read_at(file: &mut (impl Read + Seek), at: u64, length: usize) -> Result<Option<Vec<u8>>> {
    if i64::try_from(at).is_err() {
        return Ok(None);
    }
    file.seek(SeekFrom::Start(at))?;
    let mut bytes = vec![];
    file.take(length as u64).read_to_end(&mut bytes)?;
    Ok((bytes.len() == length).then_some(bytes))
}
