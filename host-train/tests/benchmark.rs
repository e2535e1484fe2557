//! The benchmark that others can enter: its scenes do not change, its scorer agrees with `evaluate`, and voids gain nothing.

mod support;

use elunar_base::digest::sha256_hex;
use elunar_raster::geotiff::{WriteOptions, write};
use elunar_raster::source;
use elunar_testing::oracle;
use serde_json::{Value, json};
use support::Shell;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/benchmark");
const SUITES: [&str; 2] = ["held-out", "landforms"];

/// Writes the benchmark's scenes into `bench`.
fn make_scenes(shell: &Shell) {
    for suite in SUITES {
        let list = format!("{FOLDER}/../suites/{suite}.toml");
        shell.made(&["suite", "--scenes-only", "--suite", &list, "--out", &format!("bench/{suite}")]);
    }
}

#[test]
fn scenes_are_those_of_the_table_on_every_processor() {
    let shell = Shell::new();
    make_scenes(&shell);
    let made = SUITES.map(|suite| {
        let table = std::fs::read_to_string(shell.path(&format!("bench/{suite}/scenes/scenes.csv"))).unwrap();
        table.lines().skip(1).map(String::from).collect::<Vec<_>>()
    });
    let table = std::fs::read_to_string(format!("{FOLDER}/scenes.csv")).unwrap();
    assert_eq!(table.lines().count(), 1 + made.concat().len());
    for (line, made) in table.lines().skip(1).zip(made.concat()) {
        let cells: Vec<&str> = line.split(',').collect();
        let [suite, name] = [cells[0], cells[1]];
        assert_eq!(format!("{name},{}", cells[3..6].join(",")), made);
        for (kind, expected) in ["image", "coarse", "truth"].into_iter().zip(&cells[6..]) {
            let path = shell.path(&format!("bench/{suite}/scenes/{name}_{kind}.tif"));
            let samples = source::read(&path).unwrap().samples;
            let bytes: Vec<u8> = samples.iter().flat_map(|sample| (sample + 0.0).to_le_bytes()).collect();
            assert_eq!(sha256_hex(&bytes), *expected, "{name} {kind}");
        }
    }
    entries_are_scored(&shell);
}

/// Runs the scorer as a user does: on the truths themselves, on a folder with one DTM, and on one with another grid.
fn entries_are_scored(shell: &Shell) {
    let script = format!(
        "import csv, io, pathlib, shutil, subprocess, sys\n\
         def run(*words): return subprocess.run([sys.executable, {FOLDER:?} + '/score.py', 'bench', *words], capture_output=True, text=True)\n\
         scenes = list(csv.DictReader(open({FOLDER:?} + '/scenes.csv')))\n\
         for folder in ('all', 'one', 'wrong'): pathlib.Path(folder).mkdir()\n\
         for s in scenes: shutil.copy(f\"bench/{{s['suite']}}/scenes/{{s['name']}}_truth.tif\", f\"all/{{s['name']}}_dtm.tif\")\n\
         shutil.copy('all/mare-1m_dtm.tif', 'one')\n\
         shutil.copy('bench/held-out/scenes/mare-1m_coarse.tif', 'wrong/mare-1m_dtm.tif')\n\
         checked = run('--check')\n\
         assert checked.returncode == 0, checked.stdout\n\
         good = run('all')\n\
         assert good.returncode == 0, good.stderr\n\
         rows = list(csv.DictReader(io.StringIO(good.stdout)))\n\
         assert [r['scene'] for r in rows[:-9]] == [s['name'] for s in scenes], good.stdout\n\
         assert [r['kind'] for r in rows[-9:]] == [*dict.fromkeys(s['kind'] for s in scenes), 'all', 'all'], good.stdout\n\
         assert all(float(r['rmse_m ratio']) == 0 for r in rows)\n\
         one = run('one')\n\
         assert one.returncode == 1 and one.stdout.count('mare-1m') == 1, one.stdout\n\
         assert one.stderr.startswith('ERROR: one: DTMs of 19 scenes are absent: mare-a-sun1, '), one.stderr\n\
         wrong = run('wrong')\n\
         assert wrong.returncode == 1 and not wrong.stdout, wrong.stdout\n\
         assert wrong.stderr.startswith('ERROR: wrong/mare-1m_dtm.tif: the grid of mare-1m_truth.tif expected, 512 x 640 pixels with'), wrong.stderr\n\
         assert wrong.stderr.count('\\n') == 1, wrong.stderr"
    );
    oracle::python(&["numpy", "rasterio"], &script, &shell.path(""));
}

const LIST: &str = r#"
name = "small"
[[scene]]
name = "mare"
synth = { seed = 31, options = { kind = "mare", rows = 128, cols = 160 } }
[[scene]]
name = "highland"
synth = { seed = 32, options = { kind = "highland", rows = 128, cols = 160, pixel_m = 4 } }
[[scene]]
name = "landforms"
synth = { seed = 33, options = { landforms = 1.0, rows = 128, cols = 160 } }
"#;

