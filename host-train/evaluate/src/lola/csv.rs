//! Points from text: the PointPerRow tables of the LOLA RDR query, and any other table of longitude, latitude and height.

use super::track::LaserSpot;
use elunar_base::table::{TableRow, TableRows};
use elunar_base::{Error, Result, read};
use std::io::Read;
use std::path::Path;
use std::str::FromStr;

/// Greatest length of a line, bytes. Lines of these tables have a few hundred bytes.
const MOST_LINE_BYTES: usize = 1 << 16;

/// No body has a height farther from its sphere, metres (our choice). Beyond it the row is wrong, or in another unit.
const FARTHEST_M: f64 = 1e6;

/// Meaning of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Role {
    LonDeg,
    LatDeg,
    RadiusKm,
    RadiusM,
    HeightM,
    Time,
    /// Any value but 0 marks a point that is not a measurement of the ground.
    Flag,
}

/// The meaning of the columns, in the form of ASP's `--csv-format`, such as `2:lon 3:lat 4:radius_km`. Columns are counted from 1. Names
/// are `lon`, `lat`, `radius_km`, `radius_m`, `height_above_datum` (metres). Our additions are `time` and `flag`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CsvFormat {
    /// (column counted from 0, role).
    columns: Vec<(usize, Role)>,
}

impl FromStr for CsvFormat {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let mut columns = Vec::new();
        for part in text.split([' ', ',']).filter(|part| !part.is_empty()) {
            let expected = || {
                format!(
                    "COLUMN:NAME with lon, lat, radius_km, radius_m, height_above_datum, time or flag expected, found {part:?}"
                )
            };
            let (column, name) = part.split_once(':').ok_or_else(expected)?;
            let column = column.parse::<usize>().ok().and_then(|n| n.checked_sub(1)).ok_or_else(expected)?;
            let role = match name {
                "lon" => Role::LonDeg,
                "lat" => Role::LatDeg,
                "radius_km" => Role::RadiusKm,
                "radius_m" => Role::RadiusM,
                "height_above_datum" => Role::HeightM,
                "time" => Role::Time,
                "flag" => Role::Flag,
                _ => return Err(expected()),
            };
            columns.push((column, role));
        }
        Self { columns }.checked()
    }
}

impl CsvFormat {
    /// Returns the format that a heading describes, in any case and with any marks between words. `None` if it does not describe a table of
    /// points.
    fn of_heading(cells: &[&str]) -> Option<Self> {
        let role = |cell: &&str| match name(cell).as_str() {
            "pt_longitude" | "longitude" | "lon" | "lon_deg" | "longitude_deg" => Some(Role::LonDeg),
            "pt_latitude" | "latitude" | "lat" | "lat_deg" | "latitude_deg" => Some(Role::LatDeg),
            "pt_radius" | "pt_radius_km" | "radius_km" => Some(Role::RadiusKm),
            "pt_radius_m" | "radius_m" => Some(Role::RadiusM),
            "height_m" | "height_above_datum" | "elevation_m" | "topography_m" => Some(Role::HeightM),
            "coordinated_universal_time" | "utc" | "time" => Some(Role::Time),
            "pt_flg" | "flg" | "flag" => Some(Role::Flag),
            _ => None,
        };
        let columns = cells.iter().enumerate().filter_map(|(at, cell)| Some((at, role(cell)?))).collect();
        Self { columns }.checked().ok()
    }

    /// Checks that each role occurs at most once, that there is a position, and that there is exactly one kind of height.
    fn checked(self) -> std::result::Result<Self, String> {
        let count = |role: Role| self.columns.iter().filter(|column| column.1 == role).count();
        let heights = [Role::RadiusKm, Role::RadiusM, Role::HeightM].map(count).iter().sum::<usize>();
        let once = |role: Role| count(role) <= 1;
        if count(Role::LonDeg) == 1 && count(Role::LatDeg) == 1 && heights == 1 && once(Role::Time) && once(Role::Flag)
        {
            return Ok(self);
        }
        Err("one lon, one lat and one of radius_km, radius_m and height_above_datum expected".into())
    }
}

