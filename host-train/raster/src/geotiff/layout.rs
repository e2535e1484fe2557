//! Layout of the samples in a file: sizes, chunks (strips or tiles), and a check that the file can hold them.

use super::handle::Handle;
use super::plain::SampleKind;
use elunar_base::Result;
use std::ops::Range;
use tiff::ColorType;
use tiff::decoder::{ChunkType, Limits};
use tiff::tags::{CompressionMethod, PhotometricInterpretation, PlanarConfiguration, Predictor, SampleFormat, Tag};

/// Deflate and LZW cannot shrink data more than about 1000 and 2700 times. A file that claims more is damaged or hostile.
const MOST_COMPRESSION: u64 = 4096;

/// ZSTD stores 128 KiB of one value in 4 bytes.
const MOST_COMPRESSION_ZSTD: u64 = 1 << 15;

/// Memory that the decoder may always use, bytes. Tags need some, too.
const SMALL_BYTES: usize = 1 << 22;

/// Greatest number of pixels of a strip or tile that must be decoded whole: 64 MiB of samples (our choice), 4096 x 4096. A single
/// strip of Deflate or ZSTD could otherwise take a thousand times the file's size, and more.
pub(super) const MOST_CHUNK_PX: usize = 1 << 24;

/// FillOrder of bytes whose lowest bit is the first.
const FILL_FROM_LOWEST: u16 = 2;

/// Rows of plain files are read together up to this many bytes.
const PLAIN_BYTES: usize = 1 << 20;

/// Returns the name of a supported compression; `None` for another.
fn readable(method: CompressionMethod) -> Option<&'static str> {
    Some(match method {
        CompressionMethod::None => "uncompressed",
        CompressionMethod::LZW => "LZW",
        CompressionMethod::ModernJPEG => "JPEG",
        CompressionMethod::Deflate | CompressionMethod::OldDeflate => "Deflate",
        CompressionMethod::PackBits => "PackBits",
        CompressionMethod::ZSTD => "ZSTD",
        _ => return None,
    })
}

/// Returns the name of an unsupported compression, for the error message.
fn refused(method: CompressionMethod) -> String {
    let name = match method {
        CompressionMethod::Huffman | CompressionMethod::Fax3 | CompressionMethod::Fax4 => "CCITT",
        CompressionMethod::JPEG => "old JPEG",
        CompressionMethod::WebP => "WEBP",
        // The `tiff` crate has no names for these.
        CompressionMethod::Unknown(34712) => "JPEG 2000",
        CompressionMethod::Unknown(34887) => "LERC",
        CompressionMethod::Unknown(34925) => "LZMA",
        CompressionMethod::Unknown(50002) => "JPEG XL",
        other => return format!("compression {}", other.to_u16()),
    };
    format!("{name} compression")
}

/// Sizes of a file and its chunks, pixels.
#[derive(Debug)]
pub(super) struct Layout {
    pub(super) rows: usize,
    pub(super) cols: usize,
    pub(super) chunk_rows: usize,
    pub(super) chunk_cols: usize,
    /// Number of chunks side by side.
    pub(super) across: usize,
    /// Number of chunks of a band.
    pub(super) chunks: usize,
    /// Number of chunks of the bands before.
    pub(super) chunks_before: usize,
    pub(super) sample_bytes: usize,
    /// The bytes of each chunk of the band in a file on the net.
    extents: Vec<Range<u64>>,
    /// Numbers of chunks that were never written (sparse files).
    pub(super) unwritten: Vec<usize>,
    /// Offset of the first sample of a plain file. Its chunks are groups of rows.
    pub(super) plain: Option<u64>,
    pub(super) kind: SampleKind,
    /// Description of the format.
    pub(super) format: String,
}

