//! A prediction as the user asks for it.

use super::inputs::Inputs;
use crate::outputs::OutputTarget;
use std::path::{Path, PathBuf};

/// Inputs, model, outputs and options.
#[derive(Debug, Clone, clap::Args)]
pub struct Request {
    /// Image and coarse DTM.
    #[command(flatten)]
    pub inputs: Inputs,
    /// Model: `ground` or `nano`, which are in this program, or a file, .eld for the int8 runner. `host-train` also accepts .safetensors, the float network.
    #[arg(long, value_name = "M")]
    pub model: PathBuf,
    /// DTM to write.
    #[arg(short, long, value_name = "DTM.tif")]
    pub output: PathBuf,
    /// Write the errors that heights and slopes are expected to have: a GeoTIFF with their standard deviations (metres; metres per metre
    /// along either axis) and the origin of each height. For models of weighed maps.
    #[arg(long, value_name = "ERR.tif")]
    pub uncertainty: Option<PathBuf>,
    /// Standard deviation of the coarse DTM's own heights, metres [default: 0.04 of its pixels, at most 3 m].
    #[arg(long, value_name = "M", value_parser = metres, requires = "uncertainty")]
    pub coarse_sigma: Option<f32>,
    /// Find the standard deviation of the coarse DTM's own heights along laser altimeter tracks across the image: tables of points, one or
    /// several, as for `lola`, with a heading.
    #[arg(long, value_name = "F.csv", num_args = 1.., requires = "uncertainty", conflicts_with = "coarse_sigma")]
    pub tracks: Vec<PathBuf>,
    /// Write a page that shows image, coarse DTM and DTM as a relief under a light that the reader turns, with what was found. The page
    /// needs no other file.
    #[arg(long, value_name = "PAGE.html")]
    pub report: Option<PathBuf>,
    /// Write a STAC item beside the DTM that describes it, for catalogues.
    #[arg(long, value_name = "ITEM.json")]
    pub stac: Option<PathBuf>,
    /// Write the heights as a PDS4 product, for archives: this label, and an array beside it (.img).
    #[arg(long, value_name = "LABEL.xml")]
    pub pds4: Option<PathBuf>,
    /// Number of threads; 0 takes as many as the machine offers.
    #[arg(long, default_value_t = 0, value_parser = crate::threads::number)]
    pub threads: usize,
    /// Folder for the rows of the unfinished DTM, such as a disk of this machine [default: beside the DTM].
    #[arg(long, value_name = "DIR")]
    pub part_dir: Option<PathBuf>,
    /// SHA-256 of the image: the file is not read for it. That of a PDS3 product is LABEL+IMAGE. A manifest knows it.
    #[arg(long, value_name = "HEX", value_parser = hashes, hide = true)]
    pub image_sha256: Option<String>,
    /// SHA-256 of the coarse DTM, likewise.
    #[arg(long, value_name = "HEX", value_parser = hashes, hide = true)]
    pub coarse_sha256: Option<String>,
    /// Overlap of neighbouring tiles, pixels [default: 100, or a third of a smaller tile's shorter side].
    #[arg(long, value_name = "PX")]
    pub overlap: Option<usize>,
    /// Take the low frequencies from the network, not from the coarse DTM, as in the paper.
    #[arg(long)]
    pub no_anchor: bool,
}

impl Request {
    /// Returns the files that are read.
    pub(super) fn read(&self) -> Vec<&Path> {
        let inputs = [&self.inputs.image, &self.inputs.coarse, &self.model];
        inputs.into_iter().chain(&self.tracks).map(PathBuf::as_path).collect()
    }

    /// Returns what is written besides the DTM.
    pub(super) fn further(&self) -> Vec<OutputTarget<'_>> {
        let errors = self.uncertainty.iter().map(|path| OutputTarget::Errors(path));
        let labels = self.pds4.iter().map(|path| OutputTarget::Label(path));
        let files = self.report.iter().chain(&self.stac).map(|path| OutputTarget::File(path));
        errors.chain(files).chain(labels).collect()
    }
}

/// Parses a SHA-256, or several joined by `+`.
pub(crate) fn hashes(text: &str) -> std::result::Result<String, String> {
    let is_hash = |hash: &str| hash.len() == 64 && hash.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    if text.split('+').all(is_hash) {
        Ok(text.into())
    } else {
        Err("64 hexadecimal digits in lower case expected, or several such numbers joined by +".into())
    }
}

/// Parses a standard deviation, metres.
fn metres(text: &str) -> std::result::Result<f32, String> {
    let sigma_m = text.parse().map_err(|_| "a number of metres expected".to_string())?;
    if (0.0..1e6).contains(&sigma_m) { Ok(sigma_m) } else { Err("metres from 0 to 1,000,000 expected".into()) }
}