/// Brings `Pt_Longitude` and ` "pt longitude"` to `pt_longitude`.
fn name(cell: &str) -> String {
    let words = cell.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| !word.is_empty());
    words.map(str::to_ascii_lowercase).collect::<Vec<_>>().join("_")
}

/// A table of points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LolaTable {
    /// Points in the order of the file. Heights are in metres above the given sphere.
    pub points: Vec<LaserSpot>,
    /// Number of rows left out because their flag marks them as no measurement of the ground.
    pub flagged: usize,
}

/// Returns whether a line is the heading of a table that this module can read.
#[must_use]
pub fn is_heading(line: &str) -> bool {
    let first = TableRows::new(Path::new(""), line.as_bytes(), usize::MAX).next_row();
    first.is_ok_and(|row| row.is_some_and(|row| CsvFormat::of_heading(&cells(&row)).is_some()))
}

/// Reads the points of a file. Heights are above a sphere of radius `sphere_m`. Without `format`, the heading determines the columns.
///
/// # Errors
/// [`Error::Io`] if the file cannot be read, [`Error::Unsupported`] without a known heading. [`Error::Broken`], with the line, for a value
/// that is not a number, a bad position, a height of more than a million metres, or a radius that differs from the sphere's by more than a
/// tenth.
pub fn read(path: &Path, format: Option<&CsvFormat>, sphere_m: f64) -> Result<LolaTable> {
    parse(path, read::stream(path, read::MOST_BYTES)?, format, sphere_m)
}

/// Reads the points of any text, as [`read`]. `path` is the name of the text in messages.
///
/// # Errors
/// As [`read`].
pub fn parse(path: &Path, text: impl Read, format: Option<&CsvFormat>, sphere_m: f64) -> Result<LolaTable> {
    let mut table = LolaTable::default();
    let mut format = format.cloned();
    let mut rows = TableRows::new(path, text, MOST_LINE_BYTES);
    // With a given format the first line may be a heading, which is skipped.
    let mut first = true;
    while let Some(row) = rows.next_row()? {
        let cells = cells(&row);
        match (&format, std::mem::take(&mut first)) {
            (None, _) => {
                let known = CsvFormat::of_heading(&cells);
                let refuse = || Error::unsupported(path, unknown_heading(&row.text()));
                format = Some(known.ok_or_else(refuse)?);
            }
            (Some(_), true) if cells.iter().all(|cell| cell.parse::<f64>().is_err() && !cell.is_empty()) => {}
            (Some(format), _) => match point(format, &cells, sphere_m) {
                Ok(Some(point)) => table.points.push(point),
                Ok(None) => table.flagged += 1,
                Err(what) => return Err(Error::broken(path, format!("line {}: {what}", row.line))),
            },
        }
    }
    if table.points.is_empty() {
        let what = format!("a table with points expected, found none ({} flagged as no measurement)", table.flagged);
        return Err(Error::broken(path, what));
    }
    Ok(table)
}

fn unknown_heading(line: &str) -> String {
    let start: String = line.chars().filter(|c| !c.is_control()).take(60).collect();
    format!(
        "a heading with longitude, latitude and radius or height expected, found {start:?}; write one, or name the columns: lola --csv-format '1:lon 2:lat 3:radius_km'"
    )
}

/// Returns the cells without their quotes. Separators are commas, otherwise semicolons, otherwise blanks.
fn cells(row: &TableRow) -> Vec<&str> {
    let cells = match row.cells().as_slice() {
        [line] if line.contains(';') => line.split(';').collect(),
        [line] => line.split_ascii_whitespace().collect(),
        cells => cells.to_vec(),
    };
    cells.into_iter().map(|cell| cell.trim().trim_matches('"').trim()).collect()
}

