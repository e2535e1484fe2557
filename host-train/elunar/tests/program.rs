//! The program as users run it, on files, without a training framework.

mod common;

use common::{elunar, made};
use elunar_core::sun::{Body, sub_solar};
use elunar_raster::geotiff::{WriteOptions, read, read_item, write};
use elunar_raster::sun::StatedSun;
use std::path::{Path, PathBuf};

const MODELS: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../models");

/// Returns the one-line error of a command that must fail.
fn refused(folder: &Path, words: &[&str]) -> String {
    let out = elunar(folder, words);
    let text = String::from_utf8_lossy(&out.stderr).into_owned();
    // Options that cannot be met, or a bad input.
    assert!(matches!(out.status.code(), Some(64 | 65)), "{words:?}: {:?} {text}", out.status);
    assert_eq!(text.lines().count(), 1, "{text}");
    text
}

fn model(name: &str) -> String {
    PathBuf::from(MODELS).join(name).display().to_string()
}

#[test]
fn an_image_and_a_coarse_dtm_become_a_dtm_with_smaller_slope_errors() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    let [image, coarse, truth] = ["image", "coarse", "truth"].map(|kind| format!("s/scene_0000_{kind}.tif"));
    let nano = model("nano.eld");
    let predict = ["predict", "--image", &image, "--coarse", &coarse, "--model", &nano, "-o", "dtm.tif"];
    let text = made(at, &predict);
    assert!(text.contains("256 x 320 pixels") && text.contains("given (azimuth and elevation from the image's label)"));
    assert!(at.join("dtm_hillshade.png").exists() && !at.join("dtm.tif.part").exists());
    let text = made(at, &["evaluate", "--dtm", "dtm.tif", "--truth", &truth, "--coarse", &coarse, "--json"]);
    let scores: serde_json::Value = serde_json::from_str(&text).unwrap();
    let slope = |candidate: usize| scores["candidates"][candidate]["slope_mae_deg"].as_f64().unwrap();
    assert!(slope(0) < 0.8 * slope(1), "{text}");
    assert!(made(at, &["inspect", &nano]).starts_with(&nano));
}

/// A coarse DTM that covers a part is told in text and JSON. The options of a DTM are words.
#[test]
fn what_a_dtm_lacks_and_was_made_with_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    let mut coarse = read(at.join("s/scene_0000_coarse.tif")).unwrap();
    let cols = coarse.cols;
    coarse.samples.iter_mut().enumerate().filter(|(i, _)| i % cols > cols / 2).for_each(|(_, z)| *z = f32::NAN);
    write(&at.join("half.tif"), &coarse, &WriteOptions::heights("half")).unwrap();
    let nano = model("nano.eld");
    let files = ["--image", "s/scene_0000_image.tif", "--coarse", "half.tif", "--model", &nano, "-o", "dtm.tif"];
    let more = ["--json", "--image-nodata=-5", "--coarse-srs", "IAU_2015:30110", "--image-srs", "IAU_2015:30110"];
    let out = elunar(at, &[&["predict"], &files[..], &more].concat());
    let (text, said) = (String::from_utf8(out.stdout).unwrap(), String::from_utf8(out.stderr).unwrap());
    let found: serde_json::Value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {said}"));
    let share = found["coarse_covers"].as_f64().unwrap();
    assert!((0.4..0.65).contains(&share), "{share}");
    let warning = format!("half.tif: covers {:.1} % of the valid pixels of s/scene_0000_image.tif", 100.0 * share);
    assert!(said.contains(&format!("WARNING: {warning}")), "{said}");
    assert!(
        found["warnings"].as_array().unwrap().iter().any(|one| one.as_str().unwrap().starts_with(&warning)),
        "{text}"
    );
    let options = read_item(&at.join("dtm.tif"), "OPTIONS").unwrap().unwrap();
    let is_word = |word: &str| word.split_once('=').is_some_and(|(name, value)| !name.is_empty() && !value.is_empty());
    assert!(options.split(' ').all(is_word) && options.ends_with(" image_nodata=-5"), "{options}");
    assert!(options.starts_with("overlap_px=100 blend=dem-mosaic anchor=yes sun_azimuth_deg="), "{options}");
    assert!(options.contains(" expected_errors=no image_srs=equirectangular,lat_0_deg,lon_0_deg,"), "{options}");
    let software = read_item(&at.join("dtm.tif"), "SOFTWARE").unwrap().unwrap();
    assert!(software.starts_with("ELunarDTM "), "{software}");
    for item in ["OPTIONS", "MODEL", "LIGHT", "IMAGE", "COARSE_DTM", "SOFTWARE", "VERTICAL_REFERENCE"] {
        let text = read_item(&at.join("dtm.tif"), item).unwrap().unwrap();
        assert!(!["Some(", "None", "{", "::", "\""].iter().any(|form| text.contains(form)), "{item}: {text}");
    }
}

