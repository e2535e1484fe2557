//! Samples of a map, packed for a page: 16-bit codes, their differences to neighbours, compressed (report.js unpacks them).

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use elunar_base::{Error, Result};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use serde::Serialize;
use std::io::Write;

/// Code of a sample without a value.
const VOID: u16 = u16::MAX;

/// Packed samples. The value of a code is `low + step * code`.
#[derive(Debug, Serialize)]
pub(super) struct PackedMap {
    low: f32,
    step: f32,
    codes: String,
}

impl PackedMap {
    /// Packs samples of lines of `cols`, those below `low` as `low` and those above `high` as `high`, in steps of at least `step`.
    ///
    /// # Errors
    /// [`Error::Usage`] if they cannot be compressed.
    pub(super) fn new(samples: &[f32], cols: usize, (low, high): (f32, f32), step: f32) -> Result<Self> {
        let step = step.max((high - low) / f32::from(VOID - 1)).max(f32::MIN_POSITIVE);
        let code = |v: &f32| if v.is_finite() { ((v.clamp(low, high) - low) / step).round() as u16 } else { VOID };
        let codes: Vec<u16> = samples.iter().map(code).collect();
        let at = |row: usize, col: usize| codes[row * cols + col];
        let folded = |i: usize| {
            let (row, col) = (i / cols, i % cols);
            let (left, up) = (col > 0, row > 0);
            let mut said = 0_u16;
            said = if left { said.wrapping_add(at(row, col - 1)) } else { said };
            said = if up { said.wrapping_add(at(row - 1, col)) } else { said };
            said = if left && up { said.wrapping_sub(at(row - 1, col - 1)) } else { said };
            let difference = codes[i].wrapping_sub(said).cast_signed();
            ((difference << 1) ^ (difference >> 15)).cast_unsigned()
        };
        let all: Vec<u16> = (0..codes.len()).map(folded).collect();
        let bytes: Vec<u8> = all.iter().map(|v| *v as u8).chain(all.iter().map(|v| (v >> 8) as u8)).collect();
        let broken = |error: std::io::Error| Error::usage(format!("page: samples: {error}"));
        let mut encoder = ZlibEncoder::new(vec![], Compression::best());
        encoder.write_all(&bytes).map_err(broken)?;
        Ok(Self { low, step, codes: STANDARD.encode(encoder.finish().map_err(broken)?) })
    }

    /// Unpacks the samples, as the page does.
    #[cfg(test)]
    fn samples(&self, cols: usize) -> Vec<f32> {
        let mut bytes = vec![];
        let packed = STANDARD.decode(&self.codes).unwrap();
        std::io::Read::read_to_end(&mut flate2::read::ZlibDecoder::new(&packed[..]), &mut bytes).unwrap();
        let size = bytes.len() / 2;
        let mut found = vec![0_u16; size];
        for i in 0..size {
            let folded = u16::from_le_bytes([bytes[i], bytes[size + i]]);
            let (left, up) = (!i.is_multiple_of(cols), i >= cols);
            let of = |yes: bool, back: usize| if yes { found[i - back] } else { 0 };
            let said = of(left, 1).wrapping_add(of(up, cols)).wrapping_sub(of(left && up, cols + 1));
            found[i] = said.wrapping_add((folded >> 1) ^ (folded & 1).wrapping_neg());
        }
        found
            .into_iter()
            .map(|code| if code == VOID { f32::NAN } else { self.low + self.step * f32::from(code) })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_come_back_within_half_a_step() {
        let wave = |i: usize| (i as f32 * 0.37).sin() * 300.0 - 40.0 * (i % 7) as f32;
        let mut samples: Vec<f32> = (0..35).map(wave).collect();
        (samples[3], samples[20]) = (f32::NAN, f32::INFINITY);
        let found = PackedMap::new(&samples, 7, (-540.0, 200.0), 0.01).unwrap().samples(7);
        for (k, (given, back)) in samples.iter().zip(&found).enumerate() {
            let far = (given.clamp(-540.0, 200.0) - back).abs();
            assert!(if given.is_finite() { far <= 0.0058 } else { back.is_nan() }, "{k}: {given} {back}");
        }
        // A map of one value has steps, too.
        assert_eq!(PackedMap::new(&[5.0; 4], 2, (5.0, 5.0), 0.0).unwrap().samples(2), [5.0; 4]);
    }
}
