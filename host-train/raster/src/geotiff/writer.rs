//! A cloud-optimised GeoTIFF, written row by row.

use super::super::GeoRef;
use super::block::Coding;
use super::ifd::{Directory, Field, head};
use super::metadata::{self, Item};
use super::options::{SampleType, WriteOptions};
use super::pyramid::{BLOCK_PX, Level, halve, levels};
use super::{NODATA_TEXT, tag};
use elunar_base::output::{Staged, check_target};
use elunar_base::{Error, Result, folder_of};
use rayon::prelude::*;
use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};
use tiff::tags::{PhotometricInterpretation, PlanarConfiguration, SampleFormat, Tag};

/// Bit of [`Tag::NewSubfileType`]: a reduced version of another image of the file.
const REDUCED: u32 = 1;
/// Number of blocks that are compressed together, for each thread: enough that none waits long for the last one.
const BLOCKS_A_THREAD: usize = 2;

/// Whole rows of a level that wait for compression.
#[derive(Debug)]
struct Waiting {
    plane: usize,
    level: usize,
    band: Vec<f32>,
}

/// Writer of a cloud-optimised GeoTIFF, from top to bottom. Blocks have 512 x 512 pixels. Overviews are means of valid samples; the
/// smallest fits one block. Directories come first. BigTIFF is used only for files beyond 4 GiB.
///
/// Memory holds two bands of 512 rows, whatever the height, and more only if a band has fewer than two blocks for each thread. Compressed blocks wait in a nameless temporary file beside the target, so the
/// disk needs twice the target's size for a moment. [`Writer::finish`] makes the file from them. Before that, and if anything fails or the
/// program is killed, there is no file at `path`, or the old one. A kill during [`Writer::finish`] may leave a `.tmp*.part` beside it.
#[derive(Debug)]
pub struct Writer {
    path: PathBuf,
    georef: Option<GeoRef>,
    options: WriteOptions,
    coding: Coding,
    /// The levels of each band.
    bands: Vec<Vec<Level>>,
    /// Bands of blocks that wait until there is work for all threads, with their planes and levels, in order.
    waiting: Vec<Waiting>,
    spill: BufWriter<File>,
    spilled_bytes: u64,
    /// Number of rows given of each band.
    rows_given: Vec<usize>,
}

impl Writer {
    /// Starts a file of `rows` x `cols` pixels. The reference system's keys are written as they are.
    ///
    /// # Errors
    /// [`Error::Usage`] if a side is 0 or beyond 2^31 - 1, or `path` is no regular file; [`Error::Io`] if its folder cannot be written.
    pub fn create(
        path: &Path,
        rows: usize,
        cols: usize,
        georef: Option<&GeoRef>,
        options: &WriteOptions,
    ) -> Result<Self> {
        let most = i32::MAX as usize;
        if rows == 0 || cols == 0 || rows > most || cols > most {
            let what = format!("{}: sides of 1 to {most} pixels expected, {rows} x {cols} found", path.display());
            return Err(Error::usage(what));
        }
        check_target(path)?;
        let spill = BufWriter::new(tempfile::tempfile_in(folder_of(path)).map_err(Error::io(path))?);
        let coding = Coding {
            sample: options.sample,
            compression: options.compression,
            zero_is_nodata: options.zero_is_nodata && options.sample != SampleType::F32,
        };
        let (georef, options) = (georef.cloned(), options.clone());
        let count = 1 + options.more_bands.len();
        let bands = (0..count).map(|_| levels(rows, cols)).collect();
        let rows_given = vec![0; count];
        let waiting = vec![];
        Ok(Self { path: path.into(), georef, options, coding, bands, waiting, spill, spilled_bytes: 0, rows_given })
    }

    /// Adds the next rows of the first band, any number of whole ones. NaN is invalid.
    ///
    /// # Errors
    /// As [`Self::write_band_rows`].
    pub fn write_rows(&mut self, samples: &[f32]) -> Result<()> {
        self.write_band_rows(0, samples)
    }