/// Reads one row. Returns `None` if the row is flagged, whatever its other cells hold.
fn point(format: &CsvFormat, cells: &[&str], sphere_m: f64) -> std::result::Result<Option<LaserSpot>, String> {
    let missing = |column: usize| format!("column {} expected, found {} columns", column + 1, cells.len());
    let mut row = Vec::with_capacity(format.columns.len());
    for &(column, role) in &format.columns {
        row.push(Cell { column, role, text: cells.get(column).ok_or_else(|| missing(column))? });
    }
    for cell in row.iter().filter(|cell| cell.role == Role::Flag) {
        if cell.number()? != 0.0 {
            return Ok(None);
        }
    }
    let mut point = LaserSpot { lon_deg: 0.0, lat_deg: 0.0, height_m: 0.0, time_s: None };
    for cell in &row {
        match cell.role {
            Role::LonDeg => point.lon_deg = cell.number()?,
            Role::LatDeg => point.lat_deg = cell.number()?,
            Role::RadiusKm => point.height_m = cell.height_m(1000.0, sphere_m)?,
            Role::RadiusM => point.height_m = cell.height_m(1.0, sphere_m)?,
            Role::HeightM => point.height_m = cell.above_datum_m()?,
            Role::Time => point.time_s = Some(cell.time_s()?),
            Role::Flag => {}
        }
    }
    if point.lon_deg.abs() > 360.0 || point.lat_deg.abs() > 90.0 {
        return Err(format!(
            "longitude and latitude in degrees expected, found {} and {}",
            point.lon_deg, point.lat_deg
        ));
    }
    Ok(Some(point))
}

struct Cell<'a> {
    column: usize,
    role: Role,
    text: &'a str,
}

impl Cell<'_> {
    fn refuse(&self, expected: &str) -> String {
        let start: String = self.text.chars().filter(|c| !c.is_control()).take(30).collect();
        format!("{expected} in column {} expected, found {start:?}", self.column + 1)
    }

    fn number(&self) -> std::result::Result<f64, String> {
        self.text.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| self.refuse("a number"))
    }

    /// Reads the cell as a radius in units of `metres`. Returns the height above the sphere, metres.
    fn height_m(&self, metres: f64, sphere_m: f64) -> std::result::Result<f64, String> {
        let radius_m = self.number()? * metres;
        if (radius_m - sphere_m).abs() > 0.1 * sphere_m {
            let column = self.column + 1;
            return Err(format!("a radius about {sphere_m} m in column {column} expected, found {radius_m} m"));
        }
        Ok(radius_m - sphere_m)
    }

    /// Reads the cell as a height above the sphere, metres.
    fn above_datum_m(&self) -> std::result::Result<f64, String> {
        Some(self.number()?)
            .filter(|height_m| height_m.abs() <= FARTHEST_M)
            .ok_or_else(|| self.refuse("a height of at most 1,000,000 m above or below the sphere"))
    }

    fn time_s(&self) -> std::result::Result<f64, String> {
        let way_out = "a time such as 2009-07-17T00:46:24.5 (or lola --csv-format without time)";
        seconds(self.text).ok_or_else(|| self.refuse(way_out))
    }
}

