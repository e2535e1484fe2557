//! Runs the int8 runner with input and output by pipes, so that it can be measured in turn with other runtimes; see `README.md`.
//!
//! `tile_server MODEL.eld [KERNEL]` prints one line of JSON about the model. Then it answers every tile on standard input (image, then
//! coarse DTM, little-endian `f32`, rows x cols each) with the seconds (`f64`) and the output (`f32`), until the input ends. It has one
//! thread; the measured time includes the quantisation of the floats.

use elunar_core::nn::required;
use elunar_core::tile::Shape;
use elunar_net::kernels;
use elunar_scene::predict::int8::{self, Int8Model};
use elunar_scene::predict::network::TileModel;
use std::error::Error;
use std::io::{ErrorKind, Read, Write};
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let result = match &arguments[..] {
        [path] => serve(path, None),
        [path, kernel] => serve(path, Some(kernel)),
        _ => Err("expected MODEL.eld [KERNEL]".into()),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("ERROR: tile_server: {error}");
            ExitCode::FAILURE
        }
    }
}

fn open(path: &str, kernel: Option<&str>) -> Result<Int8Model, Box<dyn Error>> {
    let model = int8::open(Path::new(path))?.in_large_steps()?;
    let Some(name) = kernel else { return Ok(model) };
    let found = kernels::kernels().find(|kernel| kernel.name() == name);
    Ok(model.with_kernel(found.ok_or_else(|| format!("expected a kernel of this processor, found {name}"))?))
}

fn serve(path: &str, kernel: Option<&str>) -> Result<(), Box<dyn Error>> {
    let model = open(path, kernel)?;
    let Shape { rows, cols } = model.tile();
    let (mut input, mut output) = (std::io::stdin().lock(), std::io::stdout().lock());
    let facts = model.model();
    writeln!(
        output,
        r#"{{"kernel": "{}", "rows": {rows}, "cols": {cols}, "macs": {}, "arena_bytes": {}}}"#,
        model.kernel().name(),
        facts.macs(),
        required(&facts)
    )?;
    output.flush()?;
    let mut worker = model.worker()?;
    let image_len = facts.image_maps() * rows * cols;
    let (mut bytes, mut heights) = (vec![0; 4 * (image_len + rows * cols)], vec![0.0; rows * cols]);
    while let Some(tile) = read_tile(&mut input, &mut bytes)? {
        let (image, coarse) = tile.split_at(image_len);
        let start = Instant::now();
        worker.predict(image, coarse, &mut heights)?;
        let seconds = start.elapsed().as_secs_f64();
        output.write_all(&seconds.to_le_bytes())?;
        output.write_all(&heights.iter().flat_map(|z| z.to_le_bytes()).collect::<Vec<u8>>())?;
        output.flush()?;
    }
    Ok(())
}

/// Returns the numbers of the next tile; `None` at the end of the input.
fn read_tile(input: &mut impl Read, bytes: &mut [u8]) -> std::io::Result<Option<Vec<f32>>> {
    match input.read_exact(bytes) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(None),
        other => other?,
    }
    Ok(Some(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()))
}