    /// Adds the next rows of a band, counted from 0, any number of whole ones. NaN is invalid.
    ///
    /// # Errors
    /// [`Error::Usage`] if the file has no such band, or the samples are not whole rows, more than the file has, or do not fit its integers;
    /// [`Error::Io`] if they cannot be written.
    pub fn write_band_rows(&mut self, band: usize, samples: &[f32]) -> Result<()> {
        let Some(&before) = self.rows_given.get(band) else {
            let (path, bands) = (self.path.display(), self.rows_given.len());
            return Err(Error::usage(format!("{path}: a band below {bands} expected, band {band} found")));
        };
        let (rows, cols) = self.shape();
        let given = samples.len() / cols;
        if !samples.len().is_multiple_of(cols) || given > rows - before {
            let (left, found) = (rows - before, samples.len());
            let what = format!(
                "{}: whole rows of {cols} samples expected, {left} at the most, {found} samples found",
                self.path.display()
            );
            return Err(Error::usage(what));
        }
        if given == 0 {
            return Ok(());
        }
        self.check_range(samples)?;
        self.rows_given[band] += given;
        self.push((band, 0), samples, before + given == rows).map_err(Error::io(&self.path))
    }

    /// Returns the rows and columns of the file.
    fn shape(&self) -> (usize, usize) {
        (self.bands[0][0].rows, self.bands[0][0].cols)
    }

    /// Completes the file and renames it to its path.
    ///
    /// # Errors
    /// [`Error::Usage`] if rows are missing; [`Error::Io`] if the disk is full or the file cannot be named.
    pub fn finish(self) -> Result<()> {
        self.stage()?.publish()
    }

    /// Completes the file under a name of its own. It gets its path when the result is published.
    ///
    /// # Errors
    /// As [`Self::finish`].
    pub fn stage(mut self) -> Result<Staged> {
        let (rows, _) = self.shape();
        if let Some(&given) = self.rows_given.iter().find(|given| **given != rows) {
            let path = self.path.display();
            return Err(Error::usage(format!("{path}: {rows} rows expected, {given} given")));
        }
        let path = self.path.clone();
        self.spill_waiting().map_err(Error::io(&path))?;
        let mut staged = Staged::create(&path)?;
        self.assemble(staged.file()).map_err(Error::io(&path))?;
        Ok(staged)
    }

    fn assemble(&mut self, file: &File) -> std::io::Result<()> {
        self.spill.flush()?;
        let mut out = BufWriter::with_capacity(1 << 20, file);
        out.write_all(&self.head())?;
        let mut spill = BufReader::with_capacity(1 << 20, self.spill.get_ref());
        // The smallest overview comes first, so that a preview of the file reads little.
        for level in (0..self.bands[0].len()).rev() {
            for &(at, length) in self.bands.iter().flat_map(|levels| &levels[level].blocks) {
                let back = spill.stream_position()? as i64;
                spill.seek_relative(at as i64 - back)?;
                if std::io::copy(&mut spill.by_ref().take(length), &mut out)? != length {
                    return Err(std::io::ErrorKind::UnexpectedEof.into());
                }
            }
        }
        out.flush()
    }

    /// Adds rows to a level, writes its full bands, and passes their halves to the next level.
    fn push(&mut self, (plane, level): (usize, usize), samples: &[f32], last: bool) -> std::io::Result<()> {
        let cols = self.bands[plane][level].cols;
        let full = BLOCK_PX * cols;
        let mut rest = samples;
        loop {
            let band = &mut self.bands[plane][level].band;
            let (now, later) = rest.split_at(rest.len().min(full - band.len()));
            band.extend_from_slice(now);
            rest = later;
            let ends = last && rest.is_empty();
            if band.len() < full && !ends {
                return Ok(());
            }
            let band = std::mem::take(band);
            let half = (level + 1 < self.bands[plane].len()).then(|| halve(&band, cols));
            self.waiting.push(Waiting { plane, level, band });
            let across = |waits: &Waiting| self.blocks_across(waits.plane, waits.level);
            if self.waiting.iter().map(across).sum::<usize>() >= BLOCKS_A_THREAD * rayon::current_num_threads() {
                self.spill_waiting()?;
            }
            if let Some(half) = half {
                self.push((plane, level + 1), &half, ends)?;
            }
            if ends {
                return Ok(());
            }
        }
    }