/// Returns seconds since a fixed moment. Forms: `2009-07-17T00:46:24.5`, `2009-198T00:46:24.5`, or a plain number of seconds.
fn seconds(text: &str) -> Option<f64> {
    if let Ok(seconds) = text.parse::<f64>() {
        return seconds.is_finite().then_some(seconds);
    }
    let (date, clock) = text.trim_end_matches('Z').split_once(['T', ' '])?;
    let mut parts = date.split('-').map(|part| part.parse::<u32>().ok());
    let year = i64::from(parts.next()?.filter(|year| (1..=9999).contains(year))?);
    let (first, second) = (i64::from(parts.next()??), parts.next());
    let year_start =
        |year: i64| 365 * year + (year - 1).div_euclid(4) - (year - 1).div_euclid(100) + (year - 1).div_euclid(400);
    let leap = year_start(year + 1) - year_start(year) - 365;
    let day_of_year = match second {
        None => Some(first - 1).filter(|day| (0..366).contains(day))?,
        Some(day) => {
            let month = usize::try_from(first - 1).ok().filter(|&month| month < 12)?;
            let before = [0, 31, 59, 90, 120, 151, 181, 212, 243, 273, 304, 334][month];
            let day = i64::from(day.filter(|day| (1..=31).contains(day))?);
            before + i64::from(month > 1) * leap + day - 1
        }
    };
    let mut parts = clock.split(':').map(|part| part.parse::<f64>().ok().filter(|v| (0.0..61.0).contains(v)));
    let (hours, minutes) = (parts.next()??, parts.next()??);
    let seconds = parts.next().unwrap_or(Some(0.0))?;
    let whole = parts.next().is_none() && date.split('-').count() <= 3;
    whole.then_some((year_start(year) + day_of_year) as f64 * 86_400.0 + hours * 3600.0 + minutes * 60.0 + seconds)
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_core::sun::Body;
    use elunar_testing::mutate;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    fn read_text(text: &str, format: Option<&str>) -> Result<LolaTable> {
        let format = format.map(|format| format.parse::<CsvFormat>().unwrap());
        parse(Path::new("t.csv"), text.as_bytes(), format.as_ref(), Body::Moon.radius_m())
    }

    #[test]
    fn rdr_tables_are_read() {
        let text = "Coordinated_Universal_Time,Pt_Longitude,Pt_Latitude,Pt_Radius,Pt_Range,Pt_PulseW,Pt_Energy,Pt_noi,Pt_Thr,Pt_Gn,Pt_Flg,S,Frm\r\n\
            2009-07-17T00:46:24.125,  30.5, 20.25, 1737.6000, 52.1, 1, 2, 3, 4, 5, 0, 1, 1\r\n\
            2009-07-17T00:46:24.225,  30.5, 20.25, 9.0, 52.1, 1, 2, 3, 4, 5, 0, 1, 1\r\n";
        let bad = read_text(text, None).unwrap_err().to_string();
        assert!(
            bad.contains("t.csv")
                && bad.contains("line 3: a radius about 1737400 m in column 4 expected, found 9000 m"),
            "{bad}"
        );
        let table =
            read_text(&text.replace("9.0, 52.1, 1, 2, 3, 4, 5, 0", "1737.5, 0, 0, 0, 0, 0, 0, 1"), None).unwrap();
        assert_eq!((table.points.len(), table.flagged), (1, 1));
        let point = table.points[0];
        assert_eq!((point.lon_deg, point.lat_deg), (30.5, 20.25));
        assert!((point.height_m - 200.0).abs() < 1e-6 && point.time_s.is_some());
    }

    #[test]
    fn headings_and_formats_name_the_columns() {
        let simple = read_text("lon,lat,radius_km\n1,2,1737.5\n\n# c\n3,4,1737.4", None).unwrap();
        assert_eq!(simple.points.len(), 2);
        assert!((simple.points[0].height_m - 100.0).abs() < 1e-6);
        let heights = read_text("\u{feff}\"Longitude (deg)\";lat;Height [m]\n359.5;-2;-150.5", None).unwrap();
        assert_eq!((heights.points[0].lon_deg, heights.points[0].height_m), (359.5, -150.5));
        let blanks = read_text("-150.5 x 2 1\n", Some("4:lon 3:lat,1:height_above_datum")).unwrap();
        assert_eq!((blanks.points[0].lat_deg, blanks.points[0].lon_deg), (2.0, 1.0));
        assert_eq!(read_text("a,b,c\n1,2,3", Some("1:lon 2:lat 3:height_above_datum")).unwrap().points.len(), 1);
        for format in [
            "",
            "1:lon",
            "1:lon 2:lat",
            "0:lon 2:lat 3:radius_m",
            "1:lon 2:lat 3:radius_m 4:radius_km",
            "1:x 2:lat 3:radius_m",
        ] {
            assert!(format.parse::<CsvFormat>().is_err(), "{format}");
        }
        assert!(is_heading("Lon, Lat, Radius_km") && !is_heading("1,2,3"));
    }

    #[test]
    fn bad_rows_are_named() {
        let cases = [
            ("1,2,3\n", "a heading with longitude, latitude and radius or height expected, found \"1,2,3\""),
            ("lon,lat,radius\n", "name the columns: lola --csv-format"),
            ("lon,lat,height_m\n", "found none"),
            ("", "found none"),
            ("lon,lat,height_m\n1,2\n", "line 2: column 3 expected, found 2 columns"),
            ("lon,lat,height_m\n1,2,x\n", "line 2: a number in column 3 expected, found \"x\""),
            ("lon,lat,height_m\n1,2,nan\n", "found \"nan\""),
            (
                "lon,lat,height_m\n1,2,3\n1,2,-1e9\n",
                "line 3: a height of at most 1,000,000 m above or below the sphere in column 3",
            ),
            ("lon,lat,height_m\n1,2,1e300\n", "line 2: a height of at most"),
            ("lon,lat,height_m\n1,91,0\n", "found 1 and 91"),
            ("lon,lat,height_m,time\n1,2,0,noon\n", "found \"noon\""),
        ];
        for (text, reason) in cases {
            let found = read_text(text, None).unwrap_err().to_string();
            assert!(found.contains(reason) && !found.contains('\n'), "{found}");
        }
        let endless = format!("lon,lat,height_m\n{}", "1".repeat(1 << 17));
        assert!(read_text(&endless, None).unwrap_err().to_string().contains("line 2: a line below"));
    }

    #[test]
    fn times_are_counted() {
        let at = |text: &str| seconds(text).unwrap();
        assert_eq!(at("2009-07-17T00:46:24.5") - at("2009-07-16T23:46:24"), 3600.5);
        assert_eq!(at("2012-03-01T00:00") - at("2012-02-28T00:00"), 2.0 * 86_400.0, "a leap year");
        assert_eq!(at("2009-198T01:00:00Z"), at("2009-07-17 01:00:00"));
        assert_eq!(at("2010-001T00:00") - at("2009-365T00:00"), 86_400.0);
        for text in ["noon", "2009", "2009-13-01T00:00", "2009-01-32T00:00", "2009-01-01T99:00", "2009-01-01T00", "inf"]
        {
            assert!(text == "2009" || seconds(text).is_none(), "{text}");
        }
    }

    #[test]
    fn damaged_tables_never_panic() {
        let seeds = [
            "Coordinated_Universal_Time,Pt_Longitude,Pt_Latitude,Pt_Radius,Pt_Flg\r\n2009-07-17T00:46:24.1,30.5,20.25,1737.6,0\r\n\
             2009-198T00:46:24.2Z,30.5,20.25,1737.6,1\r\n",
            "\u{feff}\"lon (deg)\"; lat; height_m\n1;2;3\n# c\n4;5;-6\n",
        ];
        let pieces =
            [",", ";", "\n", "\"", "\u{e9}", "1e400", "-", "nan", "Pt_Radius", "9999-366T23:59:60", "#", "\u{feff}"];
        let mut rng = ChaCha8Rng::seed_from_u64(34);
        let (mut read, mut refused) = (0, 0);
        for round in 0..6000 {
            let mut bytes = seeds[round % 2].as_bytes().to_vec();
            mutate(&mut bytes, &pieces, &mut rng);
            match parse(Path::new("t.csv"), bytes.as_slice(), None, Body::Moon.radius_m()) {
                Ok(table) => {
                    let sound = |p: &LaserSpot| p.height_m.is_finite() && p.time_s.is_none_or(f64::is_finite);
                    assert!(table.points.iter().all(sound));
                    read += 1;
                }
                Err(error) => {
                    assert!(!error.to_string().contains('\n'), "{error}");
                    refused += 1;
                }
            }
        }
        assert!(read > 500 && refused > 500, "{read} read, {refused} refused");
    }
}
