//! What the cross-spectrum of a candidate and the truth shows: octaves, half-coherence and registration.

use super::cross_spectrum::CrossSpectrum;
use super::octaves::{HalfCoherence, Octave, half_coherence, octaves};
use super::registration::{Registration, registration};
use super::{Comparison, Scored, View};
use elunar_base::Result;
use elunar_core::terrain::PixelSize;
use elunar_picture::{Chart, Series, plot_log_x};
use image::RgbImage;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// A figure of an octave, with its name.
type Curve = (&'static str, fn(&Octave) -> f64);

/// Figures from a cross-spectrum.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Spectral {
    /// Octaves from short to long waves.
    pub octaves: Vec<Octave>,
    /// Effective resolution. `None` if even the longest octave is not coherent.
    pub half_coherence: Option<HalfCoherence>,
    /// Offset from the truth, by the waves longer than the half-coherence wavelength (by all, if there is none). `None` if none was found within an eighth of the sides.
    pub registration: Option<Registration>,
}

/// Compares a candidate of [`super::compare`] with the truth, wave by wave. `None` if the box of the common pixels is narrower than 16 pixels
/// or less than half of it is valid. A box of more than 2^24 pixels is compared block by block.
#[must_use]
pub fn spectral(comparison: &Comparison, scored: &Scored) -> Option<Spectral> {
    let spectrum = CrossSpectrum::of(&comparison.truth_m, &scored.placed)?;
    Some(Spectral::of(&spectrum, comparison.pixel, comparison.resolution_m))
}

impl View<'_> {
    /// Compares every candidate with the truth, wave by wave, as [`spectral`] does.
    ///
    /// # Errors
    /// Errors of reading are passed on.
    pub fn spectra(&self) -> Result<Vec<Option<Spectral>>> {
        let maps = self.maps;
        let of_candidate = |k: usize| {
            let mut read = |window| {
                let mut maps = self.read(window)?;
                Ok([std::mem::take(&mut maps[0]), std::mem::take(&mut maps[k])])
            };
            let spectrum = CrossSpectrum::read(&mut read, maps.bounds())?;
            Ok(spectrum.map(|spectrum| Spectral::of(&spectrum, maps.pixel(), self.resolution_m())))
        };
        (1..=maps.names().count()).map(of_candidate).collect()
    }
}

impl Spectral {
    fn of(spectrum: &CrossSpectrum, pixel: PixelSize, resolution_m: Option<f64>) -> Self {
        let octaves = octaves(spectrum, pixel, resolution_m);
        let half_coherence = half_coherence(&octaves);
        let resolved_m = half_coherence.map_or(0.0, |half| half.wavelength_m);
        Self { half_coherence, registration: registration(spectrum, pixel, resolved_m), octaves }
    }

    /// Adds the figures to the object of a candidate.
    pub(super) fn add_to(&self, object: &mut Value) {
        object["octaves"] = json!(self.octaves);
        object["half_coherence_m"] = json!(self.half_coherence.map(|half| half.wavelength_m));
        object["half_coherence_at_most"] = json!(self.half_coherence.map(|half| half.at_most));
        object["registration"] = json!(self.registration);
    }
}

/// Returns the octaves of all candidates, one line per octave, with a name above every candidate's columns.
pub(super) fn octaves_table(names: &[String], spectra: &[Option<Spectral>]) -> String {
    let Some(first) = spectra.iter().flatten().max_by_key(|one| one.octaves.len()) else {
        return "spectra: none, as the common pixels are too few, too many or too scattered\n".into();
    };
    let mut text = format!("{:24}", "waves, m");
    names.iter().for_each(|name| text += &format!("  {name:>32}"));
    text += &format!("\n{:24}", "");
    names.iter().for_each(|_| text += &format!("  {:>12}{:>8}{:>12}", "correlation", "gain", "amplitude"));
    text.push('\n');
    for octave in &first.octaves {
        text += &format!("{:>10.1} to {:>10.1}", octave.shortest_m, octave.longest_m);
        for one in spectra {
            let same = |o: &&Octave| o.shortest_m == octave.shortest_m;
            text += &match one.as_ref().and_then(|one| one.octaves.iter().find(same)) {
                Some(o) => format!("  {:>12.3}{:>8.3}{:>12.3}", o.correlation, o.gain, o.amplitude),
                None => format!("  {:>12}{:>8}{:>12}", "-", "-", "-"),
            };
        }
        text.push('\n');
    }
    text
}

