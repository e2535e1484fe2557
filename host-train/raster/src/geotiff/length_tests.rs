//! Strips whose lengths are 0 or absent are read as libtiff reads them, and bytes in reverse are refused.

use super::tests::scratch;
use super::*;
use elunar_testing::{rasterio as gdal, skipped};
use tiff::encoder::compression::{CompressionAlgorithm, Deflate, Lzw};

const ROWS: usize = 12;
const COLS: usize = 16;

/// A file of 12 x 16 signed 16-bit samples, 0 to 191.
#[derive(Clone, Copy)]
struct Shape {
    little: bool,
    big: bool,
    tiled: bool,
    /// Rows of a strip or tile.
    rows: usize,
    /// TIFF's number of the compression.
    packing: u64,
}

const PLAIN: Shape = Shape { little: true, big: false, tiled: false, rows: ROWS, packing: 1 };

/// How the file states its lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Lengths {
    Right,
    Zero,
    Absent,
    /// The first is this.
    First(u64),
}

impl Shape {
    fn number(self, value: u64, bytes: usize) -> Vec<u8> {
        if self.little { value.to_le_bytes()[..bytes].into() } else { value.to_be_bytes()[8 - bytes..].into() }
    }

    fn parts(self) -> Vec<Vec<u8>> {
        let all: Vec<u8> = (0..ROWS * COLS).flat_map(|i| self.number(i as u64, 2)).collect();
        let pack = |part: &[u8]| {
            let mut packed = vec![];
            match self.packing {
                5 => Lzw.write_to(&mut packed, part).map(drop).unwrap(),
                8 => Deflate::default().write_to(&mut packed, part).map(drop).unwrap(),
                50000 => packed = zstd::bulk::compress(part, 1).unwrap(),
                _ => packed = part.into(),
            }
            packed
        };
        all.chunks(self.rows * COLS * 2).map(pack).collect()
    }

    /// Returns the file; `edit` changes offsets and lengths, `more` adds tags.
    fn file(self, lengths: Lengths, edit: impl Fn(&mut [u64], &mut [u64]), more: &[(u16, u64)]) -> Vec<u8> {
        let (word, magic) = if self.big { (8, 43) } else { (4, 42) };
        let mut bytes = [if self.little { b"II" } else { b"MM" }.to_vec(), self.number(magic, 2)].concat();
        if self.big {
            bytes.extend([self.number(8, 2), self.number(0, 2)].concat());
        }
        let link = bytes.len();
        bytes.extend(vec![0; word]);
        let (mut at, mut long) = (vec![], vec![]);
        for part in self.parts() {
            at.push(bytes.len() as u64);
            long.push(if lengths == Lengths::Zero { 0 } else { part.len() as u64 });
            bytes.extend(part);
        }
        if let Lengths::First(first) = lengths {
            long[0] = first;
        }
        edit(&mut at, &mut long);
        let one = |tag: u16, value: usize| (tag, vec![value as u64]);
        let mut tags = vec![one(256, COLS), one(257, ROWS), one(258, 16), one(259, self.packing as usize), one(262, 1)];
        tags.extend([one(277, 1), one(339, 2)]);
        tags.extend(more.iter().map(|&(tag, value)| (tag, vec![value])));
        let (offsets, counts) = if self.tiled { (324, 325) } else { (273, 279) };
        tags.push((offsets, at));
        if lengths != Lengths::Absent {
            tags.push((counts, long));
        }
        match self.tiled {
            true => tags.extend([one(322, COLS), one(323, self.rows)]),
            false => tags.push(one(278, self.rows)),
        }
        tags.sort();
        let directory = bytes.len();
        bytes.splice(link..link + word, self.number(directory as u64, word));
        let (count_bytes, entry_bytes) = if self.big { (8, 20) } else { (2, 12) };
        bytes.extend(self.number(tags.len() as u64, count_bytes));
        let mut values = vec![];
        let values_at = directory + count_bytes + tags.len() * entry_bytes + word;
        for (tag, numbers) in tags {
            bytes.extend(
                [self.number(tag.into(), 2), self.number(4, 2), self.number(numbers.len() as u64, word)].concat(),
            );
            let of_tag: Vec<u8> = numbers.iter().flat_map(|&number| self.number(number, 4)).collect();
            if of_tag.len() <= word {
                bytes.extend(&of_tag);
                bytes.extend(vec![0; word - of_tag.len()]);
            } else {
                bytes.extend(self.number((values_at + values.len()) as u64, word));
                values.extend(of_tag);
            }
        }
        bytes.extend(vec![0; word]);
        bytes.extend(values);
        bytes
    }
}

