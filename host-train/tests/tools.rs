//! `hillshade`, `diff`, `mosaic` and `prepare` as users run them: on files, with a one-line error for every mistake.

use elunar_core::sun::Body;
use elunar_raster::geotiff::{SampleType, WriteOptions, read, write};
use elunar_raster::{Crs, Raster};
use std::path::Path;
use std::process::Stdio;
use support::Shell;

mod support;

fn terrain(rows: usize, cols: usize, origin: (f64, f64), pixel_m: f64, offset_m: f64) -> Raster {
    let height = |x: f64, y: f64| offset_m - 1500.0 + 30.0 * (x / 40.0).sin() + 20.0 * (y / 30.0).cos();
    support::raster((rows, cols), origin, pixel_m, Crs::polar(Body::Moon.radius_m(), true), height)
}

/// Returns a folder with two overlapping DTMs, `left.tif` and `right.tif`, 3 m apart in height.
fn bench() -> Shell {
    let bench = Shell::new();
    let mut left = terrain(60, 80, (1000.0, 5000.0), 2.0, 0.0);
    left.samples[30 * 80 + 20] = f32::NAN;
    write(&bench.path("left.tif"), &left, &WriteOptions::heights("left")).unwrap();
    let right = terrain(60, 80, (1080.0, 4980.0), 2.0, 3.0);
    write(&bench.path("right.tif"), &right, &WriteOptions::heights("right")).unwrap();
    bench
}

fn same(a: &Path, b: &Path) -> bool {
    let (a, b) = (read(a).unwrap(), read(b).unwrap());
    a.samples.iter().zip(&b.samples).all(|(a, b)| a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan()))
}

#[test]
fn hillshades_follow_their_options() {
    let bench = bench();
    bench.made(&["hillshade", "left.tif", "-o", "shade.tif"]);
    let shade = read(bench.path("shade.tif")).unwrap();
    assert_eq!(shade.georef, read(bench.path("left.tif")).unwrap().georef);
    assert_eq!(shade.valid_count(), 58 * 78 - 9, "the edge and the surroundings of the gap have no shade");
    let asp = ["--sun-azimuth", "300", "--sun-elevation", "20"];
    bench.made(&[&["hillshade", "left.tif", "-o", "asp.tif"][..], &asp].concat());
    let gdal = ["--azimuth", "300", "--altitude", "20"];
    bench.made(&[&["hillshade", "left.tif", "-o", "gdal.tif"][..], &gdal].concat());
    assert!(same(&bench.path("asp.tif"), &bench.path("gdal.tif")), "both names of an option are one");
    for (name, options) in
        [("z.tif", &["--z-factor", "3"][..]), ("alt.tif", &["--altitude", "80"]), ("az.tif", &["--azimuth", "-45.5"])]
    {
        bench.made(&[&["hillshade", "left.tif", "-o", name][..], options].concat());
        assert!(!same(&bench.path(name), &bench.path("shade.tif")), "{options:?}");
    }
    bench.made(&["hillshade", "left.tif", "-o", "edges.tif", "--compute-edges"]);
    assert_eq!(read(bench.path("edges.tif")).unwrap().valid_count(), 60 * 80 - 1);
    bench.made(&["hillshade", "left.tif", "-o", "shade.png"]);
    let picture = image::open(bench.path("shade.png")).unwrap().into_luma8();
    for (pixel, value) in picture.pixels().zip(&shade.samples) {
        assert_eq!(f32::from(pixel.0[0]), if value.is_finite() { *value } else { 0.0 });
    }
}

