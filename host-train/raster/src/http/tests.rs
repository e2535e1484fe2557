//! A file on the net is the file of this machine, in few bytes; what servers do wrong is one line.

use super::ask::Patience;
use super::remote::{BLOCK_BYTES, Remote};
use crate::geotiff::{SampleType, WriteOptions, write};
use crate::{Raster, source};
use elunar_base::Error;
use elunar_core::tile::Window;
use elunar_testing::server::{FileAnswer, FileServer};
use std::path::PathBuf;
use std::time::Duration;

/// Enough for a server of this machine.
const SHORT: Patience = Patience {
    connect: Duration::from_secs(5),
    answer: Duration::from_millis(300),
    tries: 3,
    pause: Duration::from_millis(5),
};

/// Returns a cloud-optimised file of 2,000 x 3,000 pixels that cannot be compressed, and its samples.
fn large() -> (Vec<u8>, Raster) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tif");
    let mut state = 1_u32;
    let mut random = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (state >> 16) as f32
    };
    let (rows, cols) = (2000, 3000);
    let raster = Raster { rows, cols, samples: (0..rows * cols).map(|_| random()).collect(), georef: None };
    write(&path, &raster, &WriteOptions::image(SampleType::U16, "noise")).unwrap();
    (std::fs::read(&path).unwrap(), raster)
}

#[test]
fn windows_are_those_of_the_file_in_few_bytes() {
    let (content, raster) = large();
    let size = content.len();
    let server = FileServer::start(content, |_, _| {});
    let source = source::open(&PathBuf::from(server.url("a.tif"))).unwrap();
    let opened = server.bytes();
    assert!(opened <= 2 * BLOCK_BYTES as usize, "{opened} bytes of {size} to open it");
    let window = Window { row: 700, col: 900, rows: 300, cols: 500 };
    let line = |row: usize| &raster.samples[row * raster.cols + window.col..][..window.cols];
    let expected: Vec<f32> = (700..1000).flat_map(|row| line(row).iter().copied()).collect();
    assert_eq!(source.read(window).unwrap(), expected);
    // Two rows of tiles, three side by side: 0.75 MB of noise.
    let (read, asked) = (server.bytes() - opened, server.asked().len());
    assert!(read < 1_300_000 && asked <= 6 && size > 12_000_000, "{read} bytes of {size} in {asked} questions");
    source.read(window).unwrap();
    assert_eq!(server.asked().len(), asked, "read again");
    assert_eq!(source::read_all(&*source).unwrap(), raster);
    let (all, asked) = (server.bytes(), server.asked().len());
    assert!(all < size + size / 5 && asked < 40, "{all} bytes of {size} in {asked} questions");
}

#[test]
fn readers_share_one_version_as_long_as_one_is_left() {
    let (content, _) = large();
    let server = FileServer::start(content, |number, answer| answer.set("ETag", Some(&format!("\"{}\"", number / 2))));
    let path = PathBuf::from(server.url("a.tif"));
    let first = super::open(&path).unwrap();
    let text = first.identity();
    assert!(text.ends_with(" bytes, ETag \"0\" (no hash of the bytes)") && text.starts_with("http://127"), "{text}");
    assert_eq!(super::open(&path).unwrap().identity(), text);
    drop(first);
    assert_eq!((server.asked().len(), super::open(&path).unwrap().identity()), (1, text.clone()));
    assert_ne!(super::open(&path).unwrap().identity(), text);
}

/// Reads a file of five blocks from a server with these manners. Returns the error of opening or reading.
fn told(manners: impl Fn(usize, &mut FileAnswer) + Send + Sync + 'static) -> Result<usize, Error> {
    let content: Vec<u8> = (0..5 * BLOCK_BYTES).map(|i| (i / 7) as u8).collect();
    let server = FileServer::start(content.clone(), manners);
    let path = PathBuf::from(server.url("b/a.tif?x=1"));
    let remote = Remote::open(&path, SHORT)?;
    let mut found = vec![0; content.len()];
    let mut at = 0;
    while at < found.len() {
        match remote.read_at(at as u64, &mut found[at..]).map_err(Error::io(&path))? {
            0 => break,
            read => at += read,
        }
    }
    assert!(found == content, "other bytes");
    Ok(server.asked().len())
}

#[test]
fn good_servers_of_all_kinds_serve() {
    assert_eq!(told(|_, _| {}).unwrap(), 3, "blocks 0, 1 and 2, 3 and 4");
    assert_eq!(told(|_, answer| answer.set("ETag", None)).unwrap(), 3);
    assert_eq!(told(|_, answer| answer.set("ETag", Some("W/\"weak\""))).unwrap(), 3);
    let redirects = |number, answer: &mut FileAnswer| {
        if number % 2 == 0 {
            answer.status = "302 Found".into();
            answer.set("Location", Some("/c.tif"));
        }
    };
    assert_eq!(told(redirects).unwrap(), 6);
}

