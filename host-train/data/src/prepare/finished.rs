//! A set that is complete: whether a run would make the same.

use super::list::SceneFiles;
use super::manifest::{MADE_BY, MANIFEST, PrepareOptions, TrainingSetManifest};
use elunar_base::output::settle;
use elunar_base::{Error, Result};
use std::path::Path;

/// Returns the manifest of `out` if the folder has one and a run with the same program, scenes and parameters wrote it. Scenes are compared
/// by content, not by path.
///
/// # Errors
/// [`Error::Input`] if another run wrote it, with the first difference; [`Error::Broken`] if a shard is not the one that the manifest
/// names. Errors of reading are passed on.
pub(super) fn find(
    scenes: &[SceneFiles],
    out: &Path,
    parameters: &PrepareOptions,
) -> Result<Option<TrainingSetManifest>> {
    if !out.join(MANIFEST).exists() {
        return Ok(None);
    }
    let other = |what: &str| {
        Error::input(format!("{}: a new or unfinished folder expected, a finished set {what} found", out.display()))
    };
    let manifest = TrainingSetManifest::find(out)?.ok_or_else(|| other("of another program"))?;
    if manifest.made_by != MADE_BY {
        return Err(other(&format!("by {}", manifest.made_by)));
    }
    if manifest.parameters != *parameters {
        return Err(other("with other options"));
    }
    if manifest.scenes.len() != scenes.len() {
        return Err(other(&format!("of {} scenes instead of {}", manifest.scenes.len(), scenes.len())));
    }
    for (known, files) in manifest.scenes.iter().zip(scenes) {
        let same_but_paths = SceneFiles {
            image: files.image.clone(),
            dtm: files.dtm.clone(),
            coarse: files.coarse.clone(),
            ..known.files.clone()
        };
        if same_but_paths != *files {
            return Err(other(&format!("with another site or Sun of {}", files.image.display())));
        }
        for (path, sha256) in [&files.image, &files.dtm, &files.coarse].into_iter().zip(&known.sha256) {
            if elunar_base::digest::sha256(path)? != *sha256 {
                return Err(other(&format!("of another {}", path.display())));
            }
        }
    }
    for shard in manifest.splits.values().flat_map(|split| &split.shards) {
        let path = out.join(&shard.file);
        if elunar_base::digest::sha256(&path)? != shard.sha256 {
            return Err(Error::broken(&path, format!("the bytes that {MANIFEST} names expected, others found")));
        }
    }
    settle(&out.join(MANIFEST))?;
    Ok(Some(manifest))
}
