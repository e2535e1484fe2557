//! Test suites from the command line: shipped model, other DTMs, tables, a page.

mod support;

use elunar_base::digest::sha256_hex;
use elunar_core::sun::Body;
use elunar_raster::geotiff::{SampleType, WriteOptions, write};
use elunar_raster::{Crs, source};
use std::path::Path;
use support::Shell;

const MODEL: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/models/nano.eld");
const LIST: &str = "name = 'small'\n[[scene]]\nname = 'a'\nkind = 'mare'\n\
    synth = { seed = 600000, options = { kind = 'mare', rows = 96, cols = 128, sun_azimuth_deg = [300, 300], sun_elevation_deg = [30, 30] } }\n";

#[test]
fn a_model_and_another_programs_dtms_end_in_tables_and_on_a_page() {
    let shell = Shell::new();
    std::fs::write(shell.path("list.toml"), LIST).unwrap();
    let said = shell.made(&["suite", "--suite", "list.toml", "--out", "out", "--scenes-only"]);
    assert!(said.contains("1 scenes"), "{said}");
    let table = std::fs::read_to_string(shell.path("out/scenes/scenes.csv")).unwrap();
    assert_eq!(table, "name,sun_azimuth_deg,sun_elevation_deg,pixel_m\na,300.000,30.000,2.000\n");

    // The other program returns the truth.
    std::fs::create_dir(shell.path("known")).unwrap();
    let against = ["suite", "--suite", "list.toml", "--out", "out", "--model", MODEL, "--against", "oracle=known"];
    let refused = shell.refused(&against);
    assert!(refused.contains("known/a.tif"), "{refused}");
    std::fs::copy(shell.path("out/scenes/a_truth.tif"), shell.path("known/a_dtm.tif")).unwrap();
    let said = shell.made(&against);
    for name in ["coarse DTM", "nano.eld", "oracle"] {
        assert!(said.contains(&format!("| mare | {name} | 1 |")), "{said}");
    }
    let rows = std::fs::read_to_string(shell.path("out/sums.csv")).unwrap();
    let rmse = |name: &str| {
        let row = rows.lines().find(|row| row.contains(name)).unwrap();
        row.split(',').nth(7).unwrap().parse::<f64>().unwrap()
    };
    assert!(rmse("oracle") == 0.0 && rmse("nano.eld") < 1.02 * rmse("coarse DTM") && rmse("nano.eld") > 0.1, "{rows}");
    let dtm = source::read(&shell.path("out/dtm/nano.eld/a.tif")).unwrap();
    assert_eq!((dtm.rows, dtm.cols, dtm.valid_count()), (96, 128, 96 * 128));

    let refused = shell.refused(&["report", "out", "-o", "out/sums.csv"]);
    assert!(refused.contains("must not overwrite"), "{refused}");
    shell.made(&["report", "out", "-o", "page.html"]);
    let page = std::fs::read_to_string(shell.path("page.html")).unwrap();
    assert!(page.matches("data:image/png").count() == 2 && page.contains("oracle"));
    // The relief has the scene, with the DTM of the last method.
    assert!(page.contains("\"title\":\"a\",\"rows\":96,\"cols\":128") && page.contains("\"name\":\"oracle\""));
}

/// A comparison at a coarser resolution smooths errors, but hillshades show truth and DTMs as they are.
#[test]
fn hillshades_are_not_smoothed() {
    let shell = Shell::new();
    let drawn = |name: &str, list: String| {
        std::fs::write(shell.path("list.toml"), list).unwrap();
        shell.made(&["suite", "--suite", "list.toml", "--out", name]);
        ["relief", "errors"].map(|what| std::fs::read(shell.path(&format!("{name}/pictures/a_{what}.png"))).unwrap())
    };
    let [relief, errors] = drawn("fine", LIST.into());
    let [coarser_relief, coarser_errors] = drawn("coarser", format!("{LIST}truth_resolution_m = 40\n"));
    assert!(relief == coarser_relief && errors != coarser_errors);
}

#[test]
fn mistakes_are_named() {
    let shell = Shell::new();
    std::fs::write(shell.path("list.toml"), LIST.replace("kind = 'mare'\n", "sort = 'mare'\n")).unwrap();
    let refused = shell.refused(&["suite", "--suite", "list.toml", "--out", "out"]);
    assert!(refused.contains("list.toml") && refused.contains("line 4") && refused.contains("sort"), "{refused}");
    std::fs::write(shell.path("x.toml"), "answers = '?'\npreset = 'nano'\n[recipe]\nstep = 3\n").unwrap();
    let refused = shell.refused(&["experiment", "x.toml", "--out", "out"]);
    assert!(refused.contains("x.toml") && refused.contains("line 4: unknown key recipe.step"), "{refused}");
    let refused = shell.refused(&["report", ".", "-o", "page.html"]);
    assert!(refused.contains("found none") && !shell.path("page.html").exists(), "{refused}");
    let refused = shell.refused(&["suite", "--out", "out", "--against", "known"]);
    assert!(refused.contains("NAME=DIR"), "{refused}");
    assert!(!shell.path("out").exists(), "nothing half made");
}