#[test]
fn what_may_pass_is_asked_for_again() {
    let cut = |number: usize, answer: &mut FileAnswer| answer.cut = (number % 2 == 1).then_some(1000);
    assert_eq!(told(cut).unwrap(), 5);
    let busy = |number: usize, answer: &mut FileAnswer| {
        if !number.is_multiple_of(3) {
            (answer.status, answer.body) = ("503 Service Unavailable".into(), b"busy".to_vec());
        }
    };
    assert_eq!(told(busy).unwrap(), 7);
    let slow = |number: usize, answer: &mut FileAnswer| {
        answer.wait = Duration::from_millis(if number == 1 { 900 } else { 0 });
    };
    assert_eq!(told(slow).unwrap(), 4);
}

#[test]
fn bad_servers_are_one_line() {
    let line = |manners: fn(usize, &mut FileAnswer), expected: &str| {
        let text = told(manners).expect_err("refused").to_string();
        assert!(text.starts_with("http://127.0.0.1:") && text.contains(expected) && !text.contains('\n'), "{text}");
    };
    let always_cut = |_: usize, answer: &mut FileAnswer| answer.cut = Some(10);
    line(always_cut, "(asked 3 times)");
    line(|_, answer| answer.wait = Duration::from_millis(900), "(asked 3 times)");
    line(
        |_, answer| answer.status = "200 OK".into(),
        "byte ranges expected, found one that sends whole files; this fetches it: curl -L -o a.tif http",
    );
    line(|_, answer| answer.status = "404 Not Found".into(), "the server answers 404 Not Found");
    line(|_, answer| answer.status = "403 Forbidden".into(), "403");
    line(|_, answer| answer.status = "500 Oh".into(), "500 Internal Server Error (asked 3 times)");
    line(|_, answer| answer.set("Content-Range", None), "Content-Range with a length expected, found \"\"");
    line(|_, answer| answer.set("Content-Range", Some("bytes 0-65535/*")), "found \"bytes 0-65535/*\"");
    line(
        |_, answer| answer.set("Content-Range", Some("bytes 1-65536/327680")),
        "bytes 0..65536 expected from the server, found 1..65537",
    );
    line(|_, answer| answer.set("Content-Encoding", Some("gzip")), "encoded");
    let neither = |_: usize, answer: &mut FileAnswer| {
        answer.set("ETag", Some("W/\"a\""));
        answer.set("Last-Modified", None);
    };
    line(neither, "a strong ETag or Last-Modified expected from the server, found neither; this fetches it: curl");
    let longer = |number: usize, answer: &mut FileAnswer| {
        if number > 0 {
            answer.set("Content-Range", Some("bytes 65536-196607/327681"));
        }
    };
    line(longer, "the file changed while it was read: 327680 bytes, ETag \"one\" expected, found 327681 bytes");
    line(
        |number, answer| answer.set("ETag", Some(&format!("\"{number}\""))),
        "ETag \"0\" expected, found 327680 bytes, ETag \"1\"",
    );
    let later = |number: usize, answer: &mut FileAnswer| answer.set("Last-Modified", Some(&format!("day {number}")));
    line(later, "the file changed while it was read");
    line(
        |_, answer| {
            answer.body.pop();
        },
        "65536 bytes expected from the server, 65535 found (asked 3 times)",
    );
    line(|_, answer| answer.body.push(1), "65536 bytes expected from the server, 65537 found");
    let away = Remote::open(&PathBuf::from("http://127.0.0.1:1/a.tif"), SHORT).err().expect("refused").to_string();
    assert!(away.contains("(asked 3 times)"), "{away}");
    let secret = Remote::open(&PathBuf::from("http://me:word@host/a.tif"), SHORT).err().expect("refused").to_string();
    assert!(secret.contains("without user and password expected"), "{secret}");
}

#[test]
fn other_formats_are_fetched_by_the_user() {
    let server = FileServer::start(b"\x93NUMPY rest".to_vec(), |_, _| {});
    let text = source::open(&PathBuf::from(server.url("a.npy"))).err().expect("refused").to_string();
    assert!(text.contains("on the net a GeoTIFF expected, found") && text.contains("curl -L -o a.npy http"), "{text}");
    let server = FileServer::start(vec![], |_, answer| answer.status = "416 Range Not Satisfiable".into());
    let text = source::open(&PathBuf::from(server.url("a.tif"))).err().expect("refused").to_string();
    assert!(text.contains("416"), "{text}");
}
