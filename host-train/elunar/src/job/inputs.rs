//! The inputs of a job: image and coarse DTM, with what the user says about them.

use super::words;
use crate::held::Held;
use elunar_base::{Error, Result};
use elunar_core::sun::UtcTime;
use elunar_net::illumination::KnownSun;
use elunar_raster::Crs;
use elunar_raster::stated::{HeightUnit, Statements};
use elunar_raster::sun::StatedSun;
use elunar_scene::predict::notices::check_exchange;
use elunar_scene::predict::sun::{KnownFrom, SunEvidence};
use elunar_scene::predict::{NamedRaster, Scene};
use std::path::{Path, PathBuf};

/// Image and coarse DTM.
#[derive(Debug, Clone, clap::Args)]
pub struct Inputs {
    /// Orbiter image: GeoTIFF or PDS3.
    #[arg(long, value_name = "I.tif")]
    pub image: PathBuf,
    /// Coarse DTM: GeoTIFF or PDS3, heights above the sphere in metres, or in the unit that the file names.
    #[arg(long, value_name = "C.tif")]
    pub coarse: PathBuf,
    /// Reference system of the image, if the file does not state it: IAU_2015:30110 and the like, a PROJ text, or WKT.
    #[arg(long, value_name = "SRS", value_parser = Crs::parse)]
    pub image_srs: Option<Crs>,
    /// Reference system of the coarse DTM, if the file does not state it.
    #[arg(long, value_name = "SRS", value_parser = Crs::parse)]
    pub coarse_srs: Option<Crs>,
    /// Unit of the coarse DTM's heights, if the file does not state it [default: m].
    #[arg(long)]
    pub coarse_unit: Option<HeightUnit>,
    /// Value of the image's file, before scale and offset, that means no measurement, as if its nodata tag said so.
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub image_nodata: Option<f64>,
    /// Value of the coarse DTM's file, before scale, offset and unit, that means no measurement.
    #[arg(long, value_name = "VALUE", allow_negative_numbers = true)]
    pub coarse_nodata: Option<f64>,
    /// Azimuth of the Sun, degrees clockwise from the grid's up, -360 to 360 [default: as the image's file states it].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_azimuth: Option<f64>,
    /// Elevation of the Sun, degrees above the horizon, above 0 and below 90 [default: as the image's file states it].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_elevation: Option<f64>,
    /// When the image was taken, UTC: the Sun stands as it did over the image's place on the Moon or on Mars [default: as the image's file states
    /// it, for angles that the file does not state].
    #[arg(long, value_name = "TIME", conflicts_with = "fit_sun")]
    pub time: Option<UtcTime>,
    /// Do not use the angles of the Sun and the time that the image's file states: fit angles that are not given.
    #[arg(long)]
    pub fit_sun: bool,
}

/// The opened inputs.
pub struct Opened {
    /// The image.
    pub image: NamedRaster,
    /// Image and coarse DTM on the image's grid.
    pub scene: Scene,
    /// The Sun, and who says so.
    pub sun: KnownFrom,
}

impl Inputs {
    /// Opens image and coarse DTM, unless they are held. Angles of the Sun that the user does not give are those of the image's file.
    ///
    /// # Errors
    /// If a file cannot be read, or the two do not belong together.
    pub fn open(&self, held: &Held) -> Result<Opened> {
        let found =
            |path: &Path| held.find(path).map(|source| NamedRaster { name: path.display().to_string(), source });
        let image = match found(&self.image) {
            Some(image) => image,
            None => NamedRaster::image(&self.image, self.image_srs.clone(), self.image_nodata)?,
        };
        let coarse = found(&self.coarse).map_or_else(|| self.open_coarse(), Ok)?;
        check_exchange(&image, &coarse, self.coarse_unit.is_some())?;
        let sun = KnownFrom::new(self.known_sun(), &image.name, self.sun_evidence(&image)?)?;
        Ok(Opened { scene: Scene::new(image.clone(), coarse)?, image, sun })
    }

    /// Returns what the image's file and the time say of the Sun.
    fn sun_evidence(&self, image: &NamedRaster) -> Result<SunEvidence> {
        let info = image.source.info();
        let file = if self.fit_sun { StatedSun::default() } else { info.sun };
        let timed = self.time.or(file.time).and_then(|time| StatedSun::at_time(info, time));
        if self.time.is_some() && timed.is_none() {
            return Err(Error::input(format!(
                "--time: {}: a place on the Moon or on Mars expected, none found",
                image.name
            )));
        }
        Ok(SunEvidence { file, timed: timed.unwrap_or_default(), time_is_told: self.time.is_some() })
    }

    /// Opens the coarse DTM, with what the user says about it.
    ///
    /// # Errors
    /// As [`NamedRaster::heights`].
    pub fn open_coarse(&self) -> Result<NamedRaster> {
        let stated = Statements { srs: self.coarse_srs.clone(), unit: self.coarse_unit };
        NamedRaster::heights(&self.coarse, stated, self.coarse_nodata)
    }

    /// Returns the angles of the Sun that the user gives.
    #[must_use]
    pub fn known_sun(&self) -> KnownSun {
        KnownSun { azimuth_deg: self.sun_azimuth, elevation_deg: self.sun_elevation }
    }

    /// Returns what the user says about the files, by name, for the identity of a job.
    #[must_use]
    pub fn words(&self) -> [(&'static str, Option<String>); 5] {
        [
            ("image_srs", self.image_srs.as_ref().map(words::srs)),
            ("coarse_srs", self.coarse_srs.as_ref().map(words::srs)),
            ("coarse_unit", self.coarse_unit.as_ref().and_then(words::name)),
            ("image_nodata", words::number(self.image_nodata)),
            ("coarse_nodata", words::number(self.coarse_nodata)),
        ]
    }
}