/// Draws correlation, gain and amplitude of all candidates over the wavelength.
///
/// # Errors
/// [`elunar_base::Error::Input`] if no candidate has a spectrum.
pub fn octaves_picture(names: &[String], spectra: &[Option<Spectral>]) -> Result<RgbImage> {
    let curves: [Curve; 3] = [("correlation", |o| o.correlation), ("gain", |o| o.gain), ("amplitude", |o| o.amplitude)];
    let series: Vec<Series> = names
        .iter()
        .zip(spectra)
        .filter_map(|(name, one)| one.as_ref().map(|one| (name, one)))
        .flat_map(|(name, one)| {
            curves.map(|(what, figure)| Series {
                name: format!("{what}, {name}"),
                points: one.octaves.iter().map(|o| (o.centre_m(), figure(o))).collect(),
            })
        })
        .collect();
    let chart = Chart {
        title: "Waves of the DTMs and of the truth, by octave",
        x: "wavelength, m",
        y: "correlation, gain, amplitude",
        log_y: false,
    };
    plot_log_x(&chart, &series)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Candidate, Details, compare, json as report_json, table};
    use elunar_core::sun::Body;
    use elunar_raster::align::Named;
    use elunar_raster::{Crs, GeoRef, Raster};

    /// The report holds the figures of both candidates, and says when there are none.
    #[test]
    fn reports_hold_octaves_half_coherence_and_offset() {
        let raster = |side: usize, scale: f64| {
            let georef = GeoRef {
                transform: [0.0, 2.0, 0.0, 0.0, 0.0, -2.0],
                crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0),
            };
            let height = |r: f64, c: f64| (r * 0.11).sin() * 8.0 + (c * 0.23 + r * 0.4).cos() * 3.0 + (c * 1.1).sin();
            let samples = (0..side * side).map(|i| (scale * height((i / side) as f64, (i % side) as f64)) as f32);
            Raster { rows: side, cols: side, samples: samples.collect(), georef: Some(georef) }
        };
        let (truth, dtm, coarse) = (raster(64, 1.0), raster(64, 0.5), raster(64, -1.0));
        let candidates = [Candidate::fine("dtm.tif", &dtm), Candidate::fine("coarse.tif", &coarse)];
        let found = compare(Named::new("t", &truth), &candidates, None).unwrap();
        let details = Details::of(&found);
        let (text, value) = (table(&found, &details), report_json(&found, &details));
        for line in ["half-coherence wavelength", "offset right", "waves, m", "4.0 to        8.0"] {
            assert!(text.contains(line), "{line}: {text}");
        }
        let value: Value = serde_json::from_str(&value).unwrap();
        let close = |v: &Value, expected: f64| assert!((v.as_f64().unwrap() - expected).abs() < 1e-5, "{v} {expected}");
        close(&value["candidates"][0]["octaves"][0]["gain"], 0.5);
        close(&value["candidates"][1]["octaves"][0]["correlation"], -1.0);
        close(&value["candidates"][0]["half_coherence_m"], 32.0_f64.sqrt());
        assert_eq!(value["candidates"][1]["half_coherence_m"], Value::Null);
        close(&value["candidates"][0]["registration"]["down_px"], 0.0);
        let names = ["dtm".to_string(), "coarse".into()];
        let picture = octaves_picture(&names, &details.spectra).unwrap();
        assert!(picture.pixels().filter(|p| p.0 == [40, 140, 70]).count() > 300, "the curve of the amplitude");
        let small = compare(Named::new("t", &raster(9, 1.0)), &[Candidate::fine("d", &raster(9, 1.0))], None).unwrap();
        assert!(table(&small, &Details::of(&small)).contains("spectra: none"));
        assert!(octaves_picture(&names, &Details::of(&small).spectra).is_err());
    }
}
