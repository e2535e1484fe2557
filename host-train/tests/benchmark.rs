//! The benchmark that others can enter: its scenes do not change, and its scorer agrees with `evaluate`.

mod support;

use elunar_base::digest::sha256_hex;
use elunar_raster::source;
use elunar_testing::oracle;
use support::Shell;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/benchmark");

#[test]
fn scenes_are_those_of_the_table_on_every_processor() {
    let shell = Shell::new();
    shell.made(&["suite", "--scenes-only", "--out", "bench"]);
    let table = std::fs::read_to_string(format!("{FOLDER}/scenes.csv")).unwrap();
    let made = std::fs::read_to_string(shell.path("bench/scenes/scenes.csv")).unwrap();
    assert_eq!(table.lines().count(), 13);
    for (line, made) in table.lines().zip(made.lines()).skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        assert_eq!(cells[..4].join(","), made);
        for (kind, expected) in ["image", "coarse", "truth"].into_iter().zip(&cells[4..]) {
            let path = shell.path(&format!("bench/scenes/{}_{kind}.tif", cells[0]));
            let samples = source::read(&path).unwrap().samples;
            let bytes: Vec<u8> = samples.iter().flat_map(|sample| (sample + 0.0).to_le_bytes()).collect();
            assert_eq!(sha256_hex(&bytes), *expected, "{} {kind}", cells[0]);
        }
    }
}

#[test]
fn the_scorer_agrees_with_evaluate() {
    let shell = Shell::new();
    shell.made(&["suite", "--scenes-only", "--out", "bench"]);
    std::fs::create_dir(shell.path("dtms")).unwrap();
    let of = |kind: &str| format!("bench/scenes/mare-1m_{kind}.tif");
    let [image, coarse, truth] = ["image", "coarse", "truth"].map(of);
    let dtm = "dtms/mare-1m.tif";
    shell.made(&["predict", "--image", &image, "--coarse", &coarse, "--model", "nano", "-o", dtm]);
    let ours = shell.made(&["evaluate", "--dtm", dtm, "--truth", &truth, "--json"]);
    let ours: serde_json::Value = serde_json::from_str(&ours).unwrap();
    let script = format!(
        "import sys; sys.path.insert(0, {FOLDER:?})\nimport json, score\n\
         read = lambda path: score.read(path)[0]\n\
         print(json.dumps(score.score(read({dtm:?}), read({truth:?}), 1.0)))"
    );
    let Some(theirs) = oracle::python(&["numpy", "rasterio"], &script, &shell.path("")) else { return };
    let theirs: serde_json::Value = serde_json::from_str(&theirs).unwrap();
    for figure in ["pixels", "rmse_m", "mae_m", "nmad_m", "slope_rmse_deg"] {
        let [ours, theirs] = [&ours["candidates"][0][figure], &theirs[figure]].map(|v| v.as_f64().unwrap());
        assert!((ours - theirs).abs() <= 1e-6 * theirs.abs(), "{figure}: {ours} here, {theirs} there");
    }
}
