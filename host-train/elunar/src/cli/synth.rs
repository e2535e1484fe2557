//! `elunar synth`: writes synthetic scenes as GeoTIFFs.

use elunar_base::output::Owner;
use elunar_base::{Error, Result, SOFTWARE, interrupt, progress};
use elunar_core::terrain::PixelSize;
use elunar_picture::{Panel, hillshades, sheet, stretch, write_png};
use elunar_synth::{MANIFEST, Moon, SceneEntry, SynthManifest, SynthOptions, SynthScene, TerrainKind, scene_files};
use rayon::prelude::*;
use std::path::PathBuf;

/// Options of `synth`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Writes for each scene scene_0000_image.tif (relative DN), scene_0000_coarse.tif (pixels of 59 m, on a grid of its own) and \
scene_0000_truth.tif (metres), and so on; then manifest.json and the pictures of all scenes, contact_sheet.png. The same seed \
and options give the same files.

Example:
  elunar synth --out scenes --scenes 4 --seed 1")]
pub struct Args {
    /// Folder to write into; created if absent.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Number of scenes.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u64).range(1..=9999))]
    pub scenes: u64,
    /// Seed of the Moon.
    #[arg(long, value_name = "S", default_value_t = 0)]
    pub seed: u64,
    /// Rows of a scene.
    #[arg(long, default_value_t = 512)]
    pub rows: usize,
    /// Columns of a scene.
    #[arg(long, default_value_t = 640)]
    pub cols: usize,
    /// Pixel of image and truth, metres, 1 to 8.
    #[arg(long, value_name = "M", default_value_t = 2.0)]
    pub pixel_m: f64,
    /// Terrain [default: drawn per scene].
    #[arg(long)]
    pub kind: Option<TerrainKind>,
    /// Least and greatest Sun elevation, degrees.
    #[arg(long, num_args = 2, value_names = ["LOW", "HIGH"], default_values_t = [18.0, 64.0])]
    pub sun_elevation_deg: Vec<f64>,
    /// Least and greatest factor on all relief, 0 to 4.
    #[arg(long, num_args = 2, value_names = ["LOW", "HIGH"], default_values_t = [1.0, 1.0])]
    pub relief: Vec<f64>,
    /// Least and greatest factor on the albedo's contrast, 0 to 10.
    #[arg(long, num_args = 2, value_names = ["LOW", "HIGH"], default_values_t = [1.0, 1.0])]
    pub albedo_contrast: Vec<f64>,
}

/// File name of the contact sheet.
const SHEET: &str = "contact_sheet.png";
/// Greatest number of scenes on the contact sheet.
const SHEET_SCENES: usize = 12;
/// Scenes of more pixels than this are made one after another, to save memory.
const LARGE_SCENE_PX: usize = 4_000_000;

/// Runs the command.
///
/// # Errors
/// [`Error::Usage`] for options out of range, [`Error::Io`] if the folder cannot be written.
pub fn run(args: Args) -> Result<()> {
    let (rows, cols) = (args.rows, args.cols);
    let range = |ends: &[f64]| (ends[0], ends[1]);
    let options = SynthOptions {
        rows,
        cols,
        pixel_m: args.pixel_m,
        kind: args.kind,
        sun_elevation_deg: range(&args.sun_elevation_deg),
        relief: range(&args.relief),
        albedo_contrast: range(&args.albedo_contrast),
        ..SynthOptions::default()
    };
    let moon = Moon::new(args.seed, options.clone())?;
    let fixed = [MANIFEST, SHEET].map(String::from);
    interrupt::listen();
    let _owner = Owner::of_folder(&args.out, "synth", (0..args.scenes).flat_map(scene_files).chain(fixed))?;
    let bar = progress::bar("", args.scenes, "scenes");
    let make = |index: u64| -> Result<(SceneEntry, Vec<Panel>)> {
        if interrupt::requested() {
            return Err(Error::stopped("interrupted; the same command begins anew"));
        }
        let scene = moon.scene(index, rows, cols)?;
        let entry = scene.write(&args.out)?;
        let panels = if (index as usize) < SHEET_SCENES { panels(&scene, &entry)? } else { vec![] };
        bar.inc(1);
        Ok((entry, panels))
    };
    let made: Result<Vec<_>> = if rows * cols > LARGE_SCENE_PX {
        (0..args.scenes).map(make).collect()
    } else {
        (0..args.scenes).into_par_iter().map(make).collect()
    };
    bar.finish_and_clear();
    let (scenes, panels): (Vec<SceneEntry>, Vec<Vec<Panel>>) = made?.into_iter().unzip();
    write_png(&args.out.join(SHEET), sheet(&panels.concat(), 3, 480))?;
    let made_by = SOFTWARE.into();
    SynthManifest { made_by, seed: args.seed, options, scenes }.write(&args.out)?;
    println!(
        "{}: {} scenes of {rows} x {cols} pixels, contact_sheet.png, manifest.json",
        args.out.display(),
        args.scenes
    );
    Ok(())
}

/// Draws image, truth and coarse DTM of one scene for the contact sheet.
fn panels(scene: &SynthScene, entry: &SceneEntry) -> Result<Vec<Panel>> {
    let (rows, cols, pixel) = (scene.rows, scene.cols, PixelSize::square(scene.pixel_m));
    let about = format!(
        "{} {:?}, Sun {:.0}° high from {:.0}°",
        entry.name, scene.kind, scene.sun_elevation_deg, scene.sun_azimuth_deg
    );
    let shades = hillshades(&[&scene.truth_m, &scene.coarse_on_image_m()], rows, cols, pixel)?;
    let captions = ["truth, shaded from 315°", "coarse DTM, interpolated and shaded"];
    let shaded = captions.into_iter().zip(shades).map(|(caption, shade)| Panel::new(caption, shade));
    Ok([Panel::new(about, stretch(&scene.image, rows, cols)?)].into_iter().chain(shaded).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(out: PathBuf, scenes: u64) -> Args {
        Args {
            out,
            scenes,
            seed: 4,
            rows: 40,
            cols: 50,
            pixel_m: 2.0,
            kind: None,
            sun_elevation_deg: vec![18.0, 64.0],
            relief: vec![1.0, 1.0],
            albedo_contrast: vec![1.0, 1.0],
        }
    }

    #[test]
    fn the_same_seed_writes_the_same_files() {
        let folder = tempfile::tempdir().unwrap();
        let (a, b) = (folder.path().join("a"), folder.path().join("b"));
        run(args(a.clone(), 3)).unwrap();
        run(args(b.clone(), 3)).unwrap();
        let mut names: Vec<_> = std::fs::read_dir(&a).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names.len(), 3 * 3 + 2 + 1, "and the list of these files");
        for name in names {
            assert!(std::fs::read(a.join(&name)).unwrap() == std::fs::read(b.join(&name)).unwrap(), "{name:?}");
        }
    }

    #[test]
    fn illegal_requests_write_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let refused = run(Args { pixel_m: 20.0, ..args(out.clone(), 1) }).unwrap_err();
        assert!(refused.to_string().contains("pixel_m"), "{refused}");
        assert!(!out.exists());
        let file = folder.path().join("file");
        std::fs::write(&file, "not a folder").unwrap();
        assert!(matches!(run(args(file, 1)), Err(Error::Io { .. })));
    }
}
