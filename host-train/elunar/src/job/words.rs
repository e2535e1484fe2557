//! Options in plain words, for the metadata of outputs.

use clap::ValueEnum;
use elunar_base::digest::sha256_hex;
use elunar_raster::Crs;
use std::path::Path;

/// Returns the name of a value as on the command line.
pub fn name<T: ValueEnum>(value: &T) -> Option<String> {
    value.to_possible_value().map(|value| value.get_name().to_string())
}

/// Returns a number as a word.
#[must_use]
pub fn number(value: Option<f64>) -> Option<String> {
    value.map(|value| value.to_string())
}

/// Returns a file's name without its folder, for people.
pub(super) fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Returns a reference system as one word: its summary, and the start of a SHA-256 of all its keys, which the summary does not hold.
#[must_use]
pub fn srs(crs: &Crs) -> String {
    // Only a hash sees the keys' own form.
    let keys = sha256_hex(format!("{crs:?}"));
    format!("{};keys:{}", crs.summary().replace(", ", ","), &keys[..16])
}

#[cfg(test)]
mod tests {
    use super::*;
    use elunar_raster::stated::HeightUnit;

    #[test]
    fn values_are_words() {
        assert_eq!(name(&HeightUnit::Km).unwrap(), "km");
        let [a, b] = ["IAU_2015:30110", "IAU_2015:30100"].map(|text| srs(&Crs::parse(text).unwrap()));
        assert!(a != b && a.contains("equirectangular,") && a.contains(";keys:"), "{a} {b}");
    }
}
