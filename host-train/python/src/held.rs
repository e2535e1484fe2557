//! Arrays that Python holds, as rasters.

use crate::errors::named;
use elunar::held::Held;
use elunar_core::sun::Body;
use elunar_raster::source::InMemory;
use elunar_raster::sun::StatedSun;
use elunar_raster::{Crs, GeoRef, Raster};
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;
use std::sync::Arc;

/// An array: its name in messages, samples (NaN where invalid), transform in GDAL's order, reference system (a plane in metres without one),
/// type of the samples before they were converted, and azimuth and elevation of the Sun as far as its file states them.
#[derive(FromPyObject)]
pub(crate) struct Array<'py>(
    String,
    PyReadonlyArray2<'py, f32>,
    [f64; 6],
    Option<String>,
    String,
    (Option<f64>, Option<f64>),
);

/// Copies arrays, so that work on them needs no interpreter.
pub(crate) fn hold(py: Python<'_>, arrays: Vec<Array<'_>>) -> PyResult<Held> {
    let mut held = Held::default();
    for Array(name, samples, transform, crs, kind, (azimuth_deg, elevation_deg)) in arrays {
        let parsed =
            crs.map_or_else(|| Ok(Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0)), |text| Crs::parse(&text));
        let crs = parsed.map_err(|why| named(py, "usage", format!("{name}: crs: {why}")))?;
        let [rows, cols] = [samples.shape()[0], samples.shape()[1]];
        let samples = samples.as_array().iter().copied().collect();
        let raster = Raster { rows, cols, samples, georef: Some(GeoRef { transform, crs }) };
        let sun = StatedSun { azimuth_deg, elevation_deg, time: None };
        held.add(name, Arc::new(InMemory::new(raster, None, format!("array, {kind}")).with_sun(sun)));
    }
    Ok(held)
}
