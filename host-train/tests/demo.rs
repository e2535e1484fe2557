//! The whole tour in a small size.

use elunar_evaluate::{Candidate, compare};
use elunar_learn::train::recipe::Recipe;
use elunar_learn::train::run::RunRecord;
use elunar_net::config::{NetConfig, Preset, trained_network};
use elunar_raster::{align::Named, geotiff::read};
use host_train::demo::{InitialWeights, TourSettings, run};
use std::path::Path;

/// Returns settings with a narrow network, one tile and two steps.
fn small(out: &Path, steps: usize) -> TourSettings {
    let network = NetConfig {
        embed: 8,
        depths: [1; 4],
        heads: [1, 1, 2, 2],
        stem: 4,
        dtm: [4, 4, 4, 8, 8],
        decoder: [16, 8, 8, 4, 4],
        ..trained_network(Preset::Nano)
    };
    let settings = TourSettings::new(out.into(), InitialWeights::Scratch(network), 3, Some(steps));
    let recipe = Recipe { batch: 2, crop: [64, 64], crops_per_tile: 2, validation_tiles: 1, ..settings.recipe };
    TourSettings { recipe, scene_px: (256, 330), calibration_tiles: 1, comparison_tiles: 1, ..settings }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.collect();
    names.sort();
    names
}

/// Returns the bytes of every picture inside a page.
fn embedded(page: &str) -> Vec<Vec<u8>> {
    use base64::Engine;
    let data = page.split("data:image/png;base64,").skip(1).map(|rest| rest.split('"').next().unwrap());
    data.map(|text| base64::engine::general_purpose::STANDARD.decode(text).unwrap()).collect()
}

#[test]
fn a_tour_tells_everything_in_one_page_and_a_second_one_replaces_only_its_own() {
    let out = tempfile::tempdir().unwrap();
    std::fs::create_dir(out.path().join("training")).unwrap();
    for foreign in ["notes.txt", "training/notes.txt"] {
        std::fs::write(out.path().join(foreign), "mine").unwrap();
    }
    let report = run(&small(out.path(), 2)).unwrap();
    let page = std::fs::read_to_string(&report).unwrap();
    for needed in [
        "Synthetic data",
        "not a reproduction of the paper's tables",
        "Slope MAE",
        "Share within 4 m",
        "predict --image",
    ] {
        assert!(page.contains(needed), "{needed}");
    }
    // Encoded pictures may contain any letters.
    let text: String =
        page.split("data:image/png;base64,").map(|part| part.split_once('"').map_or(part, |p| p.1)).collect();
    // The page loads nothing: its scripts are data and the relief's code, which names only the namespace of SVG.
    assert_eq!((text.matches("<script").count(), text.matches("http").count()), (2, 1));
    let (before, rest) = text.split_once("<script").unwrap();
    let after = rest.rsplit_once("</script>").unwrap().1;
    let words = format!("{before}{after}");
    assert!(!words.contains(" href=") && !words.contains("NaN"));

    let pictures = embedded(&page);
    let expected =
        ["error_coarse.png", "error_untrained.png", "error_float.png", "error_int8.png", "training/curves.png"];
    assert_eq!((pictures.len(), words.matches(" src=").count()), (expected.len(), expected.len()));
    for (picture, name) in pictures.iter().zip(expected) {
        assert!(*picture == std::fs::read(out.path().join(name)).unwrap(), "{name} is not in its place");
        assert!(image::load_from_memory(picture).is_ok(), "{name}");
    }

    // The page's table holds the figures that `evaluate` computes from the files.
    let figures: serde_json::Value =
        serde_json::from_slice(&std::fs::read(out.path().join("figures.json")).unwrap()).unwrap();
    let (truth, int8) =
        (read(out.path().join("scene_0000_truth.tif")).unwrap(), read(out.path().join("dtm_int8.tif")).unwrap());
    let found = compare(Named::new("t", &truth), &[Candidate::fine("i", &int8)], None).unwrap().scored[0].scores;
    let stated = figures["against_truth"]["candidates"][3]["rmse_m"].as_f64().unwrap();
    assert!((stated - found.rmse_m).abs() < 1e-9, "{stated} {}", found.rmse_m);
    assert!(page.contains(&format!(">{:.2}</td>", found.slope_mae_deg)), "the table holds the slope error");
    assert!(
        figures["int8"]["flash_bytes"].as_u64().unwrap()
            == std::fs::metadata(out.path().join("model.eld")).unwrap().len()
    );

    let mine =
        TourSettings { start: InitialWeights::Weights(out.path().join("model.safetensors")), ..small(out.path(), 1) };
    let refused = run(&mine).unwrap_err().to_string();
    assert!(refused.contains("model.safetensors: would be written"), "{refused}");
    let before = names(out.path());
    run(&small(out.path(), 1)).unwrap();
    assert_eq!(names(out.path()), before, "the second tour made the same files");
    assert_eq!(RunRecord::read(&out.path().join("training")).unwrap().recipe.steps, 1);
    for foreign in ["notes.txt", "training/notes.txt"] {
        assert_eq!(std::fs::read_to_string(out.path().join(foreign)).unwrap(), "mine");
    }
}

#[test]
fn mistakes_are_found_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let refused = |settings: TourSettings| run(&settings).unwrap_err().to_string();
    let absent = TourSettings { start: InitialWeights::Weights("no/such.safetensors".into()), ..small(&out, 1) };
    assert!(refused(absent).contains("no/such.safetensors"));
    assert!(refused(small(&out, 0)).contains("steps"));
    assert!(refused(TourSettings { seed: TourSettings::SEEDS, ..small(&out, 1) }).contains("seed"));
    let broken = folder.path().join("broken.safetensors");
    std::fs::write(&broken, "not weights").unwrap();
    assert!(
        refused(TourSettings { start: InitialWeights::Weights(broken), ..small(&out, 1) })
            .contains("broken.safetensors")
    );
    assert!(!out.exists());
}

#[test]
fn a_training_run_of_somebody_else_is_left_alone() {
    let out = tempfile::tempdir().unwrap();
    let theirs = out.path().join("training");
    std::fs::create_dir(&theirs).unwrap();
    let settings = small(out.path(), 1);
    let record = serde_json::json!({
        "network": trained_network(Preset::Nano), "recipe": settings.recipe, "seed": 0, "backend": "flex",
        "data": {"folder": {"path": "d"}}, "validation_data": {"folder": {"path": "d"}}, "started_from": "random weights, seed 0",
    });
    std::fs::write(theirs.join("run.json"), record.to_string()).unwrap();
    std::fs::write(theirs.join("best.safetensors"), "theirs").unwrap();
    let refused = run(&settings).unwrap_err().to_string();
    assert!(refused.contains("another run"), "{refused}");
    assert_eq!(names(&theirs), ["best.safetensors", "run.json"]);
    assert!(!out.path().join("model.safetensors").exists() && !out.path().join("report.html").exists());
}
