//! A reader made from the page alone, except for the magic and, at the end, the results of the code.

use crate::pages::{repository, section, table};
use crate::{number, numbered, page};
use elunar_core::nn::Model;
use elunar_core::nn::file::MAGIC;
use std::collections::BTreeMap;

/// Computes CRC32C, bit by bit, with the polynomial of section 1.4.
fn crc(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0u32, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0x82f6_3b78 } else { 0 })
    })
}

/// Computes `seal` of section 1.4.
fn seal(words: &[u32]) -> u32 {
    words.iter().fold(0x9e37_79b1, |h, word| {
        let h = (h ^ word).wrapping_mul(0x9e37_79b1);
        h ^ h >> 15
    })
}

/// Computes the fourth number of an entry, of section 1.4.
pub(crate) fn entry_seal(halves: [u16; 3]) -> u16 {
    let s = seal(&halves.map(u32::from));
    (s ^ s >> 16) as u16
}

/// Computes the quick checksum of section 1.4.
fn quick(bytes: &[u8]) -> u32 {
    let mut lanes = [0u32; 16];
    for block in bytes.chunks(64) {
        let mut filled = [0; 64];
        filled[..block.len()].copy_from_slice(block);
        for (lane, word) in lanes.iter_mut().zip(filled.as_chunks().0) {
            *lane = lane.rotate_left(1).wrapping_add(u32::from_le_bytes(*word));
        }
    }
    let mut words = lanes.to_vec();
    words.push(bytes.len() as u32);
    seal(&words)
}

/// A file that is read with the page's numbers alone.
struct Reader<'a> {
    bytes: &'a [u8],
    words: BTreeMap<String, u64>,
    constants: BTreeMap<String, u64>,
}

impl<'a> Reader<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        let words = numbered("1.3 Header").into_iter().map(|(word, name)| (name, word)).collect();
        let constants = table(section(&page(), "1.1 Constants"));
        let constants = constants.into_iter().map(|row| (row[0].clone(), number(&row[1]))).collect();
        Self { bytes, words, constants }
    }

    fn u32_at(&self, offset: usize) -> u32 {
        u32::from_le_bytes(self.bytes[offset..offset + 4].try_into().unwrap())
    }

    fn word(&self, name: &str) -> usize {
        self.u32_at(4 * self.words[name] as usize) as usize
    }

    fn constant(&self, name: &str) -> usize {
        self.constants[name] as usize
    }

    /// Returns the records of a section, as words.
    fn records(&self, name: &str, size: &str) -> Vec<Vec<u32>> {
        let (start, count, size) = (self.word(name), self.word(&format!("{name} + 1")), self.constant(size));
        let record = |i: usize| (0..size / 4).map(|w| self.u32_at(start + i * size + 4 * w)).collect();
        (0..count).map(record).collect()
    }

    /// Runs steps 1 and 2 of section 1.13; returns the number of chunks.
    fn integrity(&self) -> Result<usize, &'static str> {
        let holds = |holds: bool, what: &'static str| if holds { Ok(()) } else { Err(what) };
        let (header, chunk) = (self.constant("HEADER_BYTES"), self.constant("CHUNK_BYTES"));
        holds(self.bytes[..8] == [0x89, 0x45, 0x4c, 0x44, 0x0d, 0x0a, 0x1a, 0x0a], "magic")?;
        holds(self.word("VERSION") == self.constant("VERSION"), "version")?;
        holds(crc(&self.bytes[..4 * self.words["HEADER_CRC"] as usize]) == self.word("HEADER_CRC") as u32, "header")?;
        holds(self.word("FILE_BYTES") == self.bytes.len() && self.word("CHUNK_BYTES") == chunk, "length")?;
        let chunks = self.word("CHUNKS");
        let body = header + self.constant("CHUNK_RECORD_BYTES") * chunks;
        holds(chunks == (self.bytes.len() - body).div_ceil(chunk), "chunks")?;
        holds(crc(&self.bytes[header..body]) == self.word("LIST_CRC") as u32, "list")?;
        for (i, bytes) in self.bytes[body..].chunks(chunk).enumerate() {
            let at = header + self.constant("CHUNK_RECORD_BYTES") * i;
            holds(crc(bytes) == self.u32_at(at) && quick(bytes) == self.u32_at(at + 4), "chunk")?;
        }
        Ok(chunks)
    }
}