    /// Returns the number of blocks in a band of a level.
    fn blocks_across(&self, plane: usize, level: usize) -> usize {
        let level = &self.bands[plane][level];
        level.cols.div_ceil(level.block().1)
    }

    /// Compresses the blocks that wait, on all threads, and writes them in order: the file does not depend on how many wait.
    fn spill_waiting(&mut self) -> std::io::Result<()> {
        let waiting = std::mem::take(&mut self.waiting);
        let Self { bands, coding, spill, spilled_bytes, .. } = self;
        let cut = |waits: &'_ Waiting| {
            let level = &bands[waits.plane][waits.level];
            (0..level.cols).step_by(level.block().1).collect::<Vec<_>>()
        };
        let blocks: Vec<(&Waiting, usize)> =
            waiting.iter().flat_map(|waits| cut(waits).into_iter().map(move |col| (waits, col))).collect();
        let encode = |&(waits, col): &(&Waiting, usize)| {
            let level = &bands[waits.plane][waits.level];
            coding.encode(&waits.band, level.cols, col, level.block())
        };
        let packed: Vec<Vec<u8>> = blocks.par_iter().map(encode).collect::<std::io::Result<_>>()?;
        for ((waits, _), bytes) in blocks.iter().zip(packed) {
            spill.write_all(&bytes)?;
            bands[waits.plane][waits.level].blocks.push((*spilled_bytes, bytes.len() as u64));
            *spilled_bytes += bytes.len() as u64;
        }
        Ok(())
    }

    fn check_range(&self, samples: &[f32]) -> Result<()> {
        let Some(highest) = self.options.sample.highest() else { return Ok(()) };
        let fits =
            |v: &f32| if v.is_finite() { (0.0..=highest).contains(&v.round()) } else { self.coding.zero_is_nodata };
        match samples.iter().find(|v| !fits(v)) {
            Some(v) => Err(Error::usage(format!(
                "{}: samples within 0 and {highest} expected, {v} found",
                self.path.display()
            ))),
            None => Ok(()),
        }
    }

    /// Returns header and directories, with the offsets of all blocks.
    fn head(&self) -> Vec<u8> {
        let levels = self.bands[0].len();
        let mut images: Vec<Directory> = (0..levels).map(|level| self.tags(level)).collect();
        // Offsets beyond 4 GiB need a BigTIFF. The head's length does not depend on them.
        let big =
            head(&images, false).len() as u64 + self.spilled_bytes > u64::from(u32::MAX) || self.options.force_big;
        let mut at = head(&images, big).len() as u64;
        for (level, image) in images.iter_mut().enumerate().rev() {
            let place = |&(_, length): &(u64, u64)| {
                at += length;
                at - length
            };
            image.insert(Tag::TileOffsets, Field::Offset(self.blocks(level).map(place).collect()));
        }
        head(&images, big)
    }

    /// Returns the blocks of a level, band after band.
    fn blocks(&self, level: usize) -> impl Iterator<Item = &(u64, u64)> {
        self.bands.iter().flat_map(move |levels| &levels[level].blocks)
    }

    fn tags(&self, index: usize) -> Directory {
        let (level, overview, bands) = (&self.bands[0][index], index > 0, self.bands.len());
        let (block_rows, block_cols) = level.block();
        let float = self.options.sample == SampleType::F32;
        let format = if float { SampleFormat::IEEEFP } else { SampleFormat::Uint };
        let short = |value: u16| Field::Short(vec![value]);
        let each = |value: u16| Field::Short(vec![value; bands]);
        let plan = if bands > 1 { PlanarConfiguration::Planar } else { PlanarConfiguration::Chunky };
        let long = |value: usize| Field::Long(vec![value as u32]);
        let mut tags = Directory::from([
            (Tag::ImageWidth, long(level.cols)),
            (Tag::ImageLength, long(level.rows)),
            (Tag::BitsPerSample, each(8 * self.options.sample.bytes() as u16)),
            (Tag::Compression, short(self.coding.compression_method().to_u16())),
            (Tag::PhotometricInterpretation, short(PhotometricInterpretation::BlackIsZero.to_u16())),
            (Tag::SamplesPerPixel, short(bands as u16)),
            (Tag::PlanarConfiguration, short(plan.to_u16())),
            (Tag::Predictor, short(self.coding.predictor().to_u16())),
            (Tag::TileWidth, long(block_cols)),
            (Tag::TileLength, long(block_rows)),
            (Tag::TileOffsets, Field::Offset(vec![0; self.blocks(index).count()])),
            (Tag::TileByteCounts, Field::Long(self.blocks(index).map(|&(_, length)| length as u32).collect())),
            (Tag::SampleFormat, each(format.to_u16())),
        ]);
        if bands > 1 {
            // The other bands are neither colours nor transparency.
            tags.insert(Tag::ExtraSamples, Field::Short(vec![0; bands - 1]));
        }
        if float {
            tags.insert(Tag::GdalNodata, Field::Text(NODATA_TEXT.into()));
        } else if self.coding.zero_is_nodata {
            tags.insert(Tag::GdalNodata, Field::Text("0".into()));
        }
        if overview {
            tags.insert(Tag::NewSubfileType, Field::Long(vec![REDUCED]));
            return tags;
        }
        if let Some(georef) = &self.georef {
            insert_georef(&mut tags, georef);
        }
        let items = items(&self.options);
        if !items.is_empty() {
            tags.insert(tag::GDAL_METADATA, Field::Text(metadata::format(&items)));
        }
        tags
    }
}