#[test]
fn scores_are_stated_at_the_pixel_and_at_the_truths_resolution() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    let files = ["evaluate", "--dtm", "s/scene_0000_coarse.tif", "--truth", "s/scene_0000_truth.tif"];
    let told = [&files[..], &["--truth-resolution-m", "40"]].concat();
    let of = |words: &[&str]| -> serde_json::Value {
        let text = made(at, &[words, &["--json"]].concat());
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["candidates"][0].clone()
    };
    let (alone, both) = (of(&files), of(&told));
    let slopes = |scores: &serde_json::Value| scores["slope_mae_deg"].as_f64().unwrap();
    assert_eq!((&alone["at_resolution"], &alone["at_pixel"]), (&serde_json::Value::Null, &both["at_pixel"]));
    assert_eq!((slopes(&alone), slopes(&both)), (slopes(&alone["at_pixel"]), slopes(&both["at_resolution"])));
    assert!(slopes(&both["at_resolution"]) < 0.9 * slopes(&both["at_pixel"]), "{both}");
    let text = made(at, &told);
    let line = text.lines().find(|line| line.starts_with("slope MAE")).unwrap();
    for at in ["at_pixel", "at_resolution"] {
        assert!(line.contains(&format!("{:.3}", slopes(&both[at]))), "{line}");
    }
    assert!(text.contains("at the pixel") && text.contains("at 40.0 m"), "{text}");
    assert!(made(at, &files).contains("with --truth-resolution-m also at what the truth resolves"));
    for wrong in ["1e300", "0", "-1", "NaN", "inf", "1e-300"] {
        let text = refused(at, &[&files[..], &["--truth-resolution-m", wrong]].concat());
        assert!(text.contains("resolution of the truth: metres from 0.001 to "), "{wrong}: {text}");
    }
}

#[test]
fn float_weights_are_exported_but_not_run() {
    let folder = tempfile::tempdir().unwrap();
    let nano = model("nano.safetensors");
    let text = refused(folder.path(), &["predict", "--image", "i", "--coarse", "c", "--model", &nano, "-o", "d.tif"]);
    assert!(text.contains("expected a model (.eld)") && text.contains("host-train"), "{text}");
    let text =
        refused(folder.path(), &["predict", "--image", "i", "--coarse", "c", "--model", "x.onnx", "-o", "d.tif"]);
    assert!(text.contains("x.onnx") && text.contains(".eld"), "{text}");
}

#[test]
fn without_a_command_it_says_what_there_is() {
    let out = elunar(Path::new("."), &[]);
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.code() == Some(64) && text.contains("predict") && text.contains("evaluate"), "{text}");
    assert!(!text.contains("train a network"), "{text}");
}

#[test]
fn a_sun_out_of_range_is_one_error_before_any_file_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let nano = model("nano.eld");
    let predict = ["predict", "--image", "i", "--coarse", "c", "--model", &nano, "-o", "d.tif"];
    let sfs = ["sfs", "--image", "i", "--coarse", "c", "-o", "d.tif"];
    for angle in ["90", "0", "-3", "NaN", "inf", "-inf"] {
        let elevation = format!("--sun-elevation={angle}");
        for words in [[&predict[..], &[&elevation]].concat(), [&sfs[..], &["--sun-azimuth", "10", &elevation]].concat()]
        {
            let text = refused(folder.path(), &words);
            assert_eq!(
                text.trim_end(),
                format!("ERROR: --sun-elevation: a number above 0 and below 90 degrees expected, found {angle}")
            );
        }
    }
    for angle in ["400", "NaN", "inf"] {
        let azimuth = format!("--sun-azimuth={angle}");
        for words in [[&predict[..], &[&azimuth]].concat(), [&sfs[..], &["--sun-elevation", "30", &azimuth]].concat()] {
            let text = refused(folder.path(), &words);
            assert!(text.contains("--sun-azimuth: a number from -360 to 360 degrees expected"), "{text}");
        }
    }
}