#[test]
fn differences_follow_their_options() {
    let bench = bench();
    let text = bench.made(&["diff", "left.tif", "right.tif", "-o", "d.tif", "--picture", "d.png"]);
    assert!(text.contains("left.tif - right.tif") && text.contains("NMAD [m]"), "{text}");
    let made = read(bench.path("d.tif")).unwrap();
    assert_eq!((made.rows, made.cols, made.valid_count()), (60, 80, 40 * 50));
    assert!(made.samples.iter().filter(|d| d.is_finite()).all(|d| (d + 3.0).abs() < 1e-3));
    assert!(bench.path("d.png").exists());
    for (options, mean) in [(&[][..], -3.0), (&["--absolute"], 3.0)] {
        let text = bench.made(&[&["diff", "left.tif", "right.tif", "--json"][..], options].concat());
        let found: serde_json::Value = serde_json::from_str(&text).unwrap();
        assert!((found["mean_m"].as_f64().unwrap() - mean).abs() < 1e-3, "{options:?}: {found}");
        assert_eq!((found["pixels"].as_u64(), found["share_within_4_m"].as_f64()), (Some(2000), Some(1.0)));
    }
}

#[test]
fn mosaics_follow_their_options() {
    let bench = bench();
    let of = |name: &str, options: &[&str]| {
        bench.made(&[&["mosaic", "left.tif", "right.tif", "-o", name][..], options].concat());
        read(bench.path(name)).unwrap()
    };
    let plain = of("plain.tif", &[]);
    assert_eq!((plain.rows, plain.cols), (70, 120));
    for options in [
        &["--erode-length", "3"][..],
        &["--weights-exponent", "1"],
        &["--weights-blur-sigma", "0"],
        &["--priority-blending-length", "8"],
    ] {
        let other = of("other.tif", options);
        let differ = other.samples.iter().zip(&plain.samples).filter(|(a, b)| a != b && !(a.is_nan() && b.is_nan()));
        assert!(differ.count() > 100, "{options:?}");
    }
    let coarse = of("coarse.tif", &["--tr", "4"]);
    assert_eq!((coarse.rows, coarse.cols, coarse.pixel_m()), (35, 60, Some((4.0, 4.0))));
    let part = of("part.tif", &["--t_projwin", "1100", "4900", "1140", "4960"]);
    assert_eq!((part.rows, part.cols), (30, 20));
    assert_eq!(part.samples[0], plain.samples[20 * 120 + 50]);
    of("packed.tif", &["--compress", "none"]);
    assert!(same(&bench.path("packed.tif"), &bench.path("plain.tif")));
    let size = |name: &str| std::fs::metadata(bench.path(name)).unwrap().len();
    assert!(size("packed.tif") > size("plain.tif") + 4000);
    std::fs::write(bench.path("list.txt"), "left.tif\n\nright.tif\n").unwrap();
    bench.made(&["mosaic", "--dem-list", "list.txt", "-o", "listed.tif"]);
    assert!(same(&bench.path("listed.tif"), &bench.path("plain.tif")));
}

#[test]
fn prepared_tiles_follow_their_options() {
    let bench = bench();
    bench.made(&["synth", "--out", "scenes", "--scenes", "1", "--seed", "2", "--rows", "520", "--cols", "650"]);
    let files = [
        "--image",
        "scenes/scene_0000_image.tif",
        "--dtm",
        "scenes/scene_0000_truth.tif",
        "--coarse",
        "scenes/scene_0000_coarse.tif",
    ];
    let of = |out: &str, options: &[&str]| -> serde_json::Value {
        bench.made(&[&["prepare", "--out", out][..], &files, options].concat());
        serde_json::from_slice(&std::fs::read(bench.path(out).join("manifest.json")).unwrap()).unwrap()
    };
    let plain = of("plain", &["--split", "0.5,0,0.5"]);
    assert_eq!((plain["tiles"].as_u64(), plain["splits"]["test"]["tiles"].as_u64()), (Some(4), Some(2)));
    let sharded = of("sharded", &["--split", "1,0,0", "--shard-tiles", "1"]);
    assert_eq!(sharded["splits"]["train"]["shards"].as_array().unwrap().len(), 4);
    let lit = of("lit", &["--sun-azimuth", "-20", "--sun-elevation", "30", "--seed", "4"]);
    assert_eq!(
        (lit["scenes"][0]["azimuth_used_deg"].as_f64(), lit["parameters"]["seed"].as_u64()),
        (Some(-20.0), Some(4))
    );
    let text = bench.refused(&[&["prepare", "--out", "strict", "--max-offset", "0.0001"][..], &files].concat());
    assert!(text.contains("Offset 4"), "{text}");
    let text = bench.refused(&[&["prepare", "--out", "dull", "--max-saturated", "0"][..], &files].concat());
    assert!(text.contains("SaturatedImage 4"), "{text}");
    std::fs::write(
        bench.path("scenes/list.csv"),
        "image,dtm,coarse,site\nscene_0000_image.tif,scene_0000_truth.tif,scene_0000_coarse.tif,A\n",
    )
    .unwrap();
    bench.made(&["prepare", "--list", "scenes/list.csv", "--out", "listed"]);
    let data = ["train", "--data", "plain", "--validation", "synth", "--steps", "1", "--out", "run"];
    let out = bench.run(&[&data[..], &["--batch", "1", "--set", "recipe.validation_tiles=1"]].concat());
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success() && text.contains("training: 2 tiles\n"), "{text}");
    let text = bench.refused(&["train", "--data", "plain", "--out", "another"]);
    assert!(text.contains("tiles for validation expected"), "{text}");
}

