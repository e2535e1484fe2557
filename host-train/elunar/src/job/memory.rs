//! A prediction in memory: the inputs may be held, and the maps come back. Nothing is written.

use super::Watch;
use super::request::Request;
use super::task::Work;
use super::tracks::{Seen, Tracks};
use super::write::Found;
use crate::held::Held;
use elunar_base::Result;
use elunar_net::sun::check_sun;
use elunar_raster::GeoRef;
use elunar_scene::predict::Maps;
use elunar_scene::predict::job::{survey, tiles};
use elunar_scene::predict::network::TileModel;
use elunar_scene::predict::record::{ErrorsRecord, Phases};
use elunar_scene::predict::span::Span;
use std::path::Path;
use std::time::Instant;

/// The maps of a prediction, and what was taken and found: the object that [`super::run`] returns as JSON, with the names of the request.
#[derive(Debug, Clone)]
pub struct PredictedMaps {
    /// The maps.
    pub maps: Maps,
    /// Their shape: rows, columns.
    pub shape: (usize, usize),
    /// Their place.
    pub georef: GeoRef,
    /// One JSON object.
    pub json: String,
}

/// What a prediction in memory has besides a request.
#[derive(Clone, Default)]
pub struct MemoryJob {
    /// Rasters that stand for files of the request.
    pub held: Held,
    /// Whether expected errors are made, too.
    pub expected_errors: bool,
    /// Side of a pixel of the coarse DTM's own grid, metres, of a coarse DTM that was interpolated [default: that of its pixels].
    pub coarse_pixel_m: Option<f64>,
}

/// Makes the maps of a request as [`super::run`] makes its files: the same heights. Of the outputs only the names are used.
///
/// # Errors
/// If an input cannot be read, the model cannot be opened, or predicting fails.
pub fn predict(
    args: &Request,
    MemoryJob { held, expected_errors, coarse_pixel_m }: &MemoryJob,
    open: impl FnOnce(&Path) -> Result<Box<dyn TileModel>>,
) -> Result<PredictedMaps> {
    let start = Instant::now();
    check_sun(args.inputs.known_sun())?;
    let work = Work::new(args, held, *expected_errors, *coarse_pixel_m, open)?;
    let shape = (work.scene.rows, work.scene.cols);
    let mut watch = Watch::new();
    let survey = survey(&work.scene)?;
    let warnings = work.warn(args, &survey, &work.lighting(&survey))?;
    let survey_s = watch.lap_s();
    let mut maps = Maps::new(shape, *expected_errors)?;
    let mut seen = work.tracks.as_ref().map(Tracks::seen);
    let mut keep = |rows: &[f32]| {
        maps.add(rows);
        seen.iter_mut().for_each(|seen| seen.add(rows));
        Ok(())
    };
    let span = Span { rows: 0..shape.0, from: 0 };
    let tally = tiles(|progress| work.predict(work.light(&survey), &span, &mut keep, progress))?;
    let coarse_sigma = seen.map_or_else(|| Ok(work.told_or_assumed(args)), Seen::sigma)?;
    maps.add_coarse(coarse_sigma.sigma_m);
    let phases = Phases { survey_s, tiles_s: watch.lap_s(), write_s: 0.0 };
    let (mut found, finished) = (Found { survey, warnings, coarse_sigma, start, phases }, maps.finished());
    found.warn_of_heights(args, &work, &finished);
    let errors = finished.origins.map(|origins| ErrorsRecord::new(Path::new(""), coarse_sigma, &origins));
    let json = found.record(args, &work, &tally, &finished, errors).json();
    Ok(PredictedMaps { maps, shape, georef: work.scene.georef, json })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command};
    use crate::job;
    use clap::Parser;
    use elunar_raster::source::InMemory;
    use elunar_raster::{geotiff, source};
    use elunar_synth::{Moon, SynthOptions};
    use std::sync::Arc;

    #[test]
    fn held_rasters_give_the_heights_and_errors_of_files() {
        let folder = tempfile::tempdir().unwrap();
        Moon::new(3, SynthOptions::default()).unwrap().scene(0, 60, 70).unwrap().write(folder.path()).unwrap();
        let at = |name: &str| folder.path().join(name);
        let (image, coarse, output, errors) =
            (at("scene_0000_image.tif"), at("scene_0000_coarse.tif"), at("dtm.tif"), at("errors.tif"));
        let options = [("--image", &image), ("--coarse", &coarse), ("-o", &output), ("--uncertainty", &errors)];
        let words = options.iter().flat_map(|(name, path)| [(*name).into(), path.as_os_str().to_owned()]);
        let first = ["elunar", "predict", "--model", "ground", "--fit-sun"].map(Into::into);
        let Command::Predict(args) = Cli::try_parse_from(first.into_iter().chain(words)).unwrap().command else {
            panic!("another command");
        };
        job::run(&args.request, None, job::open).unwrap();
        let mut held = Held::default();
        for path in [&image, &coarse] {
            held.add(path.as_path(), Arc::new(InMemory::new(source::read(path).unwrap(), None, "memory")));
            std::fs::remove_file(path).unwrap();
        }
        let in_memory = MemoryJob { held, expected_errors: true, coarse_pixel_m: None };
        let made = predict(&args.request, &in_memory, job::open).unwrap();
        let bits = |samples: &[f32]| samples.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        let dtm = geotiff::read(&output).unwrap();
        let sigma = source::read_all(&*geotiff::open_band(&errors, 0).unwrap()).unwrap();
        assert!(made.shape == (60, 70) && Some(&made.georef) == dtm.georef.as_ref());
        assert_eq!(bits(&made.maps.heights_m), bits(&dtm.samples));
        assert_eq!(bits(&made.maps.errors.unwrap().heights_m), bits(&sigma.samples));
        let other = MemoryJob { coarse_pixel_m: Some(1.0), ..in_memory };
        let text = predict(&args.request, &other, job::open).unwrap_err().to_string();
        assert!(text.contains("coarse_pixel_size: pixels of 2 m at least expected"), "{text}");
    }
}
