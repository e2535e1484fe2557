//! What a job is: its inputs by their contents, the model and the options. The DTM states it, so that finished work is recognised anywhere.

use elunar_base::digest::{sha256, sha256_hex};
use elunar_base::{Result, interrupt, read};
use elunar_raster::content::identity_of_raster_while;
use elunar_raster::{geotiff, pds4};
use std::path::{Path, PathBuf};

/// Metadata item of a DTM with the identity of its job.
pub const JOB_ITEM: &str = "JOB_SHA256";

/// Returns options as `name=value` words with blanks between. Options without a value are left out; a blank in a value becomes `_`.
#[must_use]
pub fn words<'a>(options: impl IntoIterator<Item = (&'a str, Option<String>)>) -> String {
    let word =
        |(name, value): (&str, Option<String>)| Some(format!("{name}={}", value?.replace(char::is_whitespace, "_")));
    options.into_iter().filter_map(word).collect::<Vec<_>>().join(" ")
}

/// The identity of a job.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Identity {
    /// SHA-256 of the image's files, or what stands for a file on the net ([`identity_of_raster_while`]).
    pub image: String,
    /// The same of the coarse DTM.
    pub coarse: String,
    /// The options that change the result: `name=value`, with blanks between ([`words`]).
    pub options: String,
    /// SHA-256 of all of this, the program's version and the model.
    pub job: String,
}

impl Identity {
    /// Makes the identity of a job from what stands for its inputs. `model` describes the model, with its hash, or the method.
    #[must_use]
    pub fn new(image: String, coarse: String, model: &str, options: String) -> Self {
        let version = env!("CARGO_PKG_VERSION");
        let job = sha256_hex(format!("{version}\n{image}\n{coarse}\n{model}\n{options}\n"));
        Self { image, coarse, options, job }
    }

    /// Reads the inputs and makes the identity.
    ///
    /// # Errors
    /// As [`content_of_input`].
    pub fn of(image: &Path, coarse: &Path, model: &str, options: String) -> Result<Self> {
        Ok(Self::new(content_of_input(image)?, content_of_input(coarse)?, model, options))
    }

    /// Returns the metadata items that state the identity.
    pub(super) fn items(&self) -> [(&'static str, String); 4] {
        let Self { image, coarse, options, job } = self.clone();
        let name = |content: &str, hash, address| if is_hash(content) { hash } else { address };
        [
            (name(&image, "IMAGE_SHA256", "IMAGE_ADDRESS"), image),
            (name(&coarse, "COARSE_DTM_SHA256", "COARSE_DTM_ADDRESS"), coarse),
            ("OPTIONS", options),
            (JOB_ITEM, job),
        ]
    }

    /// Returns whether `output` is this job's finished file: it states the job, and its bytes have the sum that lies beside it. Whatever is
    /// wrong with the file or its sum, it then is not finished.
    #[must_use]
    pub fn is_finished(&self, output: &Path) -> bool {
        let states = || geotiff::read_item(output, JOB_ITEM).ok().flatten();
        output.is_file() && states().is_some_and(|job| job == self.job) && has_its_sum(output)
    }
}

/// Returns whether what stands for an input is a SHA-256, or several.
#[must_use]
pub fn is_hash(content: &str) -> bool {
    content.bytes().all(|byte| byte.is_ascii_hexdigit() || byte == b'+')
}

/// Returns the SHA-256 of a raster's files, or what stands for a file on the net. Ctrl-C stops the reading.
///
/// # Errors
/// As [`identity_of_raster_while`].
pub fn content_of_input(path: &Path) -> Result<String> {
    interrupt::listen();
    identity_of_raster_while(path, &|| !interrupt::requested())
}

/// Returns the note of a PDS4 label about the job that made it.
#[must_use]
pub fn job_note(job: &str) -> String {
    format!("{JOB_ITEM} {job}")
}

/// Returns whether a file is a GeoTIFF or a PDS4 label (`.xml`) that states the job that made it, whatever job.
#[must_use]
pub fn states_a_job(path: &Path) -> bool {
    if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("xml")) {
        return path.is_file() && pds4::note(path).is_some_and(|note| note.starts_with(&job_note("")));
    }
    path.is_file() && geotiff::read_item(path, JOB_ITEM).is_ok_and(|job| job.is_some())
}

/// Most bytes of a file with one sum and one name.
const MOST_SUM_BYTES: u64 = 1 << 16;

/// Returns whether a file's bytes have the SHA-256 that lies beside it.
#[must_use]
pub fn has_its_sum(path: &Path) -> bool {
    let known = read::text(&sum_path(path), MOST_SUM_BYTES).unwrap_or_default();
    let known = known.split_whitespace().next().unwrap_or_default();
    !known.is_empty() && sha256(path).is_ok_and(|found| found == known)
}

/// Returns the path of the SHA-256 of a file: `dtm.tif.sha256` beside `dtm.tif`. `sha256sum --check` reads it.
#[must_use]
pub fn sum_path(output: &Path) -> PathBuf {
    let mut name = output.file_name().unwrap_or_default().to_os_string();
    name.push(".sha256");
    output.with_file_name(name)
}
