//! The commands as users run them: on files, with a one-line error for every mistake.

use elunar_core::sun::Body;
use elunar_learn::model::init::initial_weights;
use elunar_net::config::{NetConfig, Preset};
use elunar_raster::geotiff::{SampleType, WriteOptions, read, write};
use elunar_raster::{Crs, Raster};
use std::path::Path;
use support::Shell;

mod support;

fn terrain(rows: usize, cols: usize, origin: (f64, f64), pixel_m: f64) -> Raster {
    let height = |x: f64, y: f64| -1500.0 + 30.0 * (x / 200.0).sin() + 20.0 * (y / 150.0).cos();
    support::raster((rows, cols), origin, pixel_m, Crs::polar(Body::Moon.radius_m(), true), height)
}

/// Returns a folder with an image, a coarse DTM on its own grid, the truth, and an untrained network.
fn bench() -> Shell {
    let bench = Shell::new();
    let truth = terrain(300, 340, (1000.0, 5000.0), 2.0);
    let mut image = truth.clone();
    image.samples.iter_mut().enumerate().for_each(|(i, v)| *v = 100.0 + ((i * 7919) % 101) as f32);
    image.samples[..40].fill(f32::NAN);
    write(&bench.path("image.tif"), &image, &WriteOptions::image(SampleType::U16, "image")).unwrap();
    write(&bench.path("truth.tif"), &truth, &WriteOptions::heights("truth")).unwrap();
    let coarse = terrain(14, 16, (900.0, 5100.0), 60.0);
    write(&bench.path("coarse.tif"), &coarse, &WriteOptions::heights("coarse")).unwrap();
    initial_weights(&NetConfig::preset(Preset::Nano), 1).write(&bench.path("net.safetensors")).unwrap();
    bench
}

fn predict<'a>(image: &'a str, coarse: &'a str, model: &'a str, output: &'a str) -> Vec<&'a str> {
    vec!["predict", "--image", image, "--coarse", coarse, "--model", model, "-o", output]
}

fn rewrite(from: &Path, to: &Path, change: impl FnOnce(&mut Raster)) {
    let mut raster = read(from).unwrap();
    change(&mut raster);
    write(to, &raster, &WriteOptions::heights("changed")).unwrap();
}

#[test]
fn an_image_and_a_coarse_dtm_become_a_dtm() {
    let bench = bench();
    for (name, threads) in [("one.tif", "1"), ("two.tif", "2")] {
        let mut arguments = predict("image.tif", "coarse.tif", "net.safetensors", name);
        arguments.extend(["--threads", threads]);
        let out = bench.run(&arguments);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        assert!(String::from_utf8_lossy(&out.stdout).contains("300 x 340 pixels"));
    }
    // The file says under which light it was made: this network takes none.
    let text = std::fs::read(bench.path("one.tif")).unwrap();
    let light = b"not used by the network";
    assert!(text.windows(light.len()).any(|bytes| bytes == light));
    let (one, two) = (read(bench.path("one.tif")).unwrap(), read(bench.path("two.tif")).unwrap());
    let image = read(bench.path("image.tif")).unwrap();
    assert_eq!(one.georef, image.georef, "the image's place and reference system");
    for ((a, b), image) in one.samples.iter().zip(&two.samples).zip(&image.samples) {
        assert_eq!(a.to_bits(), b.to_bits(), "threads change nothing");
        assert_eq!(a.is_finite(), image.is_finite(), "heights where the image is");
    }
    let shade = image::open(bench.path("one_hillshade.png")).unwrap();
    assert_eq!((shade.height(), shade.width()), (300, 340));

    let out = bench.run(&[
        "evaluate",
        "--dtm",
        "one.tif",
        "--truth",
        "truth.tif",
        "--coarse",
        "coarse.tif",
        "--error-map",
        "e.png",
        "--spectra",
        "s.png",
        "--json",
    ]);
    let found: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(found["common_pixels"], 300 * 340 - 40);
    assert!(found["candidates"][1]["rmse_m"].as_f64().unwrap() < 0.1, "bicubic follows smooth terrain: {found}");
    assert!(bench.path("e.png").exists() && bench.path("s.png").exists());
    let offset = &found["candidates"][1]["registration"];
    assert!(offset["down_px"].as_f64().unwrap().abs() < 0.1 && offset["right_m"].is_f64(), "{found}");
    let out = bench.run(&["evaluate", "--dtm", "one.tif", "--truth", "truth.tif"]);
    assert!(String::from_utf8_lossy(&out.stdout).contains("RMSE [m]"));
}

#[test]
fn kilometres_are_suspected_and_can_be_stated() {
    let bench = bench();
    let mut coarse = read(bench.path("coarse.tif")).unwrap();
    coarse.samples.iter_mut().for_each(|z| *z /= 1000.0);
    let mut unitless = WriteOptions::heights("coarse");
    unitless.unit = None;
    write(&bench.path("km.tif"), &coarse, &unitless).unwrap();
    let run = |coarse, output, unit: &[&str]| {
        let arguments = [predict("image.tif", coarse, "net.safetensors", output), unit.to_vec()].concat();
        let out = bench.run(&arguments);
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8(out.stderr).unwrap()
    };
    assert_eq!(run("coarse.tif", "m.tif", &[]), "");
    assert!(run("km.tif", "wrong.tif", &[]).contains("WARNING: km.tif"));
    assert_eq!(run("km.tif", "wrong.tif", &["--coarse-unit", "m"]), "");
    assert_eq!(run("km.tif", "right.tif", &["--coarse-unit", "km"]), "");
    let contradiction = [predict("image.tif", "coarse.tif", "net.safetensors", "no.tif"), vec!["--coarse-unit", "km"]];
    assert!(bench.refused(&contradiction.concat()).contains("coarse.tif: expected a file without a unit"));
    let (right, metres) = (read(bench.path("right.tif")).unwrap(), read(bench.path("m.tif")).unwrap());
    let far = right.samples.iter().zip(&metres.samples).filter(|(a, b)| (*a - *b).abs() > 0.1).count();
    assert_eq!(far, 0, "as with metres, but for rounding");
}

