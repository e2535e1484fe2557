//! The whole file: magic, version, header, checksums, sections.
//!
//! ```text
//! byte 0    header, 32 little-endian u32 words (below); its last word is the CRC32C of the first 31
//!      128  per chunk of the body its CRC32C and its quick checksum (`sum.rs`); word 30 of the header is the CRC32C of this list
//!      ...  body, cut into chunks of CHUNK_BYTES (the last may be shorter): text, tensors, operators, schedule, constants
//! ```
//! Every byte of the file is under exactly one CRC, so any single flipped byte is refused. The quick checksums serve the comparison after
//! every tile. So do the seals: the last word of each record of a tensor, operator or entry is the quick checksum of its other words.

/// First eight bytes. As in PNG, a transfer that changes line ends or strips bit 7 destroys them.
pub const MAGIC: [u8; 8] = *b"\x89ELD\r\n\x1a\n";
/// Version of the format.
pub const VERSION: u32 = 4;
/// Bytes of the header.
pub const HEADER_BYTES: usize = 128;
/// Bytes under one checksum.
pub const CHUNK_BYTES: usize = 16 * 1024;
/// Bytes of the list of checksums per chunk.
pub const CHUNK_RECORD_BYTES: usize = 8;
/// Stands for "no such tensor or constant" in the file.
pub const NONE: u32 = u32::MAX;

/// Indices of the header words.
pub mod word {
    /// Format version.
    pub const VERSION: usize = 2;
    /// Bytes of the whole file.
    pub const FILE_BYTES: usize = 3;
    /// Bytes per chunk.
    pub const CHUNK_BYTES: usize = 4;
    /// Number of chunks.
    pub const CHUNKS: usize = 5;
    /// Descriptive JSON text: offset from the start of the file. The next word is its length in bytes.
    pub const TEXT: usize = 6;
    /// Tensor records: offset. The next word is their number.
    pub const TENSORS: usize = 8;
    /// Operator records: offset. The next word is their number.
    pub const OPERATORS: usize = 10;
    /// Constants: offset. The next word is their length in bytes.
    pub const CONSTANTS: usize = 12;
    /// Tile rows. The next word is the tile columns.
    pub const TILE: usize = 14;
    /// Upper end of the normalised elevation range, f32.
    pub const NR: usize = 16;
    /// Share by which the range of the coarse DTM is widened, f32.
    pub const RANGE_MARGIN: usize = 17;
    /// The range that normalised the truth: 0 the truth's own, 1 that of the coarse tile, 2 none (heights are counted in pixels).
    pub const TARGET_RANGE: usize = 18;
    /// Tensor that takes the image.
    pub const IMAGE: usize = 19;
    /// Tensor that takes the coarse DTM as codes, or NONE.
    pub const COARSE: usize = 20;
    /// Tensor that holds the result.
    pub const OUTPUT: usize = 22;
    /// Seed of the self-test tile.
    pub const SELF_TEST_SEED: usize = 23;
    /// CRC32C of the self test's output.
    pub const SELF_TEST_CRC: usize = 24;
    /// The light that the network knows: 0 any, 1 the Sun in the north-west quadrant of the grid, 2 as 1 and the image as the four maps of
    /// a guide.
    pub const ILLUMINATION: usize = 25;
    /// Schedule entries: offset. The next word is their number.
    pub const SCHEDULE: usize = 26;
    /// CRC32C of the checksum list.
    pub const LIST_CRC: usize = 30;
    /// CRC32C of the header's first 31 words.
    pub const HEADER_CRC: usize = 31;
}