fn all() -> Vec<f32> {
    (0..ROWS * COLS).map(|i| i as f32).collect()
}

fn opened(bytes: &[u8]) -> elunar_base::Result<Vec<f32>> {
    let folder = scratch();
    let path = folder.path().join("a.tif");
    std::fs::write(&path, bytes).unwrap();
    read(path).map(|raster| raster.samples)
}

fn refused(bytes: &[u8]) -> String {
    opened(bytes).expect_err("refused").to_string()
}

/// Returns every byte order, classic and BigTIFF.
fn shapes() -> impl Iterator<Item = Shape> {
    [(true, false), (false, false), (true, true), (false, true)].into_iter().map(|(little, big)| Shape {
        little,
        big,
        ..PLAIN
    })
}

#[test]
fn a_strip_without_a_length_is_there() {
    let folder = scratch();
    let mut written = 0;
    for (index, shape) in shapes().enumerate() {
        for packing in [1, 5, 8, 50000] {
            for lengths in [Lengths::Right, Lengths::Zero, Lengths::Absent] {
                let bytes = Shape { packing, ..shape }.file(lengths, |_, _| {}, &[]);
                assert_eq!(opened(&bytes).unwrap_or_else(|e| panic!("{packing} {lengths:?}: {e}")), all());
                std::fs::write(folder.path().join(format!("{index}_{packing}_{lengths:?}.tif")), bytes).unwrap();
                written += 1;
            }
        }
    }
    let script = "
import glob
for name in glob.glob('*.tif'):
    assert (rasterio.open(name).read(1).ravel() == np.arange(192)).all(), name
print(len(glob.glob('*.tif')))
";
    if let Some(out) = gdal(script, folder.path()) {
        assert_eq!(out.trim(), written.to_string(), "and GDAL reads them so");
    }
}

#[test]
fn several_plain_strips_and_tiles_have_the_length_of_their_size() {
    for shape in shapes() {
        // 12 rows in strips of 5: the last one has 2.
        for shape in [Shape { rows: 5, ..shape }, Shape { rows: 4, tiled: false, ..shape }] {
            for lengths in [Lengths::Right, Lengths::Zero, Lengths::Absent, Lengths::First(0)] {
                assert_eq!(opened(&shape.file(lengths, |_, _| {}, &[])).unwrap(), all(), "{lengths:?}");
            }
        }
    }
}

#[test]
fn a_single_plain_strip_with_a_wrong_length_has_that_of_its_size() {
    for first in [1, 300, 1 << 20] {
        assert_eq!(opened(&PLAIN.file(Lengths::First(first), |_, _| {}, &[])).unwrap(), all(), "{first}");
    }
    let mut cut = PLAIN.file(Lengths::Zero, |at, _| at[0] += 1000, &[]);
    assert!(refused(&cut).contains("the file ends too early"));
    cut.truncate(200);
    assert!(refused(&cut).contains("too early"));
}

