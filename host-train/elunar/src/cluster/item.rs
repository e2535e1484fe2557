//! One line of a manifest: an image and what is made of it.

use crate::cli::predict;
use crate::job;
use clap::Parser;
use elunar_base::Result;
use elunar_base::read::refuse_address;
use elunar_net::shipped;
use elunar_net::sun::check_sun;
use serde::Serialize;
use serde_json::{Map, Value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Options of `predict` that a line may state, by their names with `_` for `-`.
const OPTIONS: [&str; 10] = [
    "uncertainty",
    "coarse_sigma",
    "tracks",
    "image_srs",
    "coarse_srs",
    "coarse_unit",
    "fit_sun",
    "image_nodata",
    "coarse_nodata",
    "overlap",
];
/// The one without a value besides `fit_sun`.
const NO_ANCHOR: &str = "no_anchor";
/// Longest name of an item.
const MOST_ID: usize = 100;

/// An image and what is made of it.
#[derive(Debug, Clone, PartialEq, Serialize, Default)]
pub struct BatchItem {
    /// Name of the item: letters, digits, `.`, `_` and `-`.
    pub id: String,
    /// Image.
    pub image: PathBuf,
    /// Coarse DTM.
    pub coarse: PathBuf,
    /// Model.
    pub model: PathBuf,
    /// DTM to write.
    pub output: PathBuf,
    /// Azimuth of the Sun, degrees, if the image's file does not state it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun_azimuth: Option<f64>,
    /// Elevation of the Sun, degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sun_elevation: Option<f64>,
    /// Further options of `predict`.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub options: BTreeMap<String, Value>,
    /// Rows of the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rows: Option<u64>,
    /// Columns of the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cols: Option<u64>,
    /// Size of the image's file, bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_bytes: Option<u64>,
    /// Size of the coarse DTM's file, bytes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coarse_bytes: Option<u64>,
    /// SHA-256 of the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub image_sha256: Option<String>,
    /// SHA-256 of the coarse DTM.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub coarse_sha256: Option<String>,
}

/// What is wrong with a line: the field, and what was expected and found.
pub type Wrong = (String, String);

/// The command line of `predict`, to check options before anything starts.
#[derive(Debug, Parser)]
struct Line {
    #[command(flatten)]
    predict: predict::Args,
}

impl BatchItem {
    /// Reads a line.
    ///
    /// # Errors
    /// The first field that is wrong.
    pub fn parse(text: &str) -> std::result::Result<Self, Wrong> {
        let value: Value = serde_json::from_str(text).map_err(|e| ("-".into(), format!("JSON expected: {e}")))?;
        let Value::Object(mut fields) = value else {
            return Err(("-".into(), format!("an object in braces expected, {value} found")));
        };
        let item = Self {
            id: required(&mut fields, "id")?,
            image: required(&mut fields, "image")?.into(),
            coarse: required(&mut fields, "coarse")?.into(),
            model: required(&mut fields, "model")?.into(),
            output: required(&mut fields, "output")?.into(),
            sun_azimuth: optional(&mut fields, "sun_azimuth", "a number", Value::as_f64)?,
            sun_elevation: optional(&mut fields, "sun_elevation", "a number", Value::as_f64)?,
            options: optional(&mut fields, "options", "an object in braces", |v| v.as_object().cloned())?
                .unwrap_or_default()
                .into_iter()
                .collect(),
            rows: optional(&mut fields, "rows", "a whole number", Value::as_u64)?,
            cols: optional(&mut fields, "cols", "a whole number", Value::as_u64)?,
            image_bytes: optional(&mut fields, "image_bytes", "a whole number", Value::as_u64)?,
            coarse_bytes: optional(&mut fields, "coarse_bytes", "a whole number", Value::as_u64)?,
            image_sha256: optional(&mut fields, "image_sha256", "a text", |v| v.as_str().map(String::from))?,
            coarse_sha256: optional(&mut fields, "coarse_sha256", "a text", |v| v.as_str().map(String::from))?,
        };
        if let Some(name) = fields.keys().next() {
            return Err((name.clone(), "no such field is known".into()));
        }
        item.check()?;
        Ok(item)
    }

    /// Checks the values of all fields. Files need not exist.
    fn check(&self) -> std::result::Result<(), Wrong> {
        let wrong = |field: &str, what: String| Err((field.to_string(), what));
        let is_plain = |c: char| c.is_ascii_alphanumeric() || "._-".contains(c);
        if self.id.is_empty() || self.id.len() > MOST_ID || !self.id.chars().all(is_plain) {
            let what = format!("1 to {MOST_ID} letters, digits, '.', '_' and '-' expected, {:?} found", self.id);
            return wrong("id", what);
        }
        for (path, field) in [(&self.image, "image"), (&self.coarse, "coarse"), (&self.model, "model")] {
            refuse_address(path).map_err(|error| (field.to_string(), error.to_string()))?;
        }
        let extension = self.output.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
        if !matches!(extension.as_str(), "tif" | "tiff") {
            return wrong("output", format!("a name ending in .tif expected, {} found", self.output.display()));
        }
        for (angle, field) in [(self.sun_azimuth, "sun_azimuth"), (self.sun_elevation, "sun_elevation")] {
            let sun = match field {
                "sun_azimuth" => elunar_net::illumination::KnownSun { azimuth_deg: angle, elevation_deg: None },
                _ => elunar_net::illumination::KnownSun { azimuth_deg: None, elevation_deg: angle },
            };
            check_sun(sun).map_err(|e| (field.to_string(), without_name(&e.to_string())))?;
        }
        for (name, value) in &self.options {
            let field = format!("options.{name}");
            let words = option_words(name, value).map_err(|what| (field.clone(), what))?;
            let all = ["predict", "--image=i", "--coarse=c", "--model=m", "--output=o"].map(String::from);
            let uncertain = matches!(name.as_str(), "coarse_sigma" | "tracks").then(|| "--uncertainty=e".to_string());
            if let Err(error) = Line::try_parse_from(all.into_iter().chain(words).chain(uncertain)) {
                let text = error.to_string();
                let first = text.lines().next().unwrap_or_default();
                return Err((field, first.trim_start_matches("error: ").into()));
            }
        }
        for (hash, field) in [(&self.image_sha256, "image_sha256"), (&self.coarse_sha256, "coarse_sha256")] {
            if let Some(Err(what)) = hash.as_deref().map(job::hashes) {
                return wrong(field, what);
            }
        }
        Ok(())
    }

    /// Returns the model: a shipped one by its name, or a file beneath `folder`.
    #[must_use]
    pub fn model_at(&self, folder: &Path) -> PathBuf {
        if shipped::find(&self.model).is_some() { self.model.clone() } else { folder.join(&self.model) }
    }

    /// Returns the path of the file of expected errors, if one is to be written.
    #[must_use]
    pub fn uncertainty(&self) -> Option<&Path> {
        self.options.get("uncertainty").and_then(Value::as_str).map(Path::new)
    }

    /// Returns the command line of `predict` for this item.
    ///
    /// # Errors
    /// If an option is wrong, which [`Self::parse`] refuses.
    pub fn predict(&self, folder: &Path) -> Result<predict::Args> {
        let words = std::iter::once("predict".to_string()).chain(self.words(folder)?);
        let line = Line::try_parse_from(words).map_err(|e| elunar_base::Error::input(e.to_string()))?;
        Ok(line.predict)
    }

    /// Returns the words of `predict` for this item. Paths that are not absolute are beneath `folder`.
    ///
    /// # Errors
    /// If an option has no such form, which [`Self::parse`] refuses.
    pub fn words(&self, folder: &Path) -> Result<Vec<String>> {
        let at = |path: &Path| folder.join(path).display().to_string();
        let mut words = vec![
            format!("--image={}", at(&self.image)),
            format!("--coarse={}", at(&self.coarse)),
            format!("--model={}", self.model_at(folder).display()),
            format!("--output={}", at(&self.output)),
        ];
        words.extend(self.sun_azimuth.map(|deg| format!("--sun-azimuth={deg}")));
        words.extend(self.sun_elevation.map(|deg| format!("--sun-elevation={deg}")));
        words.extend(self.image_sha256.as_ref().map(|hash| format!("--image-sha256={hash}")));
        words.extend(self.coarse_sha256.as_ref().map(|hash| format!("--coarse-sha256={hash}")));
        for (name, value) in &self.options {
            let is_path = matches!(name.as_str(), "uncertainty" | "tracks");
            let value = match value.as_str() {
                Some(path) if is_path => Value::String(at(Path::new(path))),
                _ => value.clone(),
            };
            words.extend(option_words(name, &value).map_err(elunar_base::Error::input)?);
        }
        Ok(words)
    }
}

fn required(fields: &mut Map<String, Value>, name: &str) -> std::result::Result<String, Wrong> {
    match fields.remove(name) {
        Some(Value::String(text)) if !text.is_empty() => Ok(text),
        Some(found) => Err((name.into(), format!("a text expected, {found} found"))),
        None => Err((name.into(), "a text expected, none found".into())),
    }
}

fn optional<T>(
    fields: &mut Map<String, Value>,
    name: &str,
    expected: &str,
    read: impl Fn(&Value) -> Option<T>,
) -> std::result::Result<Option<T>, Wrong> {
    let Some(found) = fields.remove(name) else { return Ok(None) };
    match read(&found) {
        Some(value) => Ok(Some(value)),
        None => Err((name.into(), format!("{expected} expected, {found} found"))),
    }
}

/// Returns an option as words of a command line; none for a switch that is off.
fn option_words(name: &str, value: &Value) -> std::result::Result<Vec<String>, String> {
    let option = format!("--{}", name.replace('_', "-"));
    let is_switch = matches!(name, "fit_sun" | NO_ANCHOR);
    if !is_switch && !OPTIONS.contains(&name) {
        return Err(format!("one of {}, {NO_ANCHOR} expected", OPTIONS.join(", ")));
    }
    match value {
        Value::Bool(is_on) if is_switch => Ok(if *is_on { vec![option] } else { vec![] }),
        _ if is_switch => Err(format!("true or false expected, {value} found")),
        Value::String(text) => Ok(vec![format!("{option}={text}")]),
        Value::Number(number) => Ok(vec![format!("{option}={number}")]),
        _ => Err(format!("a text or a number expected, {value} found")),
    }
}

/// Leaves out the option's name at the beginning of a message.
fn without_name(text: &str) -> String {
    text.split_once(": ").map_or(text, |(_, rest)| rest).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{"id":"a","image":"a.tif","coarse":"c.tif","model":"m.eld","output":"out/a.tif","sun_azimuth":12.5,
        "options":{"overlap":80,"no_anchor":true,"fit_sun":false,"coarse_unit":"km","image_nodata":-1,
        "uncertainty":"e.tif","tracks":"t.csv"},"rows":5}"#;

    #[test]
    fn a_line_becomes_the_words_of_predict() {
        let item = BatchItem::parse(GOOD).unwrap();
        let words = item.words(Path::new("/data")).unwrap().join(" ");
        let expected = "--image=/data/a.tif --coarse=/data/c.tif --model=/data/m.eld --output=/data/out/a.tif \
            --sun-azimuth=12.5 --coarse-unit=km --image-nodata=-1 --no-anchor --overlap=80 \
            --tracks=/data/t.csv --uncertainty=/data/e.tif";
        assert_eq!(words, expected);
        let again = BatchItem::parse(&serde_json::to_string(&item).unwrap()).unwrap();
        assert_eq!(again, item);
    }

    #[test]
    fn what_is_wrong_is_named_by_its_field() {
        let change = |from: &str, to: &str| BatchItem::parse(&GOOD.replace(from, to)).unwrap_err();
        let cases = [
            (r#""id":"a""#, r#""id":"a/b""#, "id", "letters, digits"),
            (r#""id":"a","#, "", "id", "none found"),
            (r#""image":"a.tif""#, r#""image":7"#, "image", "a text expected, 7 found"),
            ("out/a.tif", "out/a.png", "output", ".tif expected"),
            ("\"a.tif\"", "\"http://h/a.tif\"", "image", "found an address; this fetches it: gdal_translate"),
            ("m.eld", "https://h/m.eld", "model", "this fetches it: curl -L -o m.eld https://h/m.eld"),
            ("12.5", "400", "sun_azimuth", "a number from -360 to 360"),
            ("12.5", "\"x\"", "sun_azimuth", "a number expected"),
            ("\"overlap\":80", "\"overlap\":\"x\"", "options.overlap", "invalid value 'x'"),
            ("\"overlap\":80", "\"threads\":8", "options.threads", "one of uncertainty"),
            ("\"no_anchor\":true", "\"no_anchor\":1", "options.no_anchor", "true or false"),
            ("km", "miles", "options.coarse_unit", "invalid value 'miles'"),
            ("\"rows\":5", "\"rows\":-5", "rows", "a whole number"),
            ("\"rows\":5", "\"lines\":5", "lines", "no such field"),
            ("\"rows\":5", "\"coarse_sha256\":\"12\"", "coarse_sha256", "hexadecimal"),
            (GOOD, "[1]", "-", "an object"),
            (GOOD, "{", "-", "JSON expected"),
        ];
        for (from, to, field, what) in cases {
            let found = change(from, to);
            assert!(found.0 == field && found.1.contains(what), "{to}: {found:?}");
        }
    }
}