/// Writes a scene of 256 x 320 pixels into `s`, and returns its Sun's azimuth and the words of `predict` with more words behind them.
fn bench(folder: &Path) -> (f64, impl Fn(&[&str]) -> Vec<String> + use<>) {
    made(folder, &["synth", "--out", "s", "--rows", "256", "--cols", "320", "--seed", "5"]);
    let manifest = std::fs::read(folder.join("s/manifest.json")).unwrap();
    let manifest: serde_json::Value = serde_json::from_slice(&manifest).unwrap();
    let azimuth_deg = manifest["scenes"][0]["sun_azimuth_deg"].as_f64().unwrap();
    let predict = |more: &[&str]| {
        let (image, coarse, nano) = ("s/scene_0000_image.tif", "s/scene_0000_coarse.tif", model("nano.eld"));
        let words = ["predict", "--image", image, "--coarse", coarse, "--model", &nano, "-o", "dtm.tif"];
        // The last of two equal options counts nowhere, so one that is given again is left out before.
        let mut words: Vec<String> = words.iter().map(|word| (*word).to_string()).collect();
        for word in more.iter().filter(|word| word.starts_with("--")) {
            if let Some(at) = words.iter().position(|known| known == word) {
                words.drain(at..at + 2);
            }
        }
        words.extend(more.iter().map(|word| (*word).to_string()));
        words
    };
    (azimuth_deg, predict)
}

fn words(words: &[String]) -> Vec<&str> {
    words.iter().map(String::as_str).collect()
}

/// Returns the JSON on stdout and the text on stderr.
fn json(folder: &Path, predict: &[String]) -> (serde_json::Value, String) {
    let out = elunar(folder, &words(predict));
    let text = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.success(), "{predict:?}: {text}");
    (serde_json::from_slice(&out.stdout).unwrap_or_else(|e| panic!("{e}: {:?}", out.stdout)), text)
}

#[test]
fn json_says_what_was_taken_and_found() {
    let folder = tempfile::tempdir().unwrap();
    let (azimuth_deg, predict) = bench(folder.path());
    let (found, text) = json(folder.path(), &predict(&["--json"]));
    assert_eq!((&found["rows"], &found["cols"], &found["tiles"]["all"]), (&256.into(), &320.into(), &1.into()));
    assert_eq!((&found["pixels_valid"], &found["pixels_void"]), (&(256 * 320).into(), &0.into()));
    assert_eq!((&found["image"], &found["output"]), (&"s/scene_0000_image.tif".into(), &"dtm.tif".into()));
    assert!(found["model"].as_str().unwrap().contains("sha256:"), "{found}");
    assert_eq!((&found["light"]["source"], &found["light"]["azimuth_from_file"]), (&"given".into(), &true.into()));
    assert!((found["light"]["azimuth_deg"].as_f64().unwrap() - azimuth_deg).abs() < 0.01, "{found}");
    let (share, seconds) = (found["share_of_relief"].as_f64().unwrap(), found["seconds"].as_f64().unwrap());
    assert!((0.1..=1.0).contains(&share) && seconds > 0.0, "{found}");
    let phases = ["survey_s", "tiles_s", "write_s"].map(|name| found["phases"][name].as_f64().unwrap());
    assert!(phases.iter().all(|&s| s > 0.0) && phases.iter().sum::<f64>() < seconds, "{found}");
    assert_eq!(found["warnings"], serde_json::json!([]));
    assert!(text.contains("dtm.tif: 256 x 320 pixels") && text.contains("light: azimuth"), "{text}");
    let dtm = read(folder.path().join("dtm.tif")).unwrap();
    let (low, high) = dtm.range().unwrap();
    assert_eq!(found["lowest_m"].as_f64().unwrap() as f32, low);
    assert_eq!(found["highest_m"].as_f64().unwrap() as f32, high);
    // The Sun in the file is not used if the user says so, and it is doubted if it contradicts the scene.
    let (fitted, _) = json(folder.path(), &predict(&["--json", "--fit-sun"]));
    assert_eq!((&fitted["light"]["source"], &fitted["light"]["azimuth_from_file"]), (&"fitted".into(), &false.into()));
    let wrong = format!("{:.1}", (azimuth_deg + 180.0) % 360.0);
    let (doubted, text) = json(folder.path(), &predict(&["--json", "--sun-azimuth", &wrong]));
    let warning = doubted["warnings"][0].as_str().unwrap_or_else(|| panic!("{doubted}"));
    assert!(warning.starts_with("--sun-azimuth is") && text.contains(&format!("WARNING: {warning}")), "{text}");
}

