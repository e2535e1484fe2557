//! The models that ride inside the programs. Where a command takes a model, `ground` and `nano` are these; every other path, and one of these
//! words with a folder or an extension (`./ground`, `ground.eld`), is a file.

use elunar_base::{Result, read};
use std::path::Path;

/// Name, file name and bytes of every shipped model.
const MODELS: [(&str, &str, &[u8]); 2] = [
    ("ground", "ground.eld", include_bytes!("../../models/ground.eld")),
    ("nano", "nano.eld", include_bytes!("../../models/nano.eld")),
];

/// Returns file name and bytes of the shipped model that `path` names.
#[must_use]
pub fn find(path: &Path) -> Option<(&'static str, &'static [u8])> {
    let found = MODELS.iter().find(|(name, ..)| path.as_os_str() == *name);
    found.map(|&(_, file, bytes)| (file, bytes))
}

/// Returns file name and bytes of a model: the shipped one that `path` names, or a file of at most [`read::MOST_BYTES`].
///
/// # Errors
/// As [`read::bytes`].
pub fn model(path: &Path) -> Result<(String, Vec<u8>)> {
    if let Some((file, bytes)) = find(path) {
        return Ok((file.into(), bytes.to_vec()));
    }
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    Ok((name, read::bytes(path, read::MOST_BYTES)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_bare_word_is_a_shipped_model() {
        for (name, file, bytes) in MODELS {
            assert_eq!(model(Path::new(name)).unwrap(), (file.to_string(), bytes.to_vec()));
            let on_disk = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models").join(file);
            assert!(find(&on_disk).is_none() && model(&on_disk).unwrap() == (file.into(), bytes.to_vec()));
            for file in [format!("./{name}"), format!("{name}.eld"), format!("{name}/"), name.to_uppercase()] {
                assert!(find(Path::new(&file)).is_none(), "{file}");
            }
        }
        assert!(find(Path::new("")).is_none());
    }
}
