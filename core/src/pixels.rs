//! Pixels as a camera has them: 8, 12 or 16 bits or floats in bytes of the caller's memory, perhaps within a larger frame.

use crate::mask;
use crate::part::{item, part};
use crate::samples::Samples;
use crate::tile::Shape;
use crate::words::Words;

/// The form of a pixel in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelFormat {
    /// A float in the processor's own byte order.
    F32,
    /// A byte.
    U8,
    /// Two bytes, the low one first.
    U16Le,
    /// Two bytes, the high one first.
    U16Be,
    /// Twelve bits: two pixels in three bytes, the high bits first. A row begins with a byte.
    U12Packed,
}

impl PixelFormat {
    const ALL: [Self; 5] = [Self::F32, Self::U8, Self::U16Le, Self::U16Be, Self::U12Packed];

    /// Number of bytes of a row of `cols` pixels.
    #[must_use]
    pub const fn row_bytes(self, cols: usize) -> usize {
        match self {
            Self::F32 => cols.saturating_mul(4),
            Self::U8 => cols,
            Self::U16Le | Self::U16Be => cols.saturating_mul(2),
            Self::U12Packed => cols.saturating_mul(3).div_ceil(2),
        }
    }

    /// Returns pixel `col` of a row; NaN beyond its end.
    #[inline]
    fn pixel(self, row: &[u8], col: usize) -> Code {
        let byte = |at: usize| u32::from(item(row, at));
        match self {
            Self::F32 => {
                let bytes = part(row, 4 * col, 4).first_chunk().copied().unwrap_or(f32::NAN.to_ne_bytes());
                Code::Float(f32::from_ne_bytes(bytes))
            }
            Self::U8 => Code::Number(byte(col)),
            Self::U16Le => Code::Number(byte(2 * col) | byte(2 * col + 1) << 8),
            Self::U16Be => Code::Number(byte(2 * col) << 8 | byte(2 * col + 1)),
            Self::U12Packed => {
                let first = col / 2 * 3;
                Code::Number(match col % 2 {
                    0 => byte(first) << 4 | byte(first + 1) >> 4,
                    _ => (byte(first + 1) & 15) << 8 | byte(first + 2),
                })
            }
        }
    }
}

/// A pixel as it is stored.
enum Code {
    Float(f32),
    Number(u32),
}

/// How brightness comes from pixels as a camera has them: `gain * code + offset`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelForm {
    /// The form of a pixel.
    pub format: PixelFormat,
    /// Brightness of a step of the code.
    pub gain: f32,
    /// Brightness of code 0.
    pub offset: f32,
    /// The code of a pixel without a value. Floats have none.
    pub null_code: Option<u32>,
    /// The smallest code of a saturated pixel, which is a void. Floats have none.
    pub saturated_from: Option<u32>,
}

impl PixelForm {
    /// Floats that are brightness.
    pub const F32: Self =
        Self { format: PixelFormat::F32, gain: 1.0, offset: 0.0, null_code: None, saturated_from: None };

    /// Returns whether brightness is finite.
    #[must_use]
    pub fn is_legal(&self) -> bool {
        self.gain.is_finite() && self.offset.is_finite()
    }

    /// Returns a rectangle of such pixels, whose rows follow each other without a gap.
    #[must_use]
    pub fn pixels<'p>(&self, bytes: &'p [u8], shape: Shape) -> Pixels<'p> {
        let Self { format, gain, offset, null_code, saturated_from } = *self;
        let row_bytes = format.row_bytes(shape.cols);
        Pixels { bytes, shape, row_bytes, format, gain, offset, null_code, saturated_from }
    }

    /// Writes or reads it.
    pub(crate) fn visit(&mut self, words: &mut Words<'_>) {
        words.choice(&mut self.format, &PixelFormat::ALL);
        words.f32(&mut self.gain);
        words.f32(&mut self.offset);
        for code in [&mut self.null_code, &mut self.saturated_from] {
            words.option(code, 0, |v, words| words.u32(v));
        }
    }
}

/// A rectangle of pixels. Brightness is `gain * code + offset`; relative brightness needs a linear camera with its dark signal subtracted.
///
/// ```
/// use elunar_core::pixels::{PixelFormat, Pixels};
/// use elunar_core::samples::Samples;
/// use elunar_core::tile::Shape;
///
/// // Two rows of three pixels of 16 bits in a frame of four; 0 is a lost packet, and the camera saturates at 4095.
/// let frame: Vec<u8> = [10u16, 0, 30, 9, 40, 4095, 60, 9].iter().flat_map(|code| code.to_le_bytes()).collect();
/// let pixels = Pixels {
///     bytes: &frame,
///     shape: Shape::new(2, 3),
///     row_bytes: 8,
///     format: PixelFormat::U16Le,
///     gain: 0.5,
///     offset: 1.0,
///     null_code: Some(0),
///     saturated_from: Some(4095),
/// };
/// assert!(pixels.is_whole());
/// let found: Vec<f32> = (0..pixels.len()).map(|i| pixels.at(i)).collect();
/// assert!(found[1].is_nan() && found[4].is_nan());
/// assert_eq!([found[0], found[2], found[3], found[5]], [6.0, 16.0, 21.0, 31.0]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pixels<'p> {
    /// Bytes from the first pixel on.
    pub bytes: &'p [u8],
    /// Rows and columns.
    pub shape: Shape,
    /// Bytes from a row to the next.
    pub row_bytes: usize,
    /// The form of a pixel.
    pub format: PixelFormat,
    /// Brightness of a step of the code.
    pub gain: f32,
    /// Brightness of code 0.
    pub offset: f32,
    /// The code of a pixel without a value. Floats have none: voids are not real ([`mask`]).
    pub null_code: Option<u32>,
    /// The smallest code of a saturated pixel, which is a void. Floats have none.
    pub saturated_from: Option<u32>,
}