#[test]
fn a_nodata_value_is_asked_for_and_makes_voids() {
    let folder = tempfile::tempdir().unwrap();
    let (_, predict) = bench(folder.path());
    let at = |name: &str| folder.path().join(name);
    let mut coarse = read(at("s/scene_0000_coarse.tif")).unwrap();
    let (rows, cols) = (coarse.rows, coarse.cols);
    for (row, col) in (0..4).flat_map(|row| (0..3).map(move |col| (row, col))) {
        coarse.samples[(rows / 2 + row) * cols + cols / 2 + col] = -9999.0;
    }
    write(&at("c.tif"), &coarse, &WriteOptions::heights("with voids that no tag names")).unwrap();
    let (found, text) = json(folder.path(), &predict(&["--json", "--coarse", "c.tif"]));
    assert!(text.contains("exactly -9999") && text.contains("say --coarse-nodata -9999"), "{text}");
    assert_eq!(found["pixels_void"], 0);
    let (found, text) = json(folder.path(), &predict(&["--json", "--coarse", "c.tif", "--coarse-nodata", "-9999"]));
    // Beside voids there is no height.
    let warnings: Vec<&str> = text.lines().filter(|line| line.contains("WARNING")).collect();
    assert!(warnings.len() == 1 && warnings[0].contains("c.tif: covers 78.5 % of the valid pixels"), "{text}");
    let void = found["pixels_void"].as_u64().unwrap();
    let dtm = read(at("dtm.tif")).unwrap();
    assert!(void > 1000 && void as usize == 256 * 320 - dtm.valid_count(), "{found}");
    assert!(dtm.range().unwrap().0 > -9900.0);

    let image = read(at("s/scene_0000_image.tif")).unwrap();
    let value = image.samples[1234].to_string();
    let same = image.samples.iter().filter(|v| **v == image.samples[1234]).count();
    let (found, _) = json(folder.path(), &predict(&["--json", "--image-nodata", &value]));
    assert_eq!(found["pixels_void"], same);
    let sfs = ["sfs", "--image", "s/scene_0000_image.tif", "--coarse", "s/scene_0000_coarse.tif", "-o", "sfs.tif"];
    let text = made(folder.path(), &[&sfs[..], &["--image-nodata", &value]].concat());
    assert!(text.contains("256 x 320"), "{text}");
    assert_eq!(read(at("sfs.tif")).unwrap().valid_count(), 256 * 320 - same);
}

#[test]
fn exchanged_files_and_a_missing_sun_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (_, predict) = bench(folder.path());
    let (image, coarse) = ("s/scene_0000_image.tif", "s/scene_0000_coarse.tif");
    let refuse = |more: &[&str]| refused(folder.path(), &words(&predict(more)));
    let text = refuse(&["--coarse", image]);
    assert!(text.contains("found one file for both"), "{text}");
    std::fs::copy(folder.path().join(image), folder.path().join("i.tif")).unwrap();
    let text = refuse(&["--coarse", "i.tif"]);
    assert!(text.contains("i.tif: heights coarser than") && text.contains("GeoTIFF, u16"), "{text}");
    let text = refuse(&["--image", coarse, "--coarse", image]);
    assert!(text.contains("exchanged?"), "{text}");
    let bare = read(folder.path().join(image)).unwrap();
    write(&folder.path().join("bare.tif"), &bare, &WriteOptions::heights("without a Sun")).unwrap();
    let text = refused(folder.path(), &["sfs", "--image", "bare.tif", "--coarse", coarse, "-o", "x.tif"]);
    assert!(text.contains("--sun-azimuth expected, and bare.tif states none"), "{text}");
    assert!(!folder.path().join("dtm.tif").exists() && !folder.path().join("x.tif").exists());
}

