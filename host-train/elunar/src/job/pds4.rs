//! The PDS4 product of a finished prediction: a label, and the heights in an array beside it.

use super::request::Request;
use super::stac::named;
use super::task::Task;
use elunar_base::{Result, SOFTWARE};
use elunar_raster::{geotiff, pds4};
use elunar_scene::predict::identity::job_note;
use std::path::Path;

/// Writes label and array, from the DTM.
///
/// # Errors
/// As [`pds4::write`].
pub(super) fn write(path: &Path, args: &Request, task: &Task) -> Result<()> {
    let identity = &task.identity;
    let comment = format!(
        "Heights above the sphere, metres, from the image {} and the coarse DTM {}, by {} of {SOFTWARE}. An archive gives its own logical identifier, investigation and observing system.",
        named(&args.inputs.image, &identity.image),
        named(&args.inputs.coarse, &identity.coarse),
        task.work.model.description()
    );
    let title = format!("DTM {}", args.output.file_stem().unwrap_or_default().to_string_lossy());
    let note = job_note(&identity.job);
    let product = pds4::Product { title: &title, comment: &comment, note: &note, time: task.work.time };
    pds4::write(path, &*geotiff::open(&args.output)?, &product)
}

#[cfg(test)]
mod tests {
    use crate::job::{self, Request};
    use clap::Parser;
    use elunar_raster::source::{open, read_all};
    use elunar_synth::{Moon, SynthOptions};

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        request: Request,
    }

    #[test]
    fn the_product_has_the_dtms_heights_and_is_made_once() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let text = |name: &str| at(name).display().to_string();
        Moon::new(3, SynthOptions::default()).unwrap().scene(0, 60, 64).unwrap().write(folder.path()).unwrap();
        let [image, coarse, dtm] = ["scene_0000_image.tif", "scene_0000_coarse.tif", "dtm.tif"].map(text);
        let words = ["x", "--image", &image, "--coarse", &coarse, "--model", "nano", "-o", &dtm];
        let run = |label: &str, more: &[&str]| {
            let label = format!("--pds4={}", text(label));
            let line = words.iter().copied().chain([label.as_str()]).chain(more.iter().copied());
            job::run(&Line::parse_from(line).request, None, job::open).map(|done| done.text)
        };
        // What lies in the place of the samples is another's.
        std::fs::write(at("dtm.img"), "mine").unwrap();
        let refused = run("dtm.xml", &[]).err().unwrap().to_string();
        assert!(refused.contains("dtm.img") && refused.contains("of an earlier run or nothing expected"), "{refused}");
        assert!(run("dtm.txt", &[]).err().unwrap().to_string().contains("a name ending in .xml expected"));
        std::fs::remove_file(at("dtm.img")).unwrap();
        let same = || {
            let [made, label] = ["dtm.tif", "dtm.xml"].map(|name| open(&at(name)).unwrap());
            let [made, read] = [&made, &label].map(|source| read_all(&**source).unwrap());
            let bits = |samples: &[f32]| samples.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
            assert_eq!((bits(&read.samples), read.rows), (bits(&made.samples), 60));
            let place = |raster: &elunar_raster::Raster| raster.georef.clone().unwrap();
            assert!(place(&read).crs.same_as(&place(&made).crs) && place(&read).transform == place(&made).transform);
            label.info().sun.time.map(|time| time.to_string())
        };
        assert!(run("dtm.xml", &["--time", "2009-08-30T12:00:00"]).unwrap().contains("dtm.xml: PDS4 label"));
        assert_eq!(same().as_deref(), Some("2009-08-30T12:00:00Z"));
        assert!(run("dtm.xml", &["--time", "2009-08-30T12:00:00"]).unwrap().contains("finished before"));
        // Another job replaces it; samples that were changed are made again.
        assert!(run("dtm.xml", &[]).unwrap().contains("PDS4 label"));
        assert_eq!(same(), None);
        std::fs::write(at("dtm.img"), [0; 60 * 64 * 4]).unwrap();
        assert!(run("dtm.xml", &[]).unwrap().contains("PDS4 label"));
        assert_eq!(same(), None);
    }
}
