//! Files of scenes: lunar GeoTIFFs, and a manifest from which they can be made again.

use super::{COARSE_PIXEL_M, SynthOptions, SynthScene, TerrainKind};
use elunar_base::{Result, atomic_write};
use elunar_core::sun::Body;
use elunar_raster::geotiff::{self, SampleType, WriteOptions};
use elunar_raster::{Crs, GeoRef, GeoTransform, Raster};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Upper left corner of scene 0 in the equirectangular system (about 1° N, 23° E), metres. Later scenes follow eastwards. The position has
/// no meaning, because the terrain is synthetic.
const PLACE_M: (f64, f64) = (697_000.0, 30_000.0);
/// Distance from one scene's left edge to the next, metres.
const SPACING_M: f64 = 20_000.0;

/// File name of a [`SynthManifest`].
pub const MANIFEST: &str = "manifest.json";
/// The maps of a scene.
const MAPS: [&str; 3] = ["image", "coarse", "truth"];

/// Returns the names of the files of scene `index`.
#[must_use]
pub fn scene_files(index: u64) -> [String; 3] {
    MAPS.map(|what| file_name(&scene_name(index), what))
}

fn scene_name(index: u64) -> String {
    format!("scene_{index:04}")
}

fn file_name(scene: &str, what: &str) -> String {
    format!("{scene}_{what}.tif")
}

/// Contents of a folder of synthetic scenes, and all that is needed to make it again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SynthManifest {
    /// Program and version that made the folder.
    pub made_by: String,
    /// Seed of the Moon.
    pub seed: u64,
    /// Options of the Moon; its tile size is the size of the scenes.
    pub options: SynthOptions,
    /// The scenes.
    pub scenes: Vec<SceneEntry>,
}

/// One scene of a [`SynthManifest`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneEntry {
    /// Common beginning of its file names.
    pub name: String,
    /// Number of the scene on the Moon.
    pub index: u64,
    /// Terrain.
    pub kind: TerrainKind,
    /// Sun azimuth, degrees clockwise from north.
    pub sun_azimuth_deg: f64,
    /// Sun elevation, degrees above the horizon.
    pub sun_elevation_deg: f64,
}

impl SynthManifest {
    /// Writes `manifest.json` into `folder`.
    ///
    /// # Errors
    /// [`elunar_base::Error::Io`] if the folder cannot be written.
    pub fn write(&self, folder: &Path) -> Result<()> {
        let path = folder.join(MANIFEST);
        let text = serde_json::to_string_pretty(self).map_err(|e| elunar_base::Error::broken(&path, e.to_string()))?;
        atomic_write(&path, text.as_bytes())
    }
}

impl SynthScene {
    /// Returns the image as a raster of the lunar equirectangular system.
    pub fn image_raster(&self) -> Raster {
        self.on_image_grid(&self.image)
    }

    /// Returns the true DTM as a raster, metres.
    pub fn truth_raster(&self) -> Raster {
        self.on_image_grid(&self.truth_m)
    }

    /// Returns the coarse DTM as a raster on its own grid, metres.
    pub fn coarse_raster(&self) -> Raster {
        let [x0, _, _, y0, _, _] = self.transform();
        Raster {
            rows: self.coarse.rows,
            cols: self.coarse.cols,
            samples: self.coarse.heights_m.clone(),
            georef: Some(place([
                x0 + self.coarse.east_m,
                COARSE_PIXEL_M,
                0.0,
                y0 - self.coarse.south_m,
                0.0,
                -COARSE_PIXEL_M,
            ])),
        }
    }

    fn on_image_grid(&self, samples: &[f32]) -> Raster {
        Raster { rows: self.rows, cols: self.cols, samples: samples.to_vec(), georef: Some(place(self.transform())) }
    }

    fn transform(&self) -> GeoTransform {
        let x0 = PLACE_M.0 + SPACING_M * (self.index % 100) as f64;
        [x0, self.pixel_m, 0.0, PLACE_M.1, 0.0, -self.pixel_m]
    }

    /// Writes `scene_NNNN_image.tif`, `_coarse.tif` and `_truth.tif` into `folder` and returns their manifest entry.
    ///
    /// # Errors
    /// [`elunar_base::Error::Io`] if a file cannot be written. Files written before it stay.
    pub fn write(&self, folder: &Path) -> Result<SceneEntry> {
        let name = scene_name(self.index);
        let file = |what: &str| folder.join(file_name(&name, what));
        let about = |what: &str| {
            let sphere = format!("synthetic {what}: heights above the {} m sphere", Body::Moon.radius_m());
            WriteOptions::heights(sphere).with_item("SYNTHETIC", "yes")
        };
        let image = WriteOptions::image(SampleType::U16, "synthetic orbiter image, relative DN")
            .with_item("SYNTHETIC", "yes")
            .with_sun(Some(self.sun_azimuth_deg), Some(self.sun_elevation_deg));
        geotiff::write(&file("image"), &self.image_raster(), &image)?;
        geotiff::write(&file("coarse"), &self.coarse_raster(), &about("coarse DTM"))?;
        geotiff::write(&file("truth"), &self.truth_raster(), &about("true DTM"))?;
        Ok(SceneEntry {
            name,
            index: self.index,
            kind: self.kind,
            sun_azimuth_deg: self.sun_azimuth_deg,
            sun_elevation_deg: self.sun_elevation_deg,
        })
    }
}

fn place(transform: GeoTransform) -> GeoRef {
    GeoRef { transform, crs: Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0) }
}

#[cfg(test)]
mod tests {
    use super::super::{Moon, SynthOptions};
    use super::*;
    use elunar_raster::align::{Interpolation, Named, onto};

    #[test]
    fn files_hold_the_scene_and_align_through_their_coordinates() {
        let folder = tempfile::tempdir().unwrap();
        let moon = Moon::new(2, SynthOptions::default()).unwrap();
        let scene = moon.scene(3, 60, 90).unwrap();
        let entry = scene.write(folder.path()).unwrap();
        assert_eq!((entry.name.as_str(), entry.kind), ("scene_0003", scene.kind));
        let read = |what: &str| geotiff::read(folder.path().join(format!("scene_0003_{what}.tif"))).unwrap();
        let (image, coarse, truth) = (read("image"), read("coarse"), read("truth"));
        assert_eq!(image.samples, scene.image);
        assert_eq!(truth.samples, scene.truth_m);
        assert_eq!(coarse.samples, scene.coarse.heights_m);
        let aligned = onto(Named::new("coarse", &coarse), Named::new("image", &image), Interpolation::Bicubic).unwrap();
        for (a, b) in aligned.samples.iter().zip(scene.coarse_on_image_m()) {
            assert!((a - b).abs() < 1e-3, "{a} {b}");
        }
    }

    #[test]
    fn manifests_survive_the_round_trip() {
        let folder = tempfile::tempdir().unwrap();
        let manifest =
            SynthManifest { made_by: "test".into(), seed: 5, options: SynthOptions::default(), scenes: vec![] };
        manifest.write(folder.path()).unwrap();
        let text = std::fs::read_to_string(folder.path().join("manifest.json")).unwrap();
        assert_eq!(serde_json::from_str::<SynthManifest>(&text).unwrap(), manifest);
    }
}