impl Pixels<'_> {
    /// Returns whether all pixels are in the memory, and gain and offset are finite.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        let Self { shape: Shape { rows, cols }, row_bytes, format, gain, offset, .. } = *self;
        let line = format.row_bytes(cols);
        let last = rows.checked_sub(1).and_then(|last| last.checked_mul(row_bytes));
        let needed = last.and_then(|last| last.checked_add(line));
        row_bytes >= line
            && needed.is_some_and(|needed| needed <= self.bytes.len())
            && gain.is_finite()
            && offset.is_finite()
    }

    fn row(&self, row: usize) -> &[u8] {
        part(self.bytes, row.saturating_mul(self.row_bytes), self.format.row_bytes(self.shape.cols))
    }

    #[inline]
    fn brightness(&self, row: &[u8], col: usize) -> f32 {
        match self.format.pixel(row, col) {
            Code::Float(v) if mask::is_real(v) => self.gain * v + self.offset,
            Code::Number(code)
                if Some(code) != self.null_code && self.saturated_from.is_none_or(|from| code < from) =>
            {
                self.gain * code as f32 + self.offset
            }
            _ => f32::NAN,
        }
    }
}

impl Samples for Pixels<'_> {
    fn len(&self) -> usize {
        self.shape.pixels()
    }

    fn at(&self, index: usize) -> f32 {
        let mut sample = [f32::NAN];
        self.read(index, &mut sample);
        sample[0]
    }

    fn read(&self, first: usize, out: &mut [f32]) {
        let cols = self.shape.cols.max(1);
        let (row, col) = (first / cols, first % cols);
        if row >= self.shape.rows {
            return out.fill(f32::NAN);
        }
        let row = self.row(row);
        for (value, col) in out.iter_mut().zip(col..) {
            *value = self.brightness(row, col);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixels(bytes: &[u8], format: PixelFormat) -> Pixels<'_> {
        let (shape, row_bytes) = (Shape::new(3, 5), format.row_bytes(5) + 2);
        Pixels {
            bytes,
            shape,
            row_bytes,
            format,
            gain: 2.0,
            offset: -1.0,
            null_code: Some(7),
            saturated_from: Some(250),
        }
    }

    #[test]
    fn every_format_gives_the_same_brightness() {
        let codes: Vec<u32> = (0..15).map(|i| [3, 7, 249, 250, 100, 8][i % 6]).collect();
        let expected: Vec<f32> =
            codes.iter().map(|&c| if c == 7 || c >= 250 { f32::NAN } else { 2.0 * c as f32 - 1.0 }).collect();
        let row = |format, row: &[u32]| -> Vec<u8> {
            let mut bytes: Vec<u8> = match format {
                PixelFormat::F32 => {
                    let float = |c: u32| if c == 7 || c >= 250 { f32::INFINITY } else { c as f32 };
                    row.iter().flat_map(|c| float(*c).to_ne_bytes()).collect()
                }
                PixelFormat::U8 => row.iter().map(|c| *c as u8).collect(),
                PixelFormat::U16Le => row.iter().flat_map(|c| (*c as u16).to_le_bytes()).collect(),
                PixelFormat::U16Be => row.iter().flat_map(|c| (*c as u16).to_be_bytes()).collect(),
                PixelFormat::U12Packed => {
                    let text: String = row.iter().map(|c| format!("{c:03x}")).collect();
                    let even = format!("{text}f");
                    (0..text.len().div_ceil(2)).map(|i| u8::from_str_radix(&even[2 * i..][..2], 16).unwrap()).collect()
                }
            };
            bytes.extend([0xAA, 0xBB]);
            bytes
        };
        use PixelFormat::{F32, U8, U12Packed, U16Be, U16Le};
        for format in [F32, U8, U16Le, U16Be, U12Packed] {
            let bytes: Vec<u8> = codes.chunks(5).flat_map(|line| row(format, line)).collect();
            let pixels = pixels(&bytes[..bytes.len() - 2], format);
            assert!(pixels.is_whole(), "{format:?}");
            let short = Pixels { bytes: &bytes[..bytes.len() - 3], ..pixels };
            assert!(!short.is_whole() && !Pixels { row_bytes: format.row_bytes(5) - 1, ..pixels }.is_whole());
            assert!(!Pixels { gain: f32::NAN, ..pixels }.is_whole());
            assert!(!Pixels { row_bytes: usize::MAX, ..pixels }.is_whole());
            for (i, v) in expected.iter().enumerate() {
                let found = pixels.at(i);
                assert!(found == *v || found.is_nan() && v.is_nan(), "{format:?} {i}: {found} {v}");
            }
            let mut line = [0.0; 3];
            pixels.read(6, &mut line);
            assert!(
                line.iter().zip(&expected[6..]).all(|(a, b)| a.to_bits() == b.to_bits() || a.is_nan() && b.is_nan())
            );
            pixels.read(15, &mut line);
            assert!(line.iter().all(|v| v.is_nan()) && pixels.at(99).is_nan());
        }
    }
}
