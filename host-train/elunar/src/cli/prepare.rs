//! `elunar prepare`: makes a training set from images, DTMs and coarse DTMs.

use clap::ValueEnum;
use elunar_base::{Error, Result, interrupt, progress};
use elunar_data::prepare::list::SceneFiles;
use elunar_data::prepare::{PrepareOptions, Split, TrainingSetManifest, list, run as prepare};
use elunar_net::illumination::KnownSun;
use elunar_net::sun::check_sun;
use elunar_raster::align::Interpolation;
use elunar_raster::stated::HeightUnit;
use std::path::{Path, PathBuf};

/// Options of `prepare`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
The list is a CSV file with a header: image, dtm, coarse and, if wanted, site, sun_azimuth_deg, sun_elevation_deg. Both DTMs are \
put on the image's grid, which is cut into tiles of 256 x 320 pixels. Tiles are left out, and counted in manifest.json, that \
have gaps, a constant or saturated image, no relief, an image that is shifted against its DTM, or a relief beyond 3 sigma (Eq. \
9-10). Training, validation and test have no ground in common: whole sites where there are at least three, else blocks of the \
map. After a stop the same command goes on.

`host-train train --data tiles/` trains on the result.

Examples:
  elunar prepare --list scenes.csv --out tiles/
  elunar prepare --image image.tif --dtm stereo.tif --coarse sldem.tif --out tiles/")]
pub struct Args {
    /// CSV list of scenes.
    #[arg(long, value_name = "SCENES.csv", conflicts_with_all = ["image", "dtm", "coarse"], required_unless_present = "image")]
    pub list: Option<PathBuf>,
    /// Orbiter image, instead of a list.
    #[arg(long, value_name = "I.tif", requires = "dtm", requires = "coarse")]
    pub image: Option<PathBuf>,
    /// True DTM, heights in metres.
    #[arg(long, value_name = "D.tif", requires = "image")]
    pub dtm: Option<PathBuf>,
    /// Coarse DTM on its own grid.
    #[arg(long, value_name = "C.tif", requires = "image")]
    pub coarse: Option<PathBuf>,
    /// Azimuth of the Sun, degrees clockwise from the grid's up, -360 to 360, for scenes without one in the list [default: estimated].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_azimuth: Option<f64>,
    /// Elevation of the Sun, degrees, above 0 and below 90, for scenes without one in the list [default: 45].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    pub sun_elevation: Option<f64>,
    /// Folder to write; created if absent.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Unit of the coarse DTMs' heights, if the files do not state it [default: m].
    #[arg(long)]
    pub coarse_unit: Option<HeightUnit>,
    /// Largest offset between image and DTM, pixels.
    #[arg(long, value_name = "PX", default_value_t = 2.0)]
    pub max_offset: f64,
    /// Largest share of a tile's pixels at its brightest value.
    #[arg(long, value_name = "SHARE", default_value_t = 0.01)]
    pub max_saturated: f64,
    /// Shares of training, validation and test.
    #[arg(long, value_name = "A,B,C", value_delimiter = ',', default_values_t = [0.8, 0.1, 0.1])]
    pub split: Vec<f64>,
    /// Number of tiles in a shard; a tile takes 0.98 MB.
    #[arg(long, value_name = "N", default_value_t = 64)]
    pub shard_tiles: usize,
    /// Seed of random choices.
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

/// Runs the command.
///
/// # Errors
/// If the list or a raster cannot be read, no tile is usable, or writing fails.
pub fn run(args: Args) -> Result<()> {
    check_sun(KnownSun { azimuth_deg: args.sun_azimuth, elevation_deg: args.sun_elevation })?;
    let mut scenes = match (&args.list, &args.image, &args.dtm, &args.coarse) {
        (Some(list), ..) => list::read(list)?,
        (None, Some(image), Some(dtm), Some(coarse)) => vec![SceneFiles {
            image: image.clone(),
            dtm: dtm.clone(),
            coarse: coarse.clone(),
            site: image.display().to_string(),
            sun_azimuth_deg: None,
            sun_elevation_deg: None,
        }],
        _ => return Err(Error::usage("--list, or --image with --dtm and --coarse, expected")),
    };
    let shares = <[f64; 3]>::try_from(args.split)
        .map_err(|found| Error::usage(format!("--split: three shares expected, {} found", found.len())))?;
    for scene in &mut scenes {
        scene.sun_azimuth_deg = scene.sun_azimuth_deg.or(args.sun_azimuth);
        scene.sun_elevation_deg = scene.sun_elevation_deg.or(args.sun_elevation);
    }
    let parameters = PrepareOptions {
        interpolation: name(Interpolation::Bicubic),
        coarse_unit: args.coarse_unit.map(name),
        max_offset_px: args.max_offset,
        search_px: 8,
        min_correlation: 0.3,
        max_saturated: args.max_saturated,
        shares,
        shard_tiles: args.shard_tiles,
        seed: args.seed,
    };
    interrupt::listen();
    let bar = progress::bar("", 0, "tiles");
    let made = prepare(&scenes, &args.out, &parameters, &bar);
    bar.finish_and_clear();
    print!("{}", summary(&args.out, &made?));
    Ok(())
}

/// Returns the value's name on the command line.
fn name(value: impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |v| v.get_name().into())
}

fn summary(out: &Path, made: &TrainingSetManifest) -> String {
    let mut text = format!("{}: {} of {} tiles kept", out.display(), made.kept, made.tiles);
    for (reason, count) in &made.dropped {
        let reason = serde_json::to_value(reason).unwrap_or_default();
        text += &format!(", {} {count}", reason.as_str().unwrap_or_default().replace('_', " "));
    }
    text += &format!("\nNR {:.2} m; relief difference {:.2} m", made.nr, made.three_sigma.mean_m);
    text += &format!(", sigma {:.2} m; divided by {}\n", made.three_sigma.sigma_m, made.divided_by);
    for scene in &made.scenes {
        let offset = match scene.offset_px {
            Some([rows, cols]) => format!("DTM off by {rows:+.2} rows, {cols:+.2} columns"),
            None => "offset not measured".into(),
        };
        let image = scene.files.image.display();
        text +=
            &format!("{image}: {} of {} tiles, {offset} ({} tiles)\n", scene.kept, scene.tiles, scene.offset_measured);
    }
    for split in Split::ALL {
        let tiles = made.splits.get(&split).map_or(0, |record| record.tiles);
        text += &format!("{}: {tiles} tiles\n", split.name());
    }
    text
}