impl Layout {
    /// Reads and checks the layout of a band, counted from 0, or of a file's only band; then lets the decoder use as much memory as one chunk needs.
    pub(super) fn of(mut file: Handle, band: Option<usize>) -> Result<(Self, Handle)> {
        let dimensions = file.tiff.dimensions();
        let (cols, rows) = file.check(dimensions)?;
        let kind = sample_kind(&mut file, band)?;
        if file.unsigned::<u16>(Tag::FillOrder)? == Some(FILL_FROM_LOWEST) {
            return Err(file.unsupported("bits in reverse (FillOrder 2); FillOrder 1 expected (gdal_translate IN OUT)"));
        }
        let (compression, compression_name) = compression(&mut file)?;
        let (chunk_cols, chunk_rows) = file.tiff.chunk_dimensions();
        let tiled = matches!(file.tiff.get_chunk_type(), ChunkType::Tile);
        let (rows, cols, chunk_cols) = (rows as usize, cols as usize, chunk_cols as usize);
        // The stated rows of a strip may exceed the image's.
        let chunk_rows = if tiled { chunk_rows as usize } else { (chunk_rows as usize).min(rows) };
        if chunk_rows == 0 || chunk_cols == 0 {
            return Err(file.broken(format!("strips or tiles of {chunk_rows} x {chunk_cols} pixels")));
        }
        let across = cols.div_ceil(chunk_cols);
        let shape = match tiled {
            true => format!("tiles of {chunk_rows} x {chunk_cols}"),
            false => format!("strips of {chunk_rows} row{}", if chunk_rows == 1 { "" } else { "s" }),
        };
        let chunks = across * rows.div_ceil(chunk_rows);
        let mut layout = Self {
            rows,
            cols,
            chunk_rows,
            chunk_cols,
            across,
            chunks,
            chunks_before: band.unwrap_or(0) * chunks,
            sample_bytes: kind.bits as usize / 8,
            extents: vec![],
            unwritten: vec![],
            plain: None,
            kind,
            format: format!("GeoTIFF, {}{}, {shape}, {compression_name}", kind.letter, kind.bits),
        };
        layout.check_claims(&file, compression)?;
        let file = layout.with_limits(file);
        let mut file = layout.check_table(file, tiled, compression == CompressionMethod::None)?;
        // Prediction without compression is legal, though useless.
        if file.unsigned::<u16>(Tag::Predictor)?.is_some_and(|predictor| predictor != Predictor::None.to_u16()) {
            layout.plain = None;
        }
        if layout.plain.is_some() {
            layout.chunk_rows = (PLAIN_BYTES / (cols * layout.sample_bytes)).clamp(1, rows);
            layout.chunks = rows.div_ceil(layout.chunk_rows);
        }
        layout.check_chunk(&file, tiled)?;
        Ok((layout, file))
    }

    /// Returns the pixels of a chunk within the image: (first row, first column, rows, columns).
    pub(super) fn place(&self, chunk: usize) -> (usize, usize, usize, usize) {
        let (row, col) = (chunk / self.across * self.chunk_rows, chunk % self.across * self.chunk_cols);
        (row, col, self.chunk_rows.min(self.rows - row), self.chunk_cols.min(self.cols - col))
    }

    /// Returns the bytes of a chunk in the file.
    pub(super) fn extent(&self, chunk: usize) -> Range<u64> {
        let Some(start) = self.plain else { return self.extents.get(chunk).cloned().unwrap_or_default() };
        let first = start + (chunk * self.chunk_rows * self.cols * self.sample_bytes) as u64;
        first..first + self.rows_bytes(chunk)
    }

    /// Returns the number of bytes of a strip's rows.
    fn rows_bytes(&self, strip: usize) -> u64 {
        (self.place(strip).2 * self.cols * self.sample_bytes) as u64
    }

    fn chunk_bytes(&self) -> usize {
        self.chunk_rows.saturating_mul(self.chunk_cols).saturating_mul(self.sample_bytes)
    }

    /// Refuses chunks that would take too much memory. Rows of plain files are read one by one, whatever their strips.
    fn check_chunk(&self, file: &Handle, tiled: bool) -> Result<()> {
        let found = self.chunk_rows.saturating_mul(self.chunk_cols);
        if self.plain.is_some() || found <= MOST_CHUNK_PX {
            return Ok(());
        }
        let (kind, rows, cols) = (if tiled { "tiles" } else { "strips" }, self.chunk_rows, self.chunk_cols);
        Err(file.unsupported(format!(
            "{kind} of {rows} x {cols} pixels; at most {MOST_CHUNK_PX} pixels in one expected (gdal_translate -co TILED=YES -co COMPRESS=DEFLATE IN OUT)"
        )))
    }

    /// Refuses sizes that the file cannot hold.
    fn check_claims(&self, file: &Handle, compression: CompressionMethod) -> Result<()> {
        let image = (self.rows as u64).saturating_mul(self.cols as u64).saturating_mul(self.sample_bytes as u64);
        let claimed = image.max(self.chunk_bytes() as u64);
        let most = if compression == CompressionMethod::ZSTD { MOST_COMPRESSION_ZSTD } else { MOST_COMPRESSION };
        if claimed / most > file.file_bytes {
            let (rows, cols, file_bytes) = (self.rows, self.cols, file.file_bytes);
            return Err(file.broken(format!(
                "claims {rows} x {cols} pixels ({claimed} bytes), which a file of {file_bytes} bytes cannot hold"
            )));
        }
        Ok(())
    }

    fn with_limits(&self, file: Handle) -> Handle {
        let mut limits = Limits::default();
        let file_bytes = usize::try_from(file.file_bytes).unwrap_or(usize::MAX);
        limits.decoding_buffer_size = self.chunk_bytes().max(SMALL_BYTES);
        limits.intermediate_buffer_size = limits.intermediate_buffer_size.max(file_bytes);
        limits.ifd_value_size = limits.ifd_value_size.max(file_bytes.min(1 << 26));
        Handle { tiff: file.tiff.with_limits(limits), ..file }
    }

