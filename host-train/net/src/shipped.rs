//! The models that ride inside the programs, as they are or, with the feature `packed`, compressed. Where a command takes a model, `ground` and `nano` are these; every other path, and one of these
//! words with a folder or an extension (`./ground`, `ground.eld`), is a file.

use elunar_base::{Result, read};
use std::path::Path;

/// Name and file name of every shipped model.
#[cfg(not(target_family = "wasm"))]
const MODELS: [(&str, &str); 2] = [("ground", "ground.eld"), ("nano", "nano.eld")];
/// On WebAssembly the page loads the model's file, so that the program is small.
#[cfg(target_family = "wasm")]
const MODELS: [(&str, &str); 0] = [];
/// Most bytes of a shipped model (our choice).
#[cfg(feature = "packed")]
const MOST_BYTES: usize = 1 << 23;

/// Returns the bytes of a model, as they are.
#[cfg(all(not(feature = "packed"), not(target_family = "wasm")))]
fn bytes(model: usize) -> &'static [u8] {
    [&include_bytes!("../../models/ground.eld")[..], include_bytes!("../../models/nano.eld")][model]
}

#[cfg(target_family = "wasm")]
fn bytes(_: usize) -> &'static [u8] {
    &[]
}

/// Returns the bytes of a model, unpacked at its first use.
#[cfg(all(feature = "packed", not(target_family = "wasm")))]
fn bytes(model: usize) -> &'static [u8] {
    static PACKED: [&[u8]; 2] = [
        include_bytes!(concat!(env!("OUT_DIR"), "/ground.zst")),
        include_bytes!(concat!(env!("OUT_DIR"), "/nano.zst")),
    ];
    static UNPACKED: [std::sync::OnceLock<Vec<u8>>; 2] = [const { std::sync::OnceLock::new() }; 2];
    UNPACKED[model].get_or_init(|| zstd::bulk::decompress(PACKED[model], MOST_BYTES).expect("the build has packed it"))
}

/// Returns file name and bytes of the shipped model that `path` names.
#[must_use]
pub fn find(path: &Path) -> Option<(&'static str, &'static [u8])> {
    let model = MODELS.iter().position(|(name, _)| path.as_os_str() == *name)?;
    Some((MODELS[model].1, bytes(model)))
}

/// Returns file name and bytes of a model: the shipped one that `path` names, or a file of at most [`read::MOST_WEIGHTS_BYTES`].
///
/// # Errors
/// As [`read::bytes`].
pub fn model(path: &Path) -> Result<(String, Vec<u8>)> {
    if let Some((file, bytes)) = find(path) {
        return Ok((file.into(), bytes.to_vec()));
    }
    let name = path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    Ok((name, read::bytes(path, read::MOST_WEIGHTS_BYTES)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_bare_word_is_a_shipped_model() {
        for (name, file) in MODELS {
            let on_disk = Path::new(env!("CARGO_MANIFEST_DIR")).join("../models").join(file);
            assert!(find(&on_disk).is_none() && model(&on_disk).unwrap() == model(Path::new(name)).unwrap(), "{name}");
            assert_eq!(model(Path::new(name)).unwrap().0, file);
            for file in [format!("./{name}"), format!("{name}.eld"), format!("{name}/"), name.to_uppercase()] {
                assert!(find(Path::new(&file)).is_none(), "{file}");
            }
        }
        assert!(find(Path::new("")).is_none());
    }
}
