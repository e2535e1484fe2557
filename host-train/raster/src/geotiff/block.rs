//! One block of samples as stored in the file: rounded, predicted, compressed.

use super::NODATA;
use super::options::{Compression, SampleType};
use std::io::Result;
use tiff::encoder::compression::{CompressionAlgorithm, Deflate, Lzw};
use tiff::tags::{CompressionMethod, Predictor};

/// Compresses with GDAL's default level.
#[cfg(not(target_family = "wasm"))]
fn zstd(bytes: &[u8]) -> Result<Vec<u8>> {
    zstd::bulk::compress(bytes, 9)
}

/// Zstandard is C, which is not compiled for WebAssembly.
#[cfg(target_family = "wasm")]
fn zstd(_: &[u8]) -> Result<Vec<u8>> {
    Err(std::io::ErrorKind::Unsupported.into())
}

/// Encoding of samples.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coding {
    pub(super) sample: SampleType,
    pub(super) compression: Compression,
    /// For integers: 0 means invalid, and valid samples are at least 1.
    pub(super) zero_is_nodata: bool,
}

impl Coding {
    /// Returns the predictor. Without compression, prediction is of no use.
    pub(super) fn predictor(self) -> Predictor {
        match (self.compression, self.sample) {
            (Compression::None, _) => Predictor::None,
            (_, SampleType::F32) => Predictor::FloatingPoint,
            _ => Predictor::Horizontal,
        }
    }

    /// Returns the compression method as named in the file.
    pub(super) fn compression_method(self) -> CompressionMethod {
        match self.compression {
            Compression::None => CompressionMethod::None,
            Compression::Lzw => CompressionMethod::LZW,
            Compression::Deflate => CompressionMethod::Deflate,
            Compression::Zstd => CompressionMethod::ZSTD,
        }
    }

    /// Encodes a block of `band`, which has rows of `stride` samples. The block is `size` = (rows, columns) from column `first_col` on.
    /// Beyond the band, its last row and column repeat, which compresses best.
    pub(super) fn encode(self, band: &[f32], stride: usize, first_col: usize, size: (usize, usize)) -> Result<Vec<u8>> {
        let band_rows = band.len() / stride;
        let mut bytes = Vec::with_capacity(size.0 * size.1 * self.sample.bytes());
        let mut line = vec![0.0; size.1];
        for row in 0..size.0 {
            let from = &band[row.min(band_rows - 1) * stride..][..stride];
            let there = size.1.min(stride - first_col);
            line[..there].copy_from_slice(&from[first_col..first_col + there]);
            line[there..].fill(from[stride - 1]);
            self.append(&line, &mut bytes);
        }
        let mut packed = Vec::new();
        match self.compression {
            Compression::None => return Ok(bytes),
            Compression::Lzw => Lzw.write_to(&mut packed, &bytes)?,
            Compression::Deflate => Deflate::default().write_to(&mut packed, &bytes)?,
            Compression::Zstd => return zstd(&bytes),
        };
        Ok(packed)
    }

    /// Appends one row, prediction applied, little-endian.
    fn append(self, line: &[f32], out: &mut Vec<u8>) {
        let lowest = if self.zero_is_nodata { 1.0 } else { 0.0 };
        let whole = |v: f32, highest: f32| if v.is_finite() { v.round().clamp(lowest, highest) } else { 0.0 };
        let predicted = self.predictor() != Predictor::None;
        match self.sample {
            SampleType::F32 if predicted => append_float_predicted(line, out),
            SampleType::F32 => line.iter().for_each(|&v| out.extend(or_nodata(v).to_le_bytes())),
            SampleType::U16 => {
                let mut previous = 0_u16;
                for value in line.iter().map(|&v| whole(v, f32::from(u16::MAX)) as u16) {
                    out.extend(value.wrapping_sub(previous).to_le_bytes());
                    previous = if predicted { value } else { 0 };
                }
            }
            SampleType::U8 => {
                let mut previous = 0_u8;
                for value in line.iter().map(|&v| whole(v, f32::from(u8::MAX)) as u8) {
                    out.push(value.wrapping_sub(previous));
                    previous = if predicted { value } else { 0 };
                }
            }
        }
    }
}

fn or_nodata(value: f32) -> f32 {
    if value.is_finite() { value } else { NODATA }
}

/// Appends a row with [`Predictor::FloatingPoint`]: the bytes by significance, highest first, then differences of neighbouring bytes.
fn append_float_predicted(line: &[f32], out: &mut Vec<u8>) {
    let start = out.len();
    out.resize(start + 4 * line.len(), 0);
    let planes = &mut out[start..];
    for (i, &value) in line.iter().enumerate() {
        for (plane, byte) in or_nodata(value).to_be_bytes().into_iter().enumerate() {
            planes[plane * line.len() + i] = byte;
        }
    }
    for i in (1..planes.len()).rev() {
        planes[i] = planes[i].wrapping_sub(planes[i - 1]);
    }
}
