//! Laser altimeter tracks that say how large a coarse DTM's own errors are.

mod common;

use common::{elunar, made};
use elunar_raster::geotiff::{WriteOptions, read, read_item, write};
use elunar_raster::{Projection, Raster};
use std::path::Path;

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/nano.eld");
const INPUTS: [&str; 6] = ["--image", "s/scene_0000_image.tif", "--coarse", "high.tif", "--model", MODEL];
/// The coarse DTM's error, metres.
const TOO_HIGH_M: f32 = 8.0;

/// Makes a scene whose coarse DTM is too high. Returns its truth.
fn scene(folder: &Path) -> Raster {
    made(folder, &["synth", "--out", "s", "--rows", "600", "--cols", "400", "--seed", "5"]);
    let mut coarse = read(folder.join("s/scene_0000_coarse.tif")).unwrap();
    coarse.samples.iter_mut().for_each(|z| *z += TOO_HIGH_M);
    write(&folder.join("high.tif"), &coarse, &WriteOptions::heights("too high")).unwrap();
    read(folder.join("s/scene_0000_truth.tif")).unwrap()
}

/// Returns the rows of a table: the truth down each of `cols`, an hour apart, and two false returns.
fn table(truth: &Raster, cols: &[usize]) -> String {
    let georef = truth.georef.as_ref().unwrap();
    let projection = Projection::of(&georef.crs).unwrap();
    let mut text = "time,lon,lat,height_m\n".to_string();
    for (hour, &col) in cols.iter().enumerate() {
        for row in (10..590).step_by(29) {
            let (x, y) = georef.centre(row as f64, col as f64);
            let (lon, lat) = projection.inverse(x, y);
            let height_m = truth.samples[row * truth.cols + col] + if row == 300 { 700.0 } else { 0.0 };
            text += &format!("2010-07-17T{hour:02}:00:00,{lon:.9},{lat:.9},{height_m:.4}\n");
        }
    }
    text
}

fn words<'a>(first: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    [first, &INPUTS, &["-o", "dtm.tif", "--uncertainty", "e.tif"], more].concat()
}

#[test]
fn an_error_that_no_image_shows_is_found_along_tracks() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let truth = scene(at);
    std::fs::write(at.join("t.csv"), table(&truth, &[30, 200])).unwrap();
    std::fs::write(at.join("u.csv"), table(&truth, &[330])).unwrap();
    let out = elunar(at, &words(&["predict"], &["--json", "--tracks", "t.csv", "u.csv"]));
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success(), "{said}");
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let errors = &found["uncertainty"];
    let tracks = &errors["tracks"];
    assert_eq!((&errors["coarse_sigma_from"], &tracks["tracks"]), (&"tracks".into(), &3.into()));
    assert_eq!((&tracks["points"], &tracks["outliers"]), (&57.into(), &3.into()), "{tracks}");
    // The scene's own errors, which the image does not explain, are added to the offset.
    let number = |name: &str| tracks[name].as_f64().unwrap();
    let wrong_m = (number("mean_m") - f64::from(TOO_HIGH_M)).abs();
    assert!(wrong_m < 2.0 * number("mean_sd_m") + 0.5, "{tracks}");
    assert!((7.0..10.0).contains(&number("sigma_m")), "{tracks}");
    assert!(said.contains("from 57 laser points of 3 tracks without 3 outliers; DTM minus points"), "{said}");
    let stated = read_item(&at.join("e.tif"), "COARSE_SIGMA_FROM").unwrap().unwrap();
    assert!(stated.contains("57 laser points of 3 tracks"), "{stated}");
    // 1.2 km of ground are 20 coarse pixels: an offset has the same sign on all.
    let length_m = errors["coarse_correlation_m"].as_f64().unwrap();
    let item = |name: &str| read_item(&at.join("e.tif"), name).unwrap().unwrap();
    assert!((500.0..700.0).contains(&length_m), "{errors}");
    assert_eq!(item("COARSE_CORRELATION_M").parse::<f64>().unwrap() as f32, length_m as f32);
    assert_eq!(
        (errors["coarse_correlation_from"].as_str(), item("COARSE_CORRELATION_FROM").as_str()),
        (Some("tracks, at least"), "tracks, at least")
    );
    assert_eq!(tracks["correlation"]["is_least"], true);
    let options = read_item(&at.join("dtm.tif"), "OPTIONS").unwrap().unwrap();
    assert!(options.contains(" tracks_sha256="), "{options}");
    // What is assumed is far too small; what is found is not.
    let covered = |errors: &str| -> f64 {
        let words =
            ["evaluate", "--dtm", "dtm.tif", "--truth", "s/scene_0000_truth.tif", "--json", "--uncertainty", errors];
        let text = made(at, &words);
        let scores: serde_json::Value = serde_json::from_str(&text).unwrap();
        scores["expected_errors"]["heights"]["all"]["within_1_96_sd"].as_f64().unwrap()
    };
    let with_tracks = covered("e.tif");
    let bytes = std::fs::read(at.join("e.tif")).unwrap();

    // Parts give the same bytes.
    std::fs::remove_file(at.join("dtm.tif")).unwrap();
    let tracked = ["--tracks", "t.csv", "u.csv"];
    for part in ["1/2", "2/2"] {
        made(at, &words(&["predict", "--part", part], &tracked));
    }
    made(at, &words(&["join", "--parts", "2"], &tracked));
    assert!(std::fs::read(at.join("e.tif")).unwrap() == bytes);
    assert!(made(at, &words(&["predict"], &tracked)).contains("finished before"));
    // Other points are another job.
    std::fs::write(at.join("u.csv"), table(&truth, &[310])).unwrap();
    assert!(!made(at, &words(&["predict"], &tracked)).contains("finished before"));

    let text = made(at, &words(&["predict"], &[]));
    assert!(text.contains("(assumed; --coarse-sigma tells it, --tracks find it)"), "{text}");
    let item = |name: &str| read_item(&at.join("e.tif"), name).unwrap().unwrap();
    // Nine coarse pixels.
    assert!((item("COARSE_CORRELATION_M").parse::<f64>().unwrap() / 59.2253 - 9.0).abs() < 0.01);
    assert_eq!(item("COARSE_CORRELATION_FROM"), "assumed");
    let assumed = covered("e.tif");
    assert!(with_tracks > 0.9 && assumed < 0.5, "{with_tracks} {assumed}");
}