#[test]
fn training_says_which_images_give_no_tile() {
    let bench = bench();
    bench.made(&["synth", "--out", "scenes", "--scenes", "1", "--seed", "2", "--rows", "520", "--cols", "320"]);
    bench.made(&["synth", "--out", "low", "--scenes", "1", "--seed", "2", "--rows", "255", "--cols", "320"]);
    for kind in ["image", "coarse", "truth"] {
        let low = bench.path(&format!("low/scene_0000_{kind}.tif"));
        std::fs::rename(low, bench.path(&format!("scenes/low_{kind}.tif"))).unwrap();
    }
    let data = ["train", "--data", "scenes", "--validation", "scenes", "--steps", "1", "--out", "run"];
    let out = bench.run(&[&data[..], &["--batch", "1", "--set", "recipe.validation_tiles=1"]].concat());
    let text = String::from_utf8_lossy(&out.stderr);
    assert!(out.status.success(), "{text}");
    for what in ["training", "validation"] {
        let unused = format!("scenes/low_image.tif: no 256x320 pixels of image, DTM and coarse DTM are valid; {what} ");
        assert!(text.contains(&format!("{what}: 2 tiles\n")) && text.contains(&unused), "{text}");
    }
}

#[test]
fn every_mistake_is_one_line_and_leaves_nothing_behind() {
    let bench = bench();
    let mut elsewhere = read(bench.path("left.tif")).unwrap();
    elsewhere.georef.as_mut().unwrap().crs = Crs::polar(Body::Moon.radius_m(), false);
    write(&bench.path("north.tif"), &elsewhere, &WriteOptions::heights("north")).unwrap();
    elsewhere.georef = None;
    write(&bench.path("nowhere.tif"), &elsewhere, &WriteOptions::heights("nowhere")).unwrap();
    elsewhere.samples.fill(f32::NAN);
    elsewhere.georef = read(bench.path("left.tif")).unwrap().georef;
    write(&bench.path("empty.tif"), &elsewhere, &WriteOptions::image(SampleType::F32, "empty")).unwrap();
    std::fs::write(bench.path("list.txt"), "\n").unwrap();
    std::fs::write(bench.path("scenes.csv"), "image,dtm\n").unwrap();
    let before = bench.files();
    let cases: [(&[&str], &str); 20] = [
        (&["hillshade", "left.tif", "-o", "left.tif"], "must not overwrite an input"),
        (&["hillshade", "left.tif", "-o", "x.jpg"], "x.jpg: a name ending in .tif or .tiff or .png"),
        (&["hillshade", "left.tif", "-o", "no/x.tif"], "no/x.tif: the folder no expected, none found"),
        (&["hillshade", "left.tif", "-o", "x.tif", "--altitude", "91"], "--altitude: 0 to 90"),
        (&["hillshade", "left.tif", "-o", "x.tif", "--z-factor", "0"], "--z-factor above 0"),
        (&["hillshade", "missing.tif", "-o", "x.tif"], "missing.tif: No such file"),
        (&["hillshade", "nowhere.tif", "-o", "x.tif"], "nowhere.tif: a pixel size in metres expected"),
        (&["hillshade", "empty.tif", "-o", "x.tif"], "empty.tif: 3 x 3 valid heights expected"),
        (&["diff", "left.tif", "north.tif", "-o", "x.tif"], "north.tif: valid samples overlapping left.tif"),
        (&["diff", "left.tif", "empty.tif", "-o", "x.tif"], "empty.tif: valid samples overlapping left.tif"),
        (&["diff", "left.tif", "right.tif", "--picture", "right.tif"], "must not overwrite"),
        (
            &["diff", "left.tif", "right.tif", "--picture", "x.png", "-o", "no/x.tif"],
            "no/x.tif: the folder no expected, none found",
        ),
        (&["mosaic", "left.tif", "north.tif", "-o", "x.tif"], "north.tif: the reference system of left.tif"),
        (&["mosaic", "left.tif", "nowhere.tif", "-o", "x.tif"], "nowhere.tif: a raster with a geotransform"),
        (&["mosaic", "empty.tif", "-o", "x.tif"], "empty.tif: a valid height on the mosaic's grid expected"),
        (&["mosaic", "-l", "list.txt", "-o", "x.tif"], "list.txt: one DTM a line expected"),
        (&["mosaic", "left.tif", "-o", "x.tif", "--weights-blur-sigma", "-1"], "--weights-blur-sigma: 0 to 100"),
        (&["mosaic", "left.tif", "-o", "x.tif", "--t_projwin", "-9", "-9", "-8", "-8"], "--t_projwin: a part of"),
        (&["prepare", "--list", "scenes.csv", "--out", "x"], "scenes.csv: broken file: line 1: a column coarse"),
        (&["prepare", "--list", "missing.csv", "--out", "x"], "missing.csv: No such file"),
    ];
    for (arguments, expected) in cases {
        let text = bench.refused(arguments);
        assert!(text.contains(expected), "{arguments:?}: {text}");
    }
    assert_eq!(bench.files(), before, "nothing was left behind");
}

