//! `view`: the maps that the page draws, on the image's grid, in one file.
//!
//! ```text
//! one line of JSON, filled with spaces to a multiple of four bytes:  {"rows":R,"cols":C,"row_m":M,"col_m":M,"maps":["image", ...]}
//! for every map:  R x C samples, f32, little-endian, row-major; NaN where there is no value
//! ```

use elunar::held::Held;
use elunar::job::{Inputs, Opened};
use elunar_base::{Error, Result, atomic_write};
use elunar_core::terrain::{HazardLimits, LineMaps, LineOptions, MAX_RADIUS_PX, PixelSize, Sun, TerrainLines};
use elunar_core::tile::Window;
use elunar_raster::align::{Interpolation, Onto};
use elunar_raster::{Raster, geotiff, source};
use std::path::PathBuf;

/// Options of `view`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Image and coarse DTM.
    #[command(flatten)]
    inputs: Inputs,
    /// The DTM that `predict` made of them.
    #[arg(long, value_name = "DTM.tif")]
    dtm: Option<PathBuf>,
    /// Its expected errors.
    #[arg(long, value_name = "ERR.tif", requires = "dtm")]
    uncertainty: Option<PathBuf>,
    /// The truth, if there is one; interpolated bilinearly onto the DTM's grid.
    #[arg(long, value_name = "T.tif", requires = "dtm")]
    truth: Option<PathBuf>,
    /// Radius of a vehicle's footprint, metres.
    #[arg(long, value_name = "M", default_value_t = 5.0)]
    footprint: f64,
    /// File to write.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// If an input cannot be read, its grid is another, or the file cannot be written.
pub(crate) fn run(args: &Args) -> Result<()> {
    let held = Held::default();
    let Opened { scene, .. } = args.inputs.open(&held)?;
    let band = scene.band(0, scene.rows)?;
    let shape = (scene.rows, scene.cols);
    let (row_m, col_m) = scene.georef.pixel_m(shape.0, shape.1).unwrap_or_default();
    let mut maps = vec![("image", band.image), ("coarse", band.coarse_m)];
    if let Some(dtm) = &args.dtm {
        let heights_m = of_shape(source::read_all(&*source::open(dtm)?)?, shape, dtm)?;
        let [slope_deg, roughness_m] = terrain(&heights_m, shape.1, PixelSize { row_m, col_m }, args.footprint)?;
        maps.extend([("heights", heights_m), ("slope", slope_deg), ("roughness", roughness_m)]);
    }
    if let Some(errors) = &args.uncertainty {
        maps.push(("sigma", of_shape(source::read_all(&*geotiff::open_band(errors, 0)?)?, shape, errors)?));
    }
    if let (Some(truth), Some(dtm)) = (&args.truth, &args.dtm) {
        let name = |path: &std::path::Path| path.display().to_string();
        let on_dtm = source::open(dtm)?;
        let source = held.heights(truth)?.into();
        let onto = Onto::new(source, &name(truth), on_dtm.info(), &name(dtm), Interpolation::Bilinear)?;
        maps.push(("truth", onto.read(Window { row: 0, col: 0, rows: shape.0, cols: shape.1 })?));
    }
    let names: Vec<&str> = maps.iter().map(|(name, _)| *name).collect();
    let head = serde_json::json!({ "rows": shape.0, "cols": shape.1, "row_m": row_m, "col_m": col_m, "maps": names });
    let mut bytes = head.to_string().into_bytes();
    bytes.resize((bytes.len() + 1).next_multiple_of(4) - 1, b' ');
    bytes.push(b'\n');
    bytes.extend(maps.iter().flat_map(|(_, samples)| samples).flat_map(|sample| sample.to_le_bytes()));
    atomic_write(&args.output, &bytes)
}

/// Returns the samples of a raster that has the image's shape.
fn of_shape(raster: Raster, (rows, cols): (usize, usize), path: &std::path::Path) -> Result<Vec<f32>> {
    if (raster.rows, raster.cols) == (rows, cols) {
        return Ok(raster.samples);
    }
    let what = format!("{rows} x {cols} pixels expected, {} x {} found", raster.rows, raster.cols);
    Err(Error::input(format!("{}: {what}", path.display())))
}