#[test]
fn tracks_that_say_too_little_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let truth = scene(at);
    let whole = table(&truth, &[30, 200]);
    let few: String = whole.lines().take(10).map(|line| format!("{line}\n")).collect();
    let beyond = "lon,lat,height_m\n12,1,0\n".to_string();
    let unnamed: String = whole.lines().skip(1).map(|line| format!("{line}\n")).collect();
    let one = table(&truth, &[30]);
    for (name, text) in [("few", &few), ("beyond", &beyond), ("unnamed", &unnamed), ("one", &one), ("good", &whole)] {
        std::fs::write(at.join(name).with_extension("csv"), text).unwrap();
    }
    let cases = [
        (
            &["--tracks", "few.csv"][..],
            65,
            "few.csv: points in at least 20 coarse pixels on 2 tracks expected inside the image, found in 9 on 1",
        ),
        (&["--tracks", "beyond.csv"], 65, "found in 0 on 0"),
        (&["--tracks", "one.csv"], 65, " on 1 (times cut tracks; a table without times is one)"),
        (&["--tracks", "unnamed.csv"], 65, "a heading with longitude, latitude and radius or height expected"),
        (&["--tracks", "absent.csv"], 65, "absent.csv"),
        (
            &["--tracks", "good.csv", "--coarse-sigma", "2"],
            64,
            "'--tracks <F.csv>...' cannot be used with '--coarse-sigma <M>'",
        ),
    ];
    for (more, code, expected) in cases {
        let out = elunar(at, &words(&["predict"], more));
        let text = String::from_utf8_lossy(&out.stderr).into_owned();
        assert!(
            text.contains(expected) && text.trim_end().lines().filter(|line| line.starts_with("ERROR")).count() <= 1,
            "{text}"
        );
        assert_eq!(out.status.code(), Some(code), "{text}");
        assert!(!at.join("dtm.tif").exists() && !at.join("dtm.tif.part").exists(), "{text}");
    }
    let alone = [&["predict"], &INPUTS[..], &["-o", "dtm.tif", "--tracks", "good.csv"]].concat();
    let text = String::from_utf8_lossy(&elunar(at, &alone).stderr).into_owned();
    assert!(text.contains("--uncertainty"), "{text}");
    // A table is an input: it is never written over.
    let over =
        [&["predict"], &INPUTS[..], &["-o", "dtm.tif", "--uncertainty", "good.tif", "--tracks", "good.tif"]].concat();
    std::fs::copy(at.join("good.csv"), at.join("good.tif")).unwrap();
    let text = String::from_utf8_lossy(&elunar(at, &over).stderr).into_owned();
    assert!(text.contains("must not overwrite an input"), "{text}");
}