#[test]
fn a_killed_prediction_goes_on_where_it_was() {
    let bench = bench();
    let whole = bench.run(&predict("image.tif", "coarse.tif", "net.safetensors", "whole.tif"));
    assert!(whole.status.success());
    let arguments = predict("image.tif", "coarse.tif", "net.safetensors", "killed.tif");
    let mut child = bench.command(&arguments).args(["--threads", "1"]).spawn().unwrap();
    // The first rows are on disk when the file is longer than its header. The second row of tiles is not done then.
    let part = bench.path("killed.tif.part");
    while std::fs::metadata(&part).map_or(0, |found| found.len()) <= 48 {
        assert!(child.try_wait().unwrap().is_none(), "ended before it could be killed");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(part.exists() && !bench.path("killed.tif").exists());
    let again = bench.run(&arguments);
    assert!(again.status.success());
    assert!(String::from_utf8_lossy(&again.stderr).contains("going on after row"));
    let (a, b) = (read(bench.path("whole.tif")).unwrap(), read(bench.path("killed.tif")).unwrap());
    assert!(a.samples.iter().zip(&b.samples).all(|(a, b)| a.to_bits() == b.to_bits()), "bit for bit");
    assert!(!part.exists());
}

#[test]
fn every_mistake_is_one_line_and_leaves_nothing_behind() {
    let bench = bench();
    let source = bench.path("coarse.tif");
    rewrite(&source, &bench.path("elsewhere.tif"), |r| r.georef.as_mut().unwrap().transform[0] += 1e6);
    rewrite(&source, &bench.path("projection.tif"), |r| {
        r.georef.as_mut().unwrap().crs = Crs::polar(Body::Moon.radius_m(), false)
    });
    let mars = Crs::parse("IAU_2015:49935").unwrap();
    rewrite(&source, &bench.path("mars.tif"), |r| r.georef.as_mut().unwrap().crs = mars.clone());
    rewrite(&source, &bench.path("nowhere.tif"), |r| r.georef = None);
    rewrite(&source, &bench.path("unnamed.tif"), |r| r.georef.as_mut().unwrap().crs = Crs::default());
    rewrite(&source, &bench.path("empty.tif"), |r| r.samples.fill(f32::NAN));
    let bytes = std::fs::read(&source).unwrap();
    std::fs::write(bench.path("cut.tif"), &bytes[..bytes.len() / 2]).unwrap();
    let weights = std::fs::read(bench.path("net.safetensors")).unwrap();
    std::fs::write(bench.path("cut.safetensors"), &weights[..weights.len() / 2]).unwrap();
    let before = bench.files();
    let net = "net.safetensors";
    let cases = [
        (predict("image.tif", "elsewhere.tif", net, "x.tif"), ["elsewhere.tif", "overlapping"]),
        (predict("image.tif", "projection.tif", net, "x.tif"), ["projection.tif", "latitudes 89."]),
        (predict("image.tif", "mars.tif", net, "x.tif"), ["mars.tif", "sphere"]),
        (predict("image.tif", "nowhere.tif", net, "x.tif"), ["nowhere.tif", "geotransform"]),
        (predict("image.tif", "unnamed.tif", net, "x.tif"), ["unnamed.tif", "reference system"]),
        (predict("image.tif", "empty.tif", net, "x.tif"), ["empty.tif", "valid heights"]),
        (predict("empty.tif", "coarse.tif", net, "x.tif"), ["coarse.tif", "valid pixels of empty.tif"]),
        (predict("image.tif", "cut.tif", net, "x.tif"), ["cut.tif", "broken"]),
        (predict("image.tif", "missing.tif", net, "x.tif"), ["missing.tif", "No such file"]),
        (predict("image.tif", "coarse.tif", "cut.safetensors", "x.tif"), ["cut.safetensors", "broken"]),
        (predict("image.tif", "coarse.tif", "image.tif", "x.tif"), ["image.tif", ".safetensors"]),
        (predict("image.tif", "coarse.tif", net, "no/x.tif"), ["no/x.tif", "none found"]),
        (predict("image.tif", "coarse.tif", net, "coarse.tif"), ["coarse.tif", "overwrite"]),
        (vec!["evaluate", "--dtm", "projection.tif", "--truth", "truth.tif"], ["projection.tif", "overlapping"]),
        (vec!["evaluate", "--dtm", "mars.tif", "--truth", "truth.tif"], ["mars.tif", "3396190"]),
        (vec!["evaluate", "--dtm", "elsewhere.tif", "--truth", "truth.tif"], ["elsewhere.tif", "overlapping"]),
        (
            vec!["evaluate", "--dtm", "truth.tif", "--truth", "truth.tif", "--uncertainty", "coarse.tif"],
            ["coarse.tif", "the grid of truth.tif expected"],
        ),
        (vec!["evaluate", "--dtm", "cut.tif", "--truth", "truth.tif", "--error-map", "e.png"], ["cut.tif", "broken"]),
    ];
    for (arguments, expected) in cases {
        let text = bench.refused(&arguments);
        assert!(expected.iter().all(|part| text.contains(part)), "{arguments:?}: {text}");
    }
    assert_eq!(bench.files(), before, "nothing was left behind");
}