/// One of the real sets, made up: the scene is made, scored against its truth, and the absent sets are named.
#[test]
fn real_scenes_are_scored_and_absent_sets_named() {
    let shell = Shell::new();
    let refused = shell.refused(&["suite", "--real", ".", "--out", "out"]);
    assert!(refused.contains("mars_gale_hirise_1m/truth_dtm_1m.tif") && refused.contains("found none"), "{refused}");
    assert!(!shell.path("out").exists());
    let folder = shell.path("data/mars_gale_hirise_1m");
    std::fs::create_dir_all(&folder).unwrap();
    let hills = |x: f64, y: f64| 9.0 * (x * 0.05).sin() + 6.0 * (y * 0.07).cos();
    for (file, options) in [
        ("image_1m.tif", WriteOptions::image(SampleType::F32, "image")),
        ("truth_dtm_1m.tif", WriteOptions::heights("truth")),
    ] {
        let crs = Crs::equirectangular(Body::Moon.radius_m(), 0.0, 0.0);
        write(&folder.join(file), &support::raster((200, 250), (0.0, 0.0), 1.0, crs, hills), &options).unwrap();
    }
    std::fs::create_dir(shell.path("known")).unwrap();
    let arguments = ["suite", "--real", "data", "--out", "out", "--against", "oracle=known"];
    let out = shell.run(&[&arguments[..], &["--scenes-only"]].concat());
    let said = String::from_utf8(out.stderr).unwrap();
    assert!(out.status.success() && said.matches("SKIPPED: ").count() == 6, "{said}");
    assert!(said.contains("moon_wac_lola_north_pole: not there"), "{said}");
    // The other program returns the truth.
    let name = "mars_gale_hirise_1m";
    std::fs::copy(shell.path(&format!("out/scenes/{name}_truth.tif")), shell.path(&format!("known/{name}.tif")))
        .unwrap();
    let out = shell.run(&arguments);
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let rows = std::fs::read_to_string(shell.path("out/scenes.csv")).unwrap();
    let row = |method: &str| -> Vec<String> {
        let row = rows.lines().find(|row| row.contains(method)).unwrap();
        row.split(',').map(String::from).collect()
    };
    // At a resolution of 10.7 m, the truth follows its shortest octave, 5.3 to 10.7 m, and has no offset. Columns are counted from the end, as the heading has commas.
    let (oracle, coarse) = (row("oracle"), row("coarse DTM"));
    let last = oracle.len() - 3;
    assert_eq!(oracle[last..], ["7.5", "0.00", "0.00"], "{rows}");
    assert!(coarse[last].parse::<f64>().unwrap() > 50.0 && oracle[6] == "0.00" && coarse[6] != "0.00", "{rows}");
}

#[test]
fn every_shipped_model_is_on_its_card_and_finds_slopes() {
    let folder = Path::new(MODEL).parent().unwrap();
    let card = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let (mut bytes, mut runners) = (0, Vec::new());
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        let kind = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        if !["eld", "safetensors"].contains(&kind) {
            continue;
        }
        let contents = std::fs::read(&path).unwrap();
        bytes += contents.len();
        let row = format!("| `{name}` | `{}` |", sha256_hex(&contents));
        assert!(card.contains(&row), "expected on the card: {row}");
        if kind == "eld" {
            runners.push((name, path.to_str().unwrap().to_owned()));
        }
    }
    assert!(bytes <= 40_000_000, "{bytes} bytes of models are more than a checkout should carry");

    let shell = Shell::new();
    std::fs::write(shell.path("list.toml"), LIST.replace("rows = 96, cols = 128", "rows = 256, cols = 320")).unwrap();
    let mut request = vec!["suite", "--suite", "list.toml", "--out", "out"];
    runners.iter().for_each(|(_, path)| request.extend(["--model", path]));
    shell.made(&request);
    let rows = std::fs::read_to_string(shell.path("out/sums.csv")).unwrap();
    for (name, _) in runners {
        let row = rows.lines().find(|row| row.contains(&name)).unwrap();
        // The column after scenes, method, number, three shares, MAE, RMSE and its ratio, slope MAE and slope vector error.
        let ratio: f64 = row.split(',').nth(11).unwrap().parse().unwrap();
        println!("{name}: slope-vector error {ratio} of the coarse DTM's");
        assert!(ratio < 0.7, "{name}: {ratio} of the coarse DTM's slope error");
    }
}