    /// Reads the offsets of the chunks. A truncated file is refused here, not after hours of work. Parts without offset and length were never written.
    fn check_table(&mut self, mut file: Handle, tiled: bool, uncompressed: bool) -> Result<Handle> {
        let (at, long) =
            if tiled { (Tag::TileOffsets, Tag::TileByteCounts) } else { (Tag::StripOffsets, Tag::StripByteCounts) };
        let offsets: Vec<u64> = file.unsigned_list(at)?.unwrap_or_default();
        let lengths: Vec<u64> = file.unsigned_list(long)?.unwrap_or_default();
        let (before, chunks) = (self.chunks_before, self.chunks_before + self.chunks);
        if offsets.len() < chunks || lengths.len() < chunks {
            let found = offsets.len().min(lengths.len());
            return Err(file.broken(format!("{chunks} strips or tiles expected, {found} found")));
        }
        let (offsets, lengths) = (&offsets[before..], &lengths[before..]);
        for (chunk, (&offset, &length)) in offsets.iter().zip(lengths).take(self.chunks).enumerate() {
            let (part, chunks, bytes) = (chunk + 1, self.chunks, file.file_bytes);
            let end = offset.saturating_add(length);
            if (offset, length) == (0, 0) {
                self.unwritten.push(chunk);
            } else if offset == 0 || length == 0 {
                let what = "offset and length expected, or neither";
                return Err(
                    file.broken(format!("{what}: part {part} of {chunks} has offset {offset}, length {length}"))
                );
            } else if end > bytes {
                let what =
                    format!("the file ends too early: part {part} of {chunks} ends at byte {end}, the file at {bytes}");
                return Err(file.broken(what));
            }
        }
        if file.tiff.inner().bytes().is_remote() {
            self.extents = offsets.iter().zip(lengths).take(self.chunks).map(|(&at, &long)| at..at + long).collect();
        }
        let known = !(self.kind.letter == 'f' && self.kind.bits == 16);
        let in_a_run = |(chunk, pair): (usize, &[u64])| pair[1] == pair[0] + self.rows_bytes(chunk);
        let enough = |(chunk, &length): (usize, &u64)| length >= self.rows_bytes(chunk);
        if uncompressed
            && !tiled
            && known
            && offsets[..self.chunks].windows(2).enumerate().all(in_a_run)
            && lengths.iter().take(self.chunks).enumerate().all(enough)
        {
            self.plain = offsets.first().copied();
        }
        Ok(file)
    }
}

/// Refuses everything except one band of plain grey samples, or `band` of several that are stored one after the other.
fn sample_kind(file: &mut Handle, band: Option<usize>) -> Result<SampleKind> {
    let bands: u16 = file.unsigned(Tag::SamplesPerPixel)?.unwrap_or(1);
    let planar = file.unsigned(Tag::PlanarConfiguration)? == Some(PlanarConfiguration::Planar.to_u16());
    if let Some(band) = band.filter(|band| *band >= usize::from(bands)) {
        return Err(file.unsupported(format!("{bands} bands found, band {} expected", band + 1)));
    }
    if bands != 1 && !(band.is_some() && planar) {
        return Err(file.unsupported(format!("{bands} bands found, one expected (gdal_translate -b 1 IN OUT)")));
    }
    let color = file.tiff.colortype();
    let bits = match file.check(color)? {
        ColorType::Gray(bits @ (8 | 16 | 32 | 64)) => u16::from(bits),
        ColorType::Multiband { bit_depth: bits @ (8 | 16 | 32 | 64), .. } => u16::from(bits),
        other => {
            return Err(file.unsupported(format!("{other:?} samples, grey of 8, 16, 32 or 64 bits expected")));
        }
    };
    if file.unsigned::<u16>(Tag::PhotometricInterpretation)? == Some(PhotometricInterpretation::WhiteIsZero.to_u16()) {
        return Err(file.unsupported("grey counted downwards (white is zero), black is zero expected"));
    }
    // One value for each band. The decoder refuses bands of different formats.
    let formats: Vec<u16> = file.unsigned_list(Tag::SampleFormat)?.unwrap_or_default();
    let format = formats.first().map_or(SampleFormat::Uint, |code| SampleFormat::from_u16_exhaustive(*code));
    let letter = match format {
        SampleFormat::Uint => 'u',
        SampleFormat::Int => 'i',
        SampleFormat::IEEEFP => 'f',
        other => {
            let other = other.to_u16();
            return Err(file.unsupported(format!("sample format {other}; integers and floats (1 to 3) are read")));
        }
    };
    if bits == 64 && letter != 'f' {
        return Err(file.unsupported("64-bit integers; integers up to 32 bits and floats are read"));
    }
    Ok(SampleKind { letter, bits })
}

fn compression(file: &mut Handle) -> Result<(CompressionMethod, &'static str)> {
    let code: Option<u16> = file.unsigned(Tag::Compression)?;
    let method = code.map_or(CompressionMethod::None, CompressionMethod::from_u16_exhaustive);
    let named = readable(method).map(|name| (method, name));
    named.ok_or_else(|| {
        let name = refused(method);
        file.unsupported(format!(
            "{name}; Deflate, LZW, ZSTD, PackBits or JPEG expected (gdal_translate -co COMPRESS=DEFLATE IN OUT)"
        ))
    })
}
