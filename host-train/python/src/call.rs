//! A command of `elunar`, on files and arrays.

use crate::Model;
use crate::errors::named;
use crate::held::{Array, hold};
use crate::work;
use clap::Parser;
use elunar::cli::{Cli, Command, Shared, diff, evaluate, hillshade, lola, mosaic, render, sfs};
use elunar::held::Held;
use elunar::job::{self, Done, MemoryJob, PredictedMaps, Request};
use elunar::program::usage_line;
use elunar_base::{Error, Result};
use elunar_raster::GeoRef;
use elunar_scene::predict::int8::Int8Model;
use elunar_scene::predict::network;
use numpy::{Element, PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::Path;
use std::sync::Arc;

/// A map of a result.
enum Map {
    Heights(Vec<f32>),
    Codes(Vec<u8>),
}

/// What a command has made.
#[derive(Default)]
struct Outcome {
    text: String,
    json: Option<String>,
    maps: Vec<(&'static str, Map)>,
    shape: (usize, usize),
    transform: Option<[f64; 6]>,
}

impl Outcome {
    fn text(text: String) -> Self {
        Self { text, ..Self::default() }
    }

    fn json(json: String) -> Self {
        Self { json: Some(json), ..Self::default() }
    }

    /// Adds maps of one grid.
    fn with(self, shape: (usize, usize), georef: Option<&GeoRef>, maps: Vec<(&'static str, Map)>) -> Self {
        Self { maps, shape, transform: georef.map(|georef| georef.transform), ..self }
    }

    fn dict<'py>(self, py: Python<'py>, said: Vec<(&'static str, String)>) -> PyResult<Bound<'py, PyDict>> {
        let (dict, maps) = (PyDict::new(py), PyDict::new(py));
        for (name, map) in self.maps {
            let map = match map {
                Map::Heights(samples) => array(py, samples, self.shape)?,
                Map::Codes(samples) => array(py, samples, self.shape)?,
            };
            maps.set_item(name, map)?;
        }
        dict.set_item("text", self.text)?;
        dict.set_item("json", self.json)?;
        dict.set_item("maps", maps)?;
        dict.set_item("transform", self.transform)?;
        dict.set_item("said", said)?;
        Ok(dict)
    }
}

fn array<T: Element>(py: Python<'_>, samples: Vec<T>, (rows, cols): (usize, usize)) -> PyResult<Bound<'_, PyAny>> {
    Ok(PyArray1::from_vec(py, samples).reshape([rows, cols])?.into_any())
}

/// What a call has besides the command line.
struct Besides {
    held: Held,
    in_memory: bool,
    model: Option<Arc<Int8Model>>,
    expected_errors: bool,
    coarse_pixel_m: Option<f64>,
}

/// Runs a command line, without the program's name. `arrays` stand for files of their names. `in_memory` returns rasters instead of writing them.
/// The other arguments are for `predict`.
#[pyfunction]
#[pyo3(signature = (words, arrays, in_memory, progress=None, model=None, expected_errors=false, coarse_pixel_m=None))]
#[expect(clippy::too_many_arguments, reason = "Python names them")]
pub(crate) fn call<'py>(
    py: Python<'py>,
    words: Vec<String>,
    arrays: Vec<Array<'py>>,
    in_memory: bool,
    progress: Option<&Bound<'py, PyAny>>,
    model: Option<&Model>,
    expected_errors: bool,
    coarse_pixel_m: Option<f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let parsed = Cli::try_parse_from(std::iter::once("elunar".to_string()).chain(words));
    let parsed = parsed.map_err(|error| named(py, "usage", usage_line(&error)))?;
    let model = model.map(|model| Arc::clone(&model.model));
    let besides = Besides { held: hold(py, arrays)?, in_memory, model, expected_errors, coarse_pixel_m };
    let threads = match &parsed.command {
        Command::Predict(args) => args.request.threads,
        Command::Shared(Shared::Sfs(args)) => args.threads,
        _ => 0,
    };
    let (outcome, said) = work::run(py, threads, progress, move || run(parsed.command, besides))?;
    outcome.dict(py, said)
}

fn run(command: Command, besides: Besides) -> Result<Outcome> {
    let Besides { held, in_memory, .. } = &besides;
    match command {
        Command::Predict(args) => predict(&args.request, besides),
        Command::Shared(Shared::Sfs(args)) if *in_memory => {
            let solving = sfs::Solving::open(&args, held)?;
            let heights_m = solving.make()?;
            let (scene, maps) = (&solving.scene, vec![("heights", Map::Heights(heights_m))]);
            Ok(Outcome::json(solving.json()).with((scene.rows, scene.cols), Some(&scene.georef), maps))
        }
        Command::Shared(Shared::Sfs(args)) => {
            let (text, json) = sfs::write(&args)?;
            Ok(Outcome { text, ..Outcome::json(json) })
        }
        Command::Shared(Shared::Evaluate(args)) => {
            let (summary, details) = evaluate::compare(&args, held)?;
            Ok(Outcome::json(elunar_evaluate::json(summary, &details)))
        }
        Command::Shared(Shared::Hillshade(args)) if *in_memory => {
            let (shade, mut bytes) = (hillshade::ShadedDtm::open(&args, held)?, vec![]);
            shade.make(&mut |rows| {
                bytes.extend(rows);
                Ok(())
            })?;
            Ok(Outcome::default().with(shade.shape(), None, vec![("shade", Map::Codes(bytes))]))
        }
        Command::Shared(Shared::Hillshade(args)) => hillshade::write(&args, held).map(Outcome::text),
        Command::Shared(Shared::Render(args)) if *in_memory => {
            let image = render::image(&args, held)?;
            let (shape, samples) = ((image.rows, image.cols), image.samples);
            Ok(Outcome::default().with(shape, image.georef.as_ref(), vec![("image", Map::Heights(samples))]))
        }
        Command::Shared(Shared::Render(args)) => render::write(&args, held).map(Outcome::text),
        Command::Shared(Shared::Diff(args)) => {
            let diff::MadeDifference { difference, statistics, what } = diff::make(&args, held)?;
            let (shape, samples) = ((difference.rows, difference.cols), difference.samples);
            let made = Outcome::json(diff::json(&statistics, &what).to_string());
            Ok(made.with(shape, difference.georef.as_ref(), vec![("difference", Map::Heights(samples))]))
        }
        Command::Shared(Shared::Mosaic(args)) if *in_memory => {
            let (joining, mut heights_m) = (mosaic::Joining::open(&args, held)?, vec![]);
            let joined = joining.make(&mut |rows| {
                heights_m.extend_from_slice(rows);
                Ok(())
            })?;
            joining.warn("mosaic", &joined);
            let (grid, maps) = (&joining.grid, vec![("heights", Map::Heights(heights_m))]);
            Ok(Outcome::default().with((grid.rows, grid.cols), Some(&grid.georef), maps))
        }
        Command::Shared(Shared::Mosaic(args)) => mosaic::write(&args, held).map(Outcome::text),
        Command::Shared(Shared::Lola(args)) => {
            let report = lola::compare(&args, held)?;
            Ok(Outcome::json(elunar_evaluate::lola::report::json(&report).to_string()))
        }
        _ => Err(Error::usage("predict, sfs, evaluate, hillshade, render, diff, mosaic or lola expected")),
    }
}

fn predict(request: &Request, besides: Besides) -> Result<Outcome> {
    let Besides { held, in_memory, model, expected_errors, coarse_pixel_m } = besides;
    let open = |path: &Path| -> Result<Box<dyn network::TileModel>> {
        model.map_or_else(|| job::open(path), |model| Ok(Box::new(model)))
    };
    if !in_memory {
        let Done { text, json } = job::run(request, None, open)?;
        return Ok(Outcome { text, json, ..Outcome::default() });
    }
    let PredictedMaps { maps, shape, georef, json } =
        job::predict(request, &MemoryJob { held, expected_errors, coarse_pixel_m }, open)?;
    let mut all = vec![("heights", Map::Heights(maps.heights_m))];
    if let Some(errors) = maps.errors {
        all.push(("sigma", Map::Heights(errors.heights_m)));
        all.push(("slope_sigma", Map::Heights(errors.slopes)));
        all.push(("origin", Map::Codes(errors.origins)));
    }
    Ok(Outcome::json(json).with(shape, Some(&georef), all))
}
