//! The STAC item of a finished prediction: place, time, light, and the files with their sizes and hashes. The body is named by the extension
//! `ssys` (USGS), because STAC's own geometry means the Earth.

use super::request::Request;
use super::task::Task;
use super::words::file_name;
use elunar_base::digest::sha256;
use elunar_base::{Error, Result, SOFTWARE, atomic_write};
use elunar_core::sun::{Body, UtcTime};
use elunar_raster::footprint::{bounds, footprint};
use elunar_raster::sun::{body_of, north_deg};
use elunar_scene::predict::hillshade_path;
use elunar_scene::predict::identity::is_hash;
use elunar_scene::predict::record::PredictionRecord;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Extensions of STAC whose fields an item has.
const EXTENSIONS: [&str; 4] = [
    "https://stac-extensions.github.io/projection/v2.0.0/schema.json",
    "https://stac-extensions.github.io/view/v1.0.0/schema.json",
    "https://stac-extensions.github.io/file/v2.1.0/schema.json",
    "https://stac-extensions.github.io/ssys/v1.1.0/schema.json",
];
/// Beginning of a SHA-256 as STAC's file extension writes it (a multihash).
const MULTIHASH_SHA256: &str = "1220";

/// Writes the item.
///
/// # Errors
/// If the map of the DTM has no longitudes, or a file cannot be read or written.
pub(super) fn write(path: &Path, args: &Request, task: &Task, record: &PredictionRecord) -> Result<()> {
    let work = &task.work;
    let (rows, cols, georef) = (record.rows, record.cols, &work.scene.georef);
    let unknown = || Error::input(format!("{}: --stac: a projection with longitudes expected", record.image));
    let ring = footprint(georef, rows, cols).ok_or_else(unknown)?;
    let [(west, east), (south, north)] = bounds(&ring);
    let folder = path.parent().unwrap_or(Path::new(""));
    let item = json!({
        "type": "Feature",
        "stac_version": "1.1.0",
        "stac_extensions": EXTENSIONS,
        "id": args.output.file_stem().unwrap_or_default().to_string_lossy(),
        "bbox": [west, south, east, north],
        "geometry": { "type": "Polygon", "coordinates": [ring] },
        "properties": properties(args, task, record)?,
        "links": [],
        "assets": assets(args, folder)?,
    });
    let text = serde_json::to_string_pretty(&item).map_err(|e| Error::usage(format!("{}: {e}", path.display())))?;
    atomic_write(path, (text + "\n").as_bytes())
}

fn properties(args: &Request, task: &Task, record: &PredictionRecord) -> Result<Map<String, Value>> {
    let work = &task.work;
    let (rows, cols, georef) = (record.rows, record.cols, &work.scene.georef);
    let [x0, x_col, x_row, y0, y_col, y_row] = georef.transform;
    let made = now()?;
    let mut all = Map::new();
    let mut set = |key: &str, value: Value| all.insert(key.into(), value);
    let of_time = match work.time {
        Some(_) => "",
        None => " The image's time is unknown: the time is that of the DTM.",
    };
    let description = format!(
        "Heights above the sphere, metres, from the image {} and the coarse DTM {}, by {}.{of_time}",
        named(&args.inputs.image, &task.identity.image),
        named(&args.inputs.coarse, &task.identity.coarse),
        record.model
    );
    set("description", description.into());
    set("datetime", work.time.map_or_else(|| made.clone(), |time| time.to_string()).into());
    set("created", made.into());
    set("gsd", f64::from(record.pixel_m).into());
    set("proj:code", Value::Null);
    set("proj:shape", json!([rows, cols]));
    set("proj:transform", json!([x_col, x_row, x0, y_col, y_row, y0]));
    if let Some(body) = body_of(georef) {
        let (name, class) = match body {
            Body::Moon => ("Moon", "satellite"),
            Body::Mars => ("Mars", "planet"),
        };
        set("ssys:targets", json!([name]));
        set("ssys:target_class", class.into());
    }
    if let (Some(light), Some(north_deg)) = (&record.light, north_deg(georef, rows, cols)) {
        set("view:sun_azimuth", (light.azimuth_deg - north_deg).rem_euclid(360.0).into());
        set("view:sun_elevation", light.elevation_deg.into());
    }
    set("software", SOFTWARE.into());
    Ok(all)
}