#[test]
fn a_reader_made_of_the_page_reads_the_shipped_model() {
    let bytes = std::fs::read(repository().join("host-train/models/nano.eld")).unwrap();
    let reader = Reader::new(&bytes);
    assert_eq!(crc(b"123456789"), 0xe306_9283);
    assert!(page().contains("0x82f63b78") && page().contains("0xe3069283") && page().contains("0x9e3779b1"));
    assert_eq!(bytes[..8], MAGIC);
    let chunks = reader.integrity().unwrap();
    for spare in [21, 28, 29] {
        assert_eq!(reader.u32_at(4 * spare), 0);
    }

    let (tensors, operators) =
        (reader.records("TENSORS", "TENSOR_BYTES"), reader.records("OPERATORS", "OPERATOR_BYTES"));
    for record in tensors.iter().chain(&operators) {
        let (last, rest) = record.split_last().unwrap();
        assert_eq!(*last, seal(rest));
    }
    let field: BTreeMap<String, usize> =
        numbered("1.5 Tensor").into_iter().map(|(word, name)| (name, word as usize)).collect();
    let mut sums = 0;
    for t in &tensors {
        let of = |name: &str| t[field[name]];
        assert_eq!(of("sums"), sums);
        sums += of("ring");
        let bytes = [1, 2, 4][of("dtype") as usize];
        assert!(of("pitch") >= (of("cols") + 2 * of("margin")) * of("channels") * bytes);
    }
    let (image, output) = (&tensors[reader.word("IMAGE")], &tensors[reader.word("OUTPUT")]);
    assert_eq!([image[1], image[2]], [reader.word("TILE") as u32, reader.word("TILE + 1") as u32]);
    assert_eq!(output[field["dtype"]], 2);
    assert!(operators.iter().all(|operator| (1..=4).contains(&operator[0])));
    assert_eq!(operators.last().unwrap()[1] as usize, reader.word("OUTPUT"));

    let entries = reader.records("SCHEDULE", "ENTRY_BYTES");
    let mut done = vec![0; operators.len()];
    for entry in &entries {
        let [operator, first, count] = [entry[0] as u16, (entry[0] >> 16) as u16, entry[1] as u16];
        assert_eq!((entry[1] >> 16) as u16, entry_seal([operator, first, count]));
        assert_eq!(done[operator as usize], first);
        done[operator as usize] += count;
    }
    assert!(done.iter().all(|steps| *steps > 0));
    let text = &bytes[reader.word("TEXT")..][..reader.word("TEXT + 1")];
    assert_eq!(text[0], b'{');

    // The code gets the same results.
    let model = Model::new(&bytes).unwrap();
    assert_eq!((model.raw().chunks() as usize, model.sum_count()), (chunks, sums as usize));
    assert_eq!(
        (model.tensor_count(), model.operator_count(), model.entry_count()),
        (tensors.len(), operators.len(), entries.len())
    );
    println!("{} tensors, {} operators, {} entries, {chunks} chunks", tensors.len(), operators.len(), entries.len());
}

#[test]
fn the_reader_of_the_page_refuses_what_has_changed() {
    let bytes = std::fs::read(repository().join("host-train/models/nano.eld")).unwrap();
    for at in [0, 8, 57, 127, 128, 1000, 2700, 3_000_000, bytes.len() - 1] {
        let mut changed = bytes.clone();
        changed[at] ^= 4;
        assert!(Reader::new(&changed).integrity().is_err(), "byte {at}");
    }
}