#[test]
fn only_parts_without_offset_and_length_are_empty() {
    let strips = Shape { rows: 4, ..PLAIN };
    let sparse = |at: &mut [u64], long: &mut [u64]| (at[1], long[1]) = (0, 0);
    let mut expected = all();
    expected[64..128].fill(0.0);
    assert_eq!(opened(&strips.file(Lengths::Right, sparse, &[])).unwrap(), expected);
    let half = |at: &mut [u64], _: &mut [u64]| at[1] = 0;
    let text = refused(&strips.file(Lengths::Right, half, &[]));
    assert!(text.ends_with("offset and length expected, or neither: part 2 of 3 has offset 0, length 128"), "{text}");
    // A compressed part of several, and a part that would reach into others.
    let packed = Shape { packing: 8, ..strips };
    assert!(refused(&packed.file(Lengths::First(0), |_, _| {}, &[])).contains("part 1 of 3 has offset 8, length 0"));
    let inside = |at: &mut [u64], _: &mut [u64]| at[0] = at[1] - 4;
    assert!(refused(&strips.file(Lengths::First(0), inside, &[])).contains("part 1 of 3"));
    let twice = |at: &mut [u64], _: &mut [u64]| at[0] = at[1];
    assert!(refused(&strips.file(Lengths::Zero, twice, &[])).contains("part 1 of 3"));
}

#[test]
fn bits_in_reverse_are_refused() {
    assert_eq!(opened(&PLAIN.file(Lengths::Right, |_, _| {}, &[(266, 1)])).unwrap(), all());
    let text = refused(&PLAIN.file(Lengths::Right, |_, _| {}, &[(266, 2)]));
    assert!(text.contains("not supported: bits in reverse (FillOrder 2)") && text.contains("gdal_translate"), "{text}");
}

#[test]
fn reported_files_are_read() {
    let Some(shared) = elunar_testing::shared_folder() else { return };
    let at = |name: &str| shared.join("files/bugs/02_strip_byte_count_zero").join(name);
    if !at("reference.tif").exists() {
        return skipped("reported_files_are_read", "no files/bugs beside the reference data");
    }
    let samples = |name: &str| read(at(name)).unwrap().samples;
    assert_eq!(samples("zero.tif"), samples("reference.tif"));
    assert_eq!(samples("missing.tif"), samples("reference.tif"));
}

#[test]
fn floats_of_16_bits_and_strips_that_are_too_short() {
    // Without compression, too, they are read strip by strip. The bits 0 to 191 are multiples of the smallest float.
    for rows in [4, ROWS] {
        let mut bytes = Shape { rows, ..PLAIN }.file(Lengths::Right, |_, _| {}, &[]);
        let format = [83, 1, 4, 0, 1, 0, 0, 0, 2];
        let at = bytes.windows(9).position(|window| window == format).unwrap();
        bytes[at + 8] = 3;
        let expected: Vec<f32> = all().iter().map(|v| v * 2_f32.powi(-24)).collect();
        assert_eq!(opened(&bytes).unwrap(), expected);
    }
    // What their size needs is there, whatever the length says.
    let strips = Shape { rows: 4, ..PLAIN };
    assert_eq!(opened(&strips.file(Lengths::First(100), |_, _| {}, &[])).unwrap(), all());
}

#[test]
fn directories_beyond_the_file_and_lengths_beyond_4_gib_are_refused() {
    let mut bytes = Shape { big: true, ..PLAIN }.file(Lengths::Zero, |_, _| {}, &[]);
    bytes[8..16].fill(0xFF);
    assert!(refused(&bytes).contains("broken file"), "{}", refused(&bytes));
    // The single part of a file reaches to its end, which a classic file cannot say here.
    let folder = scratch();
    let path = folder.path().join("a.tif");
    let packed = Shape { packing: 8, ..PLAIN };
    for (shape, is_read) in [(packed, false), (Shape { big: true, ..packed }, true)] {
        std::fs::write(&path, shape.file(Lengths::Zero, |_, _| {}, &[])).unwrap();
        std::fs::File::options().write(true).open(&path).unwrap().set_len(5 << 30).unwrap();
        match read(&path) {
            Ok(raster) => assert!(is_read && raster.samples == all()),
            Err(error) => {
                let text = error.to_string();
                assert!(!is_read && text.contains("part 1 of 1 has offset 8, length 0"), "{text}");
            }
        }
    }
}