/// Returns the name of an input, or what stands for a file on the net.
pub(super) fn named(path: &Path, content: &str) -> String {
    if is_hash(content) { file_name(path) } else { content.into() }
}

/// Returns the files by their roles. Names are relative to the item's folder where they lie in it.
fn assets(args: &Request, folder: &Path) -> Result<Map<String, Value>> {
    let tiff = "image/tiff; application=geotiff; profile=cloud-optimized";
    let shade = hillshade_path(&args.output);
    let mut all = Map::new();
    let files: [(&str, &str, &str, &str, Option<&PathBuf>); 4] = [
        ("dtm", "DTM", tiff, "data", Some(&args.output)),
        ("hillshade", "Hillshade", "image/png", "overview", Some(&shade)),
        (
            "uncertainty",
            "Expected errors of heights and slopes, origin of each height",
            tiff,
            "data",
            args.uncertainty.as_ref(),
        ),
        ("report", "Report", "text/html", "metadata", args.report.as_ref()),
    ];
    for (key, title, kind, role, path) in files {
        let Some(path) = path else { continue };
        let bytes = std::fs::metadata(path).map_err(Error::io(path))?.len();
        let asset = json!({
            "href": href(path, folder), "title": title, "type": kind, "roles": [role],
            "file:size": bytes, "file:checksum": format!("{MULTIHASH_SHA256}{}", sha256(path)?),
        });
        all.insert(key.into(), asset);
    }
    Ok(all)
}

fn href(path: &Path, folder: &Path) -> String {
    match path.strip_prefix(folder) {
        Ok(inside) => format!("./{}", inside.display()),
        Err(_) => std::path::absolute(path).unwrap_or_else(|_| path.into()).display().to_string(),
    }
}

/// Returns the time now.
fn now() -> Result<String> {
    let unix_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs() as f64);
    let time = UtcTime::from_days((unix_s - 946_728_000.0) / 86_400.0);
    time.map(|time| time.to_string()).map_err(|e| Error::usage(format!("the clock of this machine: {e}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::job::{self, Request};
    use clap::Parser;
    use elunar_synth::{Moon, SynthOptions};

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        request: Request,
    }

    #[test]
    fn the_item_names_files_place_and_light() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).display().to_string();
        Moon::new(3, SynthOptions::default()).unwrap().scene(0, 60, 64).unwrap().write(folder.path()).unwrap();
        let [image, coarse, dtm, item] =
            ["scene_0000_image.tif", "scene_0000_coarse.tif", "dtm.tif", "dtm.json"].map(at);
        let words = ["x", "--image", &image, "--coarse", &coarse, "--model", "nano", "-o", &dtm, "--stac", &item];
        let run = |more: &[&str]| {
            job::run(&Line::parse_from(words.iter().chain(more)).request, None, job::open).unwrap();
            serde_json::from_str::<Value>(&std::fs::read_to_string(&item).unwrap()).unwrap()
        };
        let made = run(&["--time", "2009-08-30T12:00:00"]);
        let hash = std::fs::read_to_string(at("dtm.tif.sha256")).unwrap();
        assert_eq!(made["assets"]["dtm"]["file:checksum"], format!("1220{}", &hash[..64]));
        assert_eq!((&made["assets"]["hillshade"]["href"], &made["id"]), (&"./dtm_hillshade.png".into(), &"dtm".into()));
        let said = &made["properties"];
        assert_eq!((&said["datetime"], &said["ssys:targets"][0]), (&"2009-08-30T12:00:00Z".into(), &"Moon".into()));
        assert_eq!(said["proj:shape"], json!([60, 64]));
        assert!((-90.0..90.0).contains(&said["view:sun_elevation"].as_f64().unwrap()));
        let ring = made["geometry"]["coordinates"][0].as_array().unwrap();
        assert_eq!((ring.len(), &ring[0]), (33, &ring[32]));
        let unknown = run(&["--fit-sun", "--no-anchor"]);
        assert!(unknown["properties"]["description"].as_str().unwrap().contains("The image's time is unknown"));
    }
}