#[test]
fn a_mosaic_of_heights_that_the_moon_does_not_have_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "40", "--cols", "50"]);
    let mut truth = read(at.join("s/scene_0000_truth.tif")).unwrap();
    let warned = |words: &[&str]| String::from_utf8(elunar(at, words).stderr).unwrap();
    assert_eq!(warned(&["mosaic", "s/scene_0000_truth.tif", "-o", "m.tif"]), "");
    truth.samples.iter_mut().for_each(|z| *z += 18_000.0);
    write(&at.join("high.tif"), &truth, &WriteOptions::heights("high")).unwrap();
    let text = warned(&["mosaic", "high.tif", "-o", "m.tif"]);
    assert!(text.starts_with("WARNING: m.tif: heights from 1") && text.lines().count() == 1, "{text}");
    assert!(text.contains("but the Moon's are between -9,200 and 10,800 m"), "{text}");
}

#[test]
fn addresses_are_refused_with_the_line_that_fetches_them() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "40", "--cols", "50"]);
    let (image, coarse, truth) = ("s/scene_0000_image.tif", "s/scene_0000_coarse.tif", "s/scene_0000_truth.tif");
    let (tif, csv, list) = ("https://host/a/b.tif?x=1", "http://host/t.csv", "ftp://host/m.jsonl");
    // A raster on the net is read by HTTP alone, and by commands that need no hash of its bytes.
    let ftp = "ftp://host/a/b.tif";
    let one = |image: &str| {
        let item = serde_json::json!({"id": "a", "image": image, "coarse": coarse, "model": "nano", "output": "o.tif"});
        std::fs::write(at.join("m.jsonl"), format!("{item}\n")).unwrap();
    };
    one(tif);
    let manifest = ["--model", "nano", "-o", "n.jsonl"];
    let with = |words: &[&'static str]| [words, &manifest].concat();
    let commands = [
        (ftp, vec!["predict", "--image", ftp, "--coarse", coarse, "--model", "nano", "-o", "o.tif"]),
        (ftp, vec!["predict", "--image", image, "--coarse", ftp, "--model", "nano", "-o", "o.tif"]),
        (tif, with(&["manifest", tif, "--coarse", coarse])),
        (tif, with(&["manifest", image, "--coarse", tif])),
        (csv, with(&["manifest", "--table", csv])),
        (list, vec!["manifest", "--check", list]),
        (list, vec!["batch", "--manifest", list]),
        (tif, vec!["batch", "--manifest", "m.jsonl"]),
        (ftp, vec!["lola", "--dtm", ftp, "--tracks", "t.csv"]),
        (csv, vec!["lola", "--dtm", truth, "--tracks", csv]),
    ];
    for (address, words) in commands {
        let text = refused(at, &words);
        let line = if [tif, ftp].contains(&address) {
            format!("gdal_translate /vsicurl/{address} b.tif")
        } else {
            format!("curl -L -o {} {address}", address.rsplit('/').next().unwrap())
        };
        let what = "a file on this machine expected, found an address; this fetches it";
        assert!(text.ends_with(&format!("{address}: {what}: {line}\n")), "{words:?}: {text}");
    }
}

/// What `predict` would say about the heights of an item, `manifest` says before.
#[test]
fn the_coarse_dtm_of_an_item_is_read_as_heights() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    made(at, &["synth", "--out", "s", "--rows", "40", "--cols", "50"]);
    let coarse = read(at.join("s/scene_0000_coarse.tif")).unwrap();
    let mut options = WriteOptions::heights("heights");
    options.unit = Some("degree".into());
    write(&at.join("c.tif"), &coarse, &options).unwrap();
    let words = ["manifest", "s/scene_0000_image.tif", "--coarse", "c.tif", "--model", "nano", "-o", "m.jsonl"];
    let text = refused(at, &words);
    assert!(text.starts_with("ERROR: c.tif: heights in m, km") && text.contains("found \"degree\""), "{text}");
    let stated = [&words[..], &["--option", "coarse_unit=km"]].concat();
    assert!(made(at, &stated).contains("1 items"), "the user knows better");
}

