//! Step 1: makes the files of a scene, as in an orbiter's archive.

use super::console::say;
use super::folder::{COARSE_SHADE, Folder, IMAGE, TRUTH_SHADE};
use elunar_base::{Error, Result};
use elunar_core::terrain::PixelSize;
use elunar_picture::{hillshade, stretch, write_png};
use elunar_raster::{Raster, geotiff};
use elunar_scene::predict::{NamedRaster, Scene};
use elunar_synth::{Moon, SceneEntry, SynthManifest, SynthOptions};

/// The scene of a tour, read from its files.
pub(super) struct DemoScene {
    /// Name, terrain and Sun.
    pub about: SceneEntry,
    /// Pixel of image and truth, metres.
    pub pixel_m: f64,
    /// Coarse DTM on its own grid.
    pub coarse: Raster,
    /// True DTM.
    pub truth: Raster,
    /// Image and coarse DTM on one grid, the input of the networks.
    pub input: Scene,
    /// The coarse DTM on the image's grid.
    pub interpolated: Raster,
}

impl DemoScene {
    /// Returns the name of one of its files: `image`, `coarse` or `truth`.
    pub(super) fn file(&self, what: &str) -> String {
        format!("{}_{what}.tif", self.about.name)
    }
}

/// Makes scene 0 of the Moon of `seed`, writes it with pictures and a manifest, and reads it again.
///
/// # Errors
/// If a size is out of range or a file cannot be written or read.
pub(super) fn make(folder: &Folder, seed: u64, (rows, cols): (usize, usize)) -> Result<DemoScene> {
    let options = SynthOptions { rows, cols, ..SynthOptions::default() };
    let made = Moon::new(seed, options.clone())?.scene(0, rows, cols)?;
    let at = folder.file("");
    let about = made.write(&at)?;
    let pixel_m = made.pixel_m;
    let made_by = concat!("host-train ", env!("CARGO_PKG_VERSION")).into();
    SynthManifest { made_by, seed, options, scenes: vec![about.clone()] }.write(&at)?;
    let read = |what: &str| geotiff::read(folder.file(&format!("{}_{what}.tif", about.name)));
    let (image, coarse, truth) = (read("image")?, read("coarse")?, read("truth")?);
    let input = Scene::new(
        NamedRaster::in_memory("image", image.clone()),
        NamedRaster::in_memory("coarse DTM", coarse.clone()),
    )?;
    let interpolated = input.coarse_raster()?;
    let shade = |heights_m: &[f32]| hillshade(heights_m, rows, cols, PixelSize::square(pixel_m));
    write_png(&folder.file(IMAGE), stretch(&image.samples, rows, cols)?)?;
    write_png(&folder.file(COARSE_SHADE), shade(&interpolated.samples)?)?;
    write_png(&folder.file(TRUTH_SHADE), shade(&truth.samples)?)?;
    let kind = format!("{:?}", about.kind).to_lowercase();
    let (low, high) = truth.range().ok_or_else(|| Error::input("scene: expected heights, found none"))?;
    say(format!(
        "{rows} x {cols} pixels of {pixel_m} m: {kind}, relief {:.0} m, Sun {:.0}° high from azimuth {:.0}°",
        high - low,
        about.sun_elevation_deg,
        about.sun_azimuth_deg
    ));
    say(format!(
        "with a coarse DTM of {} x {} pixels of 59 m, spoilt as a global one is, and the truth",
        coarse.rows, coarse.cols
    ));
    Ok(DemoScene { about, pixel_m, coarse, truth, input, interpolated })
}
