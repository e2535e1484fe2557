//! Lists of the files of scenes.

use elunar_base::table::TableRows;
use elunar_base::{Error, Result, read};
use elunar_net::sun::{check_azimuth, check_elevation};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// The files of one scene, and the known direction to the Sun.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SceneFiles {
    /// Orbiter image.
    pub image: PathBuf,
    /// DTM of about the image's resolution, the truth.
    pub dtm: PathBuf,
    /// Coarse DTM on its own grid.
    pub coarse: PathBuf,
    /// Region of the scene. If there are enough regions, scenes of one region are all in the same split.
    pub site: String,
    /// Azimuth of the Sun, degrees clockwise from the grid's up; `None` to estimate it.
    pub sun_azimuth_deg: Option<f64>,
    /// Elevation of the Sun, degrees; `None` for 45.
    pub sun_elevation_deg: Option<f64>,
}

/// Names of the columns. The first three are required.
const COLUMNS: [&str; 6] = ["image", "dtm", "coarse", "site", "sun_azimuth_deg", "sun_elevation_deg"];

/// Reads a CSV list. The header names the columns `image`, `dtm`, `coarse` and, optionally, `site`, `sun_azimuth_deg` and
/// `sun_elevation_deg`. Each further line is one scene. Relative paths start at the list's folder. A scene without a site gets its own
/// site, named after its image. Empty lines and lines that begin with # are left out. There is no quoting.
///
/// # Errors
/// [`Error::Io`] if the list cannot be read, [`Error::Broken`] with the line that is wrong.
pub fn read(path: &Path) -> Result<Vec<SceneFiles>> {
    let text = read::text(path, read::MOST_BYTES)?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let mut rows = TableRows::new(path, text.as_bytes(), usize::MAX);
    let head = rows.next_row()?.ok_or_else(|| Error::broken(path, "a header expected, nothing found"))?;
    let (number, header) = (head.line, head.cells());
    if let Some(unknown) = header.iter().find(|name| !COLUMNS.contains(name)) {
        let what = format!("line {number}: columns among {} expected, {unknown:?} found", COLUMNS.join(", "));
        return Err(Error::broken(path, what));
    }
    if let Some(missing) = COLUMNS[..3].iter().find(|name| !header.contains(name)) {
        return Err(Error::broken(path, format!("line {number}: a column {missing} expected, none found")));
    }
    let mut scenes = vec![];
    while let Some(row) = rows.next_row()? {
        let refuse = |what| Error::broken(path, format!("line {}: {what}", row.line));
        scenes.push(scene(folder, &header, &row.cells()).map_err(refuse)?);
    }
    if scenes.is_empty() {
        return Err(Error::broken(path, "one scene a line expected, none found"));
    }
    Ok(scenes)
}

fn scene(folder: &Path, header: &[&str], cells: &[&str]) -> std::result::Result<SceneFiles, String> {
    if cells.len() != header.len() {
        return Err(format!("{} cells expected, {} found", header.len(), cells.len()));
    }
    let cell = |name: &str| header.iter().position(|h| *h == name).map(|k| cells[k]).filter(|c| !c.is_empty());
    let file =
        |name: &str| cell(name).map(|c| folder.join(c)).ok_or_else(|| format!("a file in column {name} expected"));
    let degrees = |name: &str, check: fn(&str, f64) -> Result<()>| {
        let Some(text) = cell(name) else { return Ok(None) };
        let value: f64 = text.parse().map_err(|_| format!("degrees in column {name} expected, {text:?} found"))?;
        check(&format!("column {name}"), value).map_err(|error| error.to_string())?;
        Ok::<_, String>(Some(value))
    };
    let image = file("image")?;
    let site = cell("site").map_or_else(|| image.display().to_string(), String::from);
    Ok(SceneFiles {
        dtm: file("dtm")?,
        coarse: file("coarse")?,
        site,
        sun_azimuth_deg: degrees("sun_azimuth_deg", check_azimuth)?,
        sun_elevation_deg: degrees("sun_elevation_deg", check_elevation)?,
        image,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<SceneFiles>> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scenes.csv");
        std::fs::write(&path, text).unwrap();
        read(&path).map(|mut scenes| {
            scenes.iter_mut().for_each(|s| s.image = s.image.strip_prefix(folder.path()).unwrap().into());
            scenes
        })
    }

    #[test]
    fn columns_may_come_in_any_order() {
        let text = "\u{feff}# ours\r\ncoarse, image,dtm,site,sun_azimuth_deg\r\n\r\nc.tif, i.tif ,d.tif,A,-12.5\nc.tif,j.tif,d.tif,,\n";
        let found = read_text(text).unwrap();
        assert_eq!(found.len(), 2);
        assert_eq!((found[0].image.to_str(), found[0].site.as_str()), (Some("i.tif"), "A"));
        assert_eq!(
            (found[0].sun_azimuth_deg, found[1].sun_azimuth_deg, found[0].sun_elevation_deg),
            (Some(-12.5), None, None)
        );
        assert!(found[1].site.ends_with("j.tif"), "a scene without a site is one of its own");
        assert!(found[0].dtm.is_absolute() && found[0].dtm.ends_with("d.tif"));
    }

    #[test]
    fn wrong_lines_are_named() {
        for (text, part) in [
            ("", "a header expected"),
            ("image,dtm\n", "line 1: a column coarse expected"),
            ("image,dtm,coarse,colour\n", "\"colour\" found"),
            ("image,dtm,coarse\n", "one scene a line expected"),
            ("image,dtm,coarse\n\na,b\n", "line 3: 3 cells expected, 2 found"),
            ("image,dtm,coarse\na,,c\n", "line 2: a file in column dtm expected"),
            (
                "image,dtm,coarse,sun_azimuth_deg\na,b,c,north\n",
                "line 2: degrees in column sun_azimuth_deg expected, \"north\"",
            ),
            (
                "image,dtm,coarse,sun_azimuth_deg\na,b,c,nan\n",
                "line 2: column sun_azimuth_deg: a number from -360 to 360 degrees expected, found NaN",
            ),
            (
                "image,dtm,coarse,sun_elevation_deg\na,b,c,90\n",
                "line 2: column sun_elevation_deg: a number above 0 and below 90 degrees expected, found 90",
            ),
        ] {
            let refused = read_text(text).unwrap_err().to_string();
            assert!(refused.contains(part) && refused.contains("scenes.csv"), "{refused}");
        }
    }
}
