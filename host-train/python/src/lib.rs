//! The native part of the Python package `elunardtm`: one function that runs a command of `elunar` on files and arrays, and the models. Names,
//! options and their rules are those of the command line.

mod call;
mod errors;
mod held;
mod work;

use elunar::cli::Cli;
use elunar_base::SOFTWARE;
use elunar_core::sun::{Body, UtcTime, sub_solar};
use elunar_evaluate::CorrelatedErrors;
use elunar_scene::predict::int8::{self, Int8Model};
use elunar_scene::predict::network::TileModel as _;
use elunar_synth::{Moon, SynthOptions};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A model of the int8 runner.
#[pyclass(frozen, module = "elunardtm._native")]
struct Model {
    model: Arc<Int8Model>,
}

#[pymethods]
impl Model {
    /// Opens a shipped model by its name, or a file.
    #[new]
    fn new(py: Python<'_>, path: &str) -> PyResult<Self> {
        let opened = py.detach(|| int8::open(Path::new(path))?.in_large_steps());
        Ok(Self { model: Arc::new(opened.map_err(|error| errors::raise(py, &error))?) })
    }

    /// One line: kind, name, SHA-256 of the file.
    #[getter]
    fn description(&self) -> String {
        self.model.description()
    }

    /// Rows and columns of a tile.
    #[getter]
    fn tile(&self) -> (usize, usize) {
        let tile = self.model.tile();
        (tile.rows, tile.cols)
    }
}

/// Returns the standard deviation of a mean height, metres, as [`CorrelatedErrors::sigma_of_mean`] does: NaN for no pixels. `sigma` and `inside` are of
/// one shape.
#[pyfunction]
fn sigma_of_mean(
    py: Python<'_>,
    sigma: PyReadonlyArray2<'_, f32>,
    inside: PyReadonlyArray2<'_, bool>,
    sizes_m: [f64; 2],
    coarse_m: [f64; 2],
) -> f64 {
    let ([pixel_m, coarse_pixel_m], [coarse_sigma_m, coarse_correlation_m]) = (sizes_m, coarse_m);
    let errors = CorrelatedErrors { pixel_m, coarse_pixel_m, coarse_sigma_m, coarse_correlation_m };
    let cols = sigma.shape()[1];
    let sigma: Vec<f32> = sigma.as_array().iter().copied().collect();
    let inside: Vec<bool> = inside.as_array().iter().copied().collect();
    py.detach(|| errors.sigma_of_mean(&sigma, &inside, cols)).unwrap_or(f64::NAN)
}

/// Returns the options of a command, as on the command line, without the dashes.
#[pyfunction]
fn options(command: &str) -> Vec<String> {
    let program = <Cli as clap::CommandFactory>::command();
    let found = program.find_subcommand(command);
    let names = |command: &clap::Command| command.get_arguments().map(|arg| arg.get_id().to_string()).collect();
    found.map(names).unwrap_or_default()
}

/// Azimuth and elevation of the Sun at a place, degrees.
#[pyfunction]
fn sun(py: Python<'_>, time: &str, lon: f64, lat: f64, mars: bool) -> PyResult<(f64, f64)> {
    let time: UtcTime = time.parse().map_err(|why| errors::named(py, "usage", format!("time: {why}, found {time}")))?;
    let body = if mars { Body::Mars } else { Body::Moon };
    let direction = sub_solar(body, time).seen_from(lat, lon);
    Ok((direction.azimuth_deg, direction.elevation_deg))
}

/// Arrays and their transforms, in GDAL's order.
type Maps<'py> = Vec<(Bound<'py, PyAny>, [f64; 6])>;

/// Makes a scene of the synthetic Moon: image, coarse DTM and truth, and azimuth and elevation of the Sun.
#[pyfunction]
fn scene(py: Python<'_>, rows: usize, cols: usize, seed: u64) -> PyResult<(Maps<'_>, f64, f64)> {
    let made = py.detach(|| Moon::new(seed, SynthOptions::default())?.scene(0, rows, cols));
    let made = made.map_err(|error| errors::raise(py, &error))?;
    let map = |raster: elunar_raster::Raster| -> PyResult<(Bound<'_, PyAny>, [f64; 6])> {
        let transform = raster.georef.map(|georef| georef.transform).unwrap_or_default();
        let samples = PyArray1::from_vec(py, raster.samples);
        Ok((samples.reshape([raster.rows, raster.cols])?.into_any(), transform))
    };
    let maps = [made.image_raster(), made.coarse_raster(), made.truth_raster()].into_iter().map(map);
    Ok((maps.collect::<PyResult<_>>()?, made.sun_azimuth_deg, made.sun_elevation_deg))
}

/// Writes the files of such a scene into a folder, and returns their names.
#[pyfunction]
fn write_scene(py: Python<'_>, folder: PathBuf, rows: usize, cols: usize, seed: u64) -> PyResult<[String; 3]> {
    let write = || Moon::new(seed, SynthOptions::default())?.scene(0, rows, cols)?.write(&folder);
    py.detach(write).map_err(|error| errors::raise(py, &error))?;
    Ok(elunar_synth::scene_files(0))
}

#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("SOFTWARE", SOFTWARE)?;
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<Model>()?;
    module.add_function(wrap_pyfunction!(call::call, module)?)?;
    module.add_function(wrap_pyfunction!(options, module)?)?;
    module.add_function(wrap_pyfunction!(scene, module)?)?;
    module.add_function(wrap_pyfunction!(sigma_of_mean, module)?)?;
    module.add_function(wrap_pyfunction!(sun, module)?)?;
    module.add_function(wrap_pyfunction!(write_scene, module)?)
}
