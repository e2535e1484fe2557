//! Damaged files of every kind are refused or read. The reader never panics and never needs more memory than the file can hold.

use super::tests::{heights, scratch};
use super::*;
use elunar_testing::rasterio as gdal;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::path::Path;
use std::process::Command;

/// Number of mutants of each seed file.
const MUTANTS: usize = 150;

/// Values with a meaning in a TIFF: types, tags, sizes at the edge of their range.
const WORDS: [u32; 14] = [0, 1, 2, 3, 5, 7, 8, 16, 0xFF, 0x7FFF, 0xFFFF, 0x8000_0000, 0x7FFF_FFFF, 0xFFFF_FFFF];

fn mutate(bytes: &mut Vec<u8>, rng: &mut ChaCha8Rng) {
    // Most of the structure is in the head, so half of the changes go there.
    let head = bytes.len().min(1024);
    for _ in 0..rng.random_range(1..5) {
        if bytes.len() < 16 {
            return;
        }
        let range = if rng.random() { head.min(bytes.len()) } else { bytes.len() };
        let at = rng.random_range(0..range);
        match rng.random_range(0..6) {
            0 => bytes[at] = rng.random(),
            1 => bytes[at] ^= 1 << rng.random_range(0..8),
            2 => bytes.truncate(at.max(8)),
            3 => {
                let word = WORDS[rng.random_range(0..WORDS.len())].to_le_bytes();
                let width = [1, 2, 4][rng.random_range(0..3)].min(bytes.len() - at);
                bytes[at..at + width].copy_from_slice(&word[..width]);
            }
            4 => {
                let end = (at + rng.random_range(1..20)).min(bytes.len());
                drop(bytes.drain(at..end));
            }
            _ => {
                let (from, length) = (rng.random_range(0..bytes.len()), rng.random_range(1..24));
                let copy = bytes[from..(from + length).min(bytes.len())].to_vec();
                let end = (at + copy.len()).min(bytes.len());
                bytes[at..end].copy_from_slice(&copy[..end - at]);
            }
        }
    }
}

/// Writes small files with our writer, and with GDAL's if it is available.
fn make_seeds(folder: &Path) {
    for compression in [Compression::None, Compression::Lzw, Compression::Deflate, Compression::Zstd] {
        let mut options = WriteOptions::heights("seed").with_compression(compression).with_item("A", "b");
        write(&folder.join(format!("f32_{compression:?}.tif")), &heights(20, 17), &options).unwrap();
        options.force_big = true;
        write(&folder.join(format!("big_{compression:?}.tif")), &heights(20, 17), &options).unwrap();
        let mut image = heights(33, 40);
        image.samples.iter_mut().for_each(|v| *v = v.abs().min(255.0));
        for sample in [SampleType::U8, SampleType::U16] {
            let options = WriteOptions::image(sample, "seed").with_compression(compression);
            write(&folder.join(format!("{sample:?}_{compression:?}.tif")), &image, &options).unwrap();
        }
    }
    write(&folder.join("overviews.tif"), &heights(3, 600), &WriteOptions::heights("seed")).unwrap();
    let script = "
crs = rasterio.crs.CRS.from_proj4('+proj=stere +lat_0=-90 +R=1737400')
a = np.random.default_rng(1).integers(0, 200, (40, 33))
def make(name, dtype, **more):
    with rasterio.open(name + '.tif', 'w', driver='GTiff', width=33, height=40, count=1, dtype=dtype, crs=crs, nodata=7,
                       transform=Affine(2, 0, 100, 0, -3, 500), **more) as d:
        d.write(a.astype(dtype), 1)
make('gdal_jpeg', 'uint8', compress='jpeg', tiled=True, blockxsize=16, blockysize=16)
make('gdal_jpeg_strips', 'uint8', compress='jpeg')
make('gdal_packbits', 'int16', compress='packbits', blockysize=3)
make('gdal_rows', 'float64', blockysize=1, ENDIANNESS='BIG')
make('gdal_one_strip', 'int32', blockysize=40)
make('gdal_lzw', 'float32', compress='lzw', predictor=3, tiled=True, blockxsize=32, blockysize=16)
make('gdal_lzw_big_endian', 'int32', compress='lzw', predictor=2, ENDIANNESS='BIG')
make('gdal_zstd', 'float64', compress='zstd', predictor=3, BIGTIFF='YES')
make('gdal_deflate', 'uint32', compress='deflate', predictor=2, SPARSE_OK=True)
";
    gdal(script, folder);
}

const CHILD_FOLDER: &str = "ELUNAR_TEST_MUTANTS";

/// The test runner does not start this test directly. The test below starts it in a separate process under a memory limit.
#[test]
#[ignore = "run by damaged_files_never_panic_or_swallow_memory"]
fn child_reading_mutants() {
    let folder = std::path::PathBuf::from(std::env::var(CHILD_FOLDER).expect("the parent's folder"));
    let mut seeds: Vec<_> = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    seeds.sort();
    let (mut refused, mut panics) = (0, vec![]);
    let path = folder.join("mutant");
    for seed in &seeds {
        let whole = std::fs::read(seed).unwrap();
        read(seed).unwrap_or_else(|e| panic!("{e}"));
        for number in 0..MUTANTS {
            let mut bytes = whole.clone();
            mutate(&mut bytes, &mut ChaCha8Rng::seed_from_u64(number as u64));
            std::fs::write(&path, &bytes).unwrap();
            match std::panic::catch_unwind(|| read(&path).is_err()) {
                Ok(error) => refused += usize::from(error),
                Err(_) => panics.push(format!("{}: mutant {number}", seed.file_name().unwrap().display())),
            }
        }
    }
    let all = seeds.len() * MUTANTS;
    println!("{refused} of {all} mutants of {} files refused", seeds.len());
    assert!(panics.is_empty(), "{} of {all} panicked: {:#?}", panics.len(), &panics[..panics.len().min(20)]);
    assert!(refused > all / 4, "mutations that harm nothing test nothing");
}

/// A process with at most 1 GiB of address space, threads' stacks included, reads the mutants. A larger allocation for a small file ends
/// the process.
#[test]
#[cfg(unix)]
fn damaged_files_never_panic_or_swallow_memory() {
    let folder = scratch();
    make_seeds(folder.path());
    let test = "geotiff::mutation_tests::child_reading_mutants";
    let out = Command::new("bash")
        .args(["-c", "ulimit -v 1048576 && exec \"$0\" \"$@\""])
        .arg(std::env::current_exe().unwrap())
        .args(["--exact", test, "--ignored", "--nocapture"])
        .env(CHILD_FOLDER, folder.path())
        .output()
        .expect("bash");
    let (text, trouble) = (String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    println!("{text}");
    assert!(out.status.success() && text.contains("1 passed"), "{text}\n{trouble}");
}