/// Makes DTMs of small scenes, and one with voids: a block, and pixels that touch an edge. Returns the figures of `evaluate` and `suite`.
fn small_scenes(shell: &Shell) -> Value {
    std::fs::write(shell.path("small.toml"), LIST).unwrap();
    shell.made(&["suite", "--suite", "small.toml", "--model", "nano", "--out", "small"]);
    let mut holes = source::read(&shell.path("small/dtm/nano/highland.tif")).unwrap();
    (30..60).for_each(|row| holes.samples[row * 160 + 70..][..40].fill(f32::NAN));
    (0..128).step_by(9).for_each(|row| holes.samples[row * 160] = f32::NAN);
    write(&shell.path("holes.tif"), &holes, &WriteOptions::heights("test")).unwrap();

    let text = std::fs::read_to_string(shell.path("small/results.json")).unwrap();
    let results: Value = serde_json::from_str(&text).unwrap();
    let mut cases = vec![];
    for scene in results["scenes"].as_array().unwrap() {
        let name = scene["name"].as_str().unwrap();
        let judged = |method: &str| scene["judged"].as_array().unwrap().iter().find(|j| j["method"] == method).unwrap();
        let figures = |judged: &Value| {
            let mut figures = judged["heights"].clone();
            figures["slope_vector"] = judged["relief"]["slope_vector_error"].clone();
            figures
        };
        let truth = format!("small/scenes/{name}_truth.tif");
        let mut case = |dtm: &str, vectors: Option<Value>| {
            let ours = shell.made(&["evaluate", "--dtm", dtm, "--truth", &truth, "--json"]);
            let mut ours = serde_json::from_str::<Value>(&ours).unwrap()["candidates"][0].clone();
            if let Some(length) = vectors {
                ours["slope_vector"] = length;
            }
            let coarse = figures(judged("coarse DTM"));
            cases.push(
                json!({ "dtm": dtm, "truth": truth, "pixel_m": scene["pixel_m"][0], "coarse": coarse, "ours": ours }),
            );
        };
        let nano = judged("nano");
        case(&format!("small/dtm/nano/{name}.tif"), Some(nano["relief"]["slope_vector_error"].clone()));
        if name == "highland" {
            case("holes.tif", None);
        }
    }
    Value::Array(cases)
}

#[test]
fn the_scorer_agrees_with_evaluate_and_voids_gain_nothing() {
    let shell = Shell::new();
    let cases = small_scenes(&shell);
    assert_eq!(cases.as_array().unwrap().len(), 4);
    let holes = &cases[2]["ours"]["pixels"];
    assert_eq!(*holes, json!(128 * 160 - 30 * 40 - 15));
    std::fs::write(shell.path("cases.json"), cases.to_string()).unwrap();
    let script = format!(
        "import sys; sys.path.insert(0, {FOLDER:?})\nimport json, score\nimport numpy as np\n\
         compared = 0\n\
         for case in json.load(open('cases.json')):\n\
         \x20   (dtm, _), (truth, _) = score.read(case['dtm']), score.read(case['truth'])\n\
         \x20   found = score.score(dtm, truth, case['pixel_m'])\n\
         \x20   for figure in ('pixels', *score.FIGURES):\n\
         \x20       if figure in case['ours']:\n\
         \x20           ours = case['ours'][figure]\n\
         \x20           assert abs(found[figure] - ours) <= 1e-6 * abs(ours), (case['dtm'], figure, found[figure], ours)\n\
         \x20           compared += 1\n\
         \x20   ratios = lambda of: np.array([score.ratio(figure, of, case['coarse']) for figure in score.FIGURES])\n\
         \x20   kept = ratios(found)\n\
         \x20   if found['void'] > 0:\n\
         \x20       continue\n\
         \x20   assert np.allclose(kept, [found[f] / case['coarse'][f] for f in score.FIGURES])\n\
         \x20   slopes = [np.pad(score.gradient(m, case['pixel_m']), ((0, 0), (1, 1), (1, 1))) for m in (dtm, truth)]\n\
         \x20   for hard in (np.abs(dtm - truth), np.hypot(*(slopes[0] - slopes[1])), np.hypot(*slopes[1])):\n\
         \x20       for share in (0.001, 0.02, 0.2):\n\
         \x20           left = score.score(np.where(hard > np.quantile(hard, 1 - share), np.nan, dtm), truth, case['pixel_m'])\n\
         \x20           assert left['void'] > 0.9 * share and (ratios(left) > kept).all(), (case['dtm'], share, ratios(left), kept)\n\
         print(compared)"
    );
    let Some(compared) = oracle::python(&["numpy", "rasterio"], &script, &shell.path("")) else { return };
    // Of four DTMs the pixels and four figures of `evaluate`; of three the slope vectors of `suite`.
    assert_eq!(compared.trim(), "23");
}