#[test]
fn a_mosaic_in_another_system_lies_where_its_dtms_lie() {
    let bench = bench();
    bench.made(&["mosaic", "left.tif", "-o", "degrees.tif", "--t_srs", "IAU_2015:30100"]);
    bench.made(&["mosaic", "degrees.tif", "-o", "back.tif", "--t_srs", "IAU_2015:30135", "--tr", "2"]);
    let degrees = read(bench.path("degrees.tif")).unwrap();
    assert!(!degrees.georef.as_ref().unwrap().crs.is_projected());
    // Two bilinear interpolations of waves at least 180 m long.
    let found = bench.made(&["diff", "back.tif", "left.tif", "--json"]);
    let found: serde_json::Value = serde_json::from_str(&found).unwrap();
    assert!(found["rmse_m"].as_f64().unwrap() < 0.03, "{found:#}");
    // Two systems in one job.
    bench.made(&["mosaic", "degrees.tif", "right.tif", "-o", "both.tif", "--t_srs", "IAU_2015:30135", "--tr", "2"]);
    assert!(read(bench.path("both.tif")).unwrap().valid_count() > 7000);
    let unknown = bench.run(&["mosaic", "left.tif", "-o", "x.tif", "--t_srs", "EPSG:4326"]);
    assert!(!unknown.status.success() && String::from_utf8_lossy(&unknown.stderr).contains("EPSG:4326"));
    assert!(!bench.path("x.tif").exists());
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    let bench = bench();
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let child = bench.command(&["inspect", "left.tif"]).stdout(writer).stderr(Stdio::piped()).spawn();
    let out = child.unwrap().wait_with_output().unwrap();
    assert_eq!(String::from_utf8_lossy(&out.stderr), "");
    assert_eq!(out.status.code(), Some(141));
}