/// Returns slope (degrees) and roughness (metres) of the footprint around every pixel.
fn terrain(heights_m: &[f32], cols: usize, pixel: PixelSize, footprint_m: f64) -> Result<[Vec<f32>; 2]> {
    let refused = |error: elunar_core::terrain::TerrainError| Error::usage(format!("footprint: {error}"));
    let radius_px = ((footprint_m / pixel.col_m.max(f64::MIN_POSITIVE)).round() as usize).clamp(1, MAX_RADIUS_PX);
    // The page compares with the user's limits.
    let limits = HazardLimits::new(90.0, f32::MAX).map_err(refused)?;
    let options = LineOptions { cols, pixel, radius_px, sun: Sun::default(), limits };
    let mut memory = vec![0.0; options.memory_len()];
    let mut lines = TerrainLines::new(options, &mut memory).map_err(refused)?;
    let [mut slope_deg, mut roughness_m] = [vec![0.0; heights_m.len()], vec![0.0; heights_m.len()]];
    let mut out = slope_deg.chunks_exact_mut(cols).zip(roughness_m.chunks_exact_mut(cols)).peekable();
    let mut given = heights_m.chunks_exact(cols);
    while let Some((slopes, roughness)) = out.peek_mut() {
        let mut maps = LineMaps { footprint_slope_deg: slopes, roughness_m: roughness, ..LineMaps::default() };
        let made = match given.next() {
            Some(line) => lines.push(line, &mut maps),
            None => lines.finish(&mut maps),
        };
        if made.map_err(refused)?.is_some() {
            out.next();
        }
    }
    Ok([slope_deg, roughness_m])
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use elunar::job;
    use elunar_synth::{Moon, SynthOptions};

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn the_maps_are_those_of_the_files() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).display().to_string();
        Moon::new(3, SynthOptions::default()).unwrap().scene(0, 60, 70).unwrap().write(folder.path()).unwrap();
        let (image, coarse) = (at("scene_0000_image.tif"), at("scene_0000_coarse.tif"));
        let inputs = ["x", "--image", &image, "--coarse", &coarse];
        let (dtm, errors, output) = (at("dtm.tif"), at("errors.tif"), at("maps"));
        #[derive(Parser)]
        struct Predict {
            #[command(flatten)]
            request: job::Request,
        }
        let of_predict = ["--model", "ground", "--uncertainty", &errors, "-o", &dtm];
        job::run(&Predict::parse_from(inputs.iter().chain(&of_predict)).request, None, job::open).unwrap();
        let truth = at("scene_0000_truth.tif");
        let of_view = ["--dtm", &dtm, "--uncertainty", &errors, "--truth", &truth, "-o", &output];
        run(&Line::parse_from(inputs.iter().chain(&of_view)).args).unwrap();
        let bytes = std::fs::read(&output).unwrap();
        let end = bytes.iter().position(|b| *b == b'\n').unwrap() + 1;
        let head: serde_json::Value = serde_json::from_slice(&bytes[..end]).unwrap();
        let names = ["image", "coarse", "heights", "slope", "roughness", "sigma", "truth"];
        assert_eq!((&head["rows"], &head["cols"], &head["maps"]), (&60.into(), &70.into(), &names.as_slice().into()));
        assert!(end % 4 == 0 && bytes.len() == end + 4 * 60 * 70 * names.len());
        let map = |k: usize| &bytes[end + 4 * 4200 * k..][..4 * 4200];
        let heights: Vec<u8> =
            geotiff::read(std::path::Path::new(&dtm)).unwrap().samples.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(map(2), heights);
        let middle = f32::from_le_bytes(map(6)[4 * (30 * 70 + 35)..][..4].try_into().unwrap());
        assert_eq!(middle, geotiff::read(std::path::Path::new(&truth)).unwrap().samples[30 * 70 + 35]);
        let slope = f32::from_le_bytes(map(3)[4 * (30 * 70 + 35)..][..4].try_into().unwrap());
        assert!((0.0..60.0).contains(&slope) && map(3)[..4] == f32::NAN.to_le_bytes(), "{slope}");
        let other = ["--dtm", &coarse, "-o", &output];
        let error = run(&Line::parse_from(inputs.iter().chain(&other)).args).unwrap_err().to_string();
        assert!(error.contains("60 x 70 pixels expected"), "{error}");
    }
}