fn insert_georef(tags: &mut Directory, georef: &GeoRef) {
    let mut t = georef.transform;
    if georef.crs.pixel_is_point() {
        t[0] += 0.5 * (t[1] + t[2]);
        t[3] += 0.5 * (t[4] + t[5]);
    }
    if t[1] > 0.0 && t[5] < 0.0 && t[2] == 0.0 && t[4] == 0.0 {
        tags.insert(Tag::ModelPixelScaleTag, Field::Double(vec![t[1], -t[5], 0.0]));
        tags.insert(Tag::ModelTiepointTag, Field::Double(vec![0.0, 0.0, 0.0, t[0], t[3], 0.0]));
    } else {
        let matrix = vec![t[1], t[2], 0.0, t[0], t[4], t[5], 0.0, t[3], 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        tags.insert(Tag::ModelTransformationTag, Field::Double(matrix));
    }
    let crs = &georef.crs;
    if !crs.is_empty() {
        tags.insert(Tag::GeoKeyDirectoryTag, Field::Short(crs.directory.clone()));
        if !crs.doubles.is_empty() {
            tags.insert(Tag::GeoDoubleParamsTag, Field::Double(crs.doubles.clone()));
        }
        if !crs.ascii.is_empty() {
            tags.insert(Tag::GeoAsciiParamsTag, Field::Text(crs.ascii.clone()));
        }
    }
}

fn items(options: &WriteOptions) -> Vec<Item> {
    let free =
        |(name, text): &(String, String)| Item { name: name.clone(), role: String::new(), band: 0, text: text.clone() };
    let of_band = |band: usize, name: &str, role: &str, text: &String| Item {
        name: name.into(),
        role: role.into(),
        band,
        text: text.clone(),
    };
    let mut items: Vec<Item> = options.items.iter().map(free).collect();
    let more = options.more_bands.iter().map(|band| (Some(&band.description), band.unit.as_ref()));
    let bands = [(options.description.as_ref(), options.unit.as_ref())].into_iter().chain(more);
    for (band, (description, unit)) in bands.enumerate() {
        items.extend(unit.map(|unit| of_band(band, "UNITTYPE", "unittype", unit)));
        items.extend(description.map(|text| of_band(band, "DESCRIPTION", "description", text)));
    }
    items
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_beyond_4_gib_is_a_big_tiff() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = Writer::create(&folder.path().join("a.tif"), 1, 1, None, &WriteOptions::heights("t")).unwrap();
        writer.write_rows(&[1.0]).unwrap();
        let head_bytes = writer.head().len() as u64;
        for (spilled_bytes, magic) in [(0, 42), ((1 << 32) - 1 - head_bytes, 42), ((1 << 32) - head_bytes, 43)] {
            writer.spilled_bytes = spilled_bytes;
            assert_eq!(writer.head()[2], magic, "{spilled_bytes}");
        }
    }
}