#[test]
fn the_sun_follows_from_the_time_of_the_image() {
    let folder = tempfile::tempdir().unwrap();
    let (_, predict) = bench(folder.path());
    let image = elunar_raster::source::open(&folder.path().join("s/scene_0000_image.tif")).unwrap();
    let sun = |day: &u32| {
        let text = format!("2009-08-{day:02}T00:00:00");
        let found = StatedSun::at_time(image.info(), text.parse().unwrap()).unwrap();
        (text, found.azimuth_deg.unwrap(), found.elevation_deg.unwrap())
    };
    let (time, azimuth_deg, elevation_deg) = (1..=31).map(|day| sun(&day)).find(|sun| sun.2 > 20.0).unwrap();
    // The time that the user tells comes before the angles of the file.
    let (found, text) = json(folder.path(), &predict(&["--json", "--time", &time]));
    let light = &found["light"];
    assert_eq!(
        [&light["azimuth_from_time"], &light["elevation_from_time"], &light["azimuth_from_file"]],
        [true, true, false]
    );
    assert!((light["azimuth_deg"].as_f64().unwrap() - azimuth_deg).abs() < 0.01, "{found}");
    assert!(text.contains("(azimuth and elevation from the image's time)"), "{text}");
    // At night the file's angles count.
    let night = (1..=31).map(|day| sun(&day)).find(|sun| sun.2 < -5.0).unwrap().0;
    let (found, text) = json(folder.path(), &predict(&["--json", "--time", &night]));
    assert_eq!([&found["light"]["azimuth_from_time"], &found["light"]["elevation_from_file"]], [true, true]);
    assert!(text.contains("the Sun's elevation at its time is not used"), "{text}");
    // `sun` says the same.
    let out = elunar(folder.path(), &["sun", &time, "--json"]);
    let said: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let point = sub_solar(Body::Moon, time.parse().unwrap());
    assert_eq!(said["sub_solar"]["lat_deg"].as_f64(), Some(point.lat_deg));
    let refused = elunar(folder.path(), &["sun", "yesterday"]);
    assert!(String::from_utf8_lossy(&refused.stderr).contains("a moment in UTC"), "{refused:?}");
    assert!(elevation_deg < 90.0);
}

/// LLVM reserves 32 KiB of stack and more in a loop that overwrites the register r11. It puts that loop behind the first instructions of a function
/// if these need no stack, even where r11 holds an argument (with `-C force-frame-pointers=yes` the fit of the light read a wrong length).
#[test]
fn no_function_reserves_its_stack_in_a_loop() {
    if cfg!(not(target_arch = "x86_64")) {
        elunar_testing::skipped("reserved stack", "instructions of x86-64");
        return;
    }
    // mov r11, rsp; sub r11, SIZE; then the loop: sub rsp, 4096; mov [rsp], 0; cmp rsp, r11.
    const BEGIN: [u8; 6] = [0x49, 0x89, 0xe3, 0x49, 0x81, 0xeb];
    const LOOP: [u8; 18] =
        [0x48, 0x81, 0xec, 0x00, 0x10, 0x00, 0x00, 0x48, 0xc7, 0x04, 0x24, 0x00, 0x00, 0x00, 0x00, 0x4c, 0x39, 0xdc];
    let is_loop = |code: &&[u8]| code.starts_with(&BEGIN) && code[BEGIN.len() + 4..].starts_with(&LOOP);
    let program = std::fs::read(env!("CARGO_BIN_EXE_elunar")).unwrap();
    let found = program.windows(BEGIN.len() + 4 + LOOP.len()).filter(is_loop).count();
    assert_eq!(found, 0, "functions with 32 KiB of stack or more: make their arrays smaller");
}
