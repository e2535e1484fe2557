//! Reading and writing of GeoTIFF: one band, with georeference, NoData value, scale and unit.
//!
//! [`open`] and [`read`] accept files of GDAL, ISIS and the Ames Stereo Pipeline: strips or tiles, classic or BigTIFF, uncompressed, LZW,
//! Deflate, ZSTD, PackBits or JPEG, predictors 2 and 3, integers up to 32 bits and floats. [`Writer`] and [`write()`] make cloud-optimised
//! files. Anything else is refused: several bands, palettes, internal masks, ground control points.

mod block;
mod cache;
mod handle;
mod ifd;
mod layout;
mod lengths;
mod metadata;
mod options;
mod overlaid;
mod place;
mod plain;
mod pyramid;
mod read;
mod rule;
mod write;
mod writer;

#[cfg(test)]
mod band_tests;
#[cfg(test)]
mod chunk_tests;
#[cfg(test)]
mod cog_tests;
#[cfg(test)]
mod gdal_tests;
#[cfg(test)]
mod length_tests;
#[cfg(test)]
mod mutation_tests;
#[cfg(test)]
mod nodata_tests;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod unit_tests;

pub use options::{BandText, Compression, SampleType, WriteOptions};
pub(super) use read::open_with;
pub use read::{open, open_band, read, read_item};
pub use write::write;
pub use writer::Writer;

/// NoData value of float files: ISIS NULL4 (bits 0xFF7FFFFB), as in LROC's terrain models. It is not the lowest `f32`.
pub const NODATA: f32 = f32::from_bits(0xFF7F_FFFB);

/// [`NODATA`] as text, for tag 42113.
pub const NODATA_TEXT: &str = "-3.40282265508890445e+38";

/// Tag numbers without a name in the `tiff` crate.
mod tag {
    use tiff::tags::Tag;

    pub(super) const GDAL_METADATA: Tag = Tag::Unknown(42112);
}
