//! The figures of a tour as JSON.

use super::Story;
use elunar_evaluate::{Details, json as scores};
use serde_json::{Value, json};

/// Returns all figures in one object, with units in the names.
pub(super) fn figures(story: &Story) -> Value {
    let Story { settings, seeds, scene, tuned, shrunk, predicted, verdict, times } = story;
    let against_truth: Value =
        serde_json::from_str(&scores(&verdict.against_truth, &Details::default())).unwrap_or_default();
    let networks: Vec<Value> = predicted
        .iter()
        .map(|p| json!({ "name": p.name, "model": p.model, "tiles": p.made.tally.tiles, "predict_s": p.seconds }))
        .collect();
    let steps: Vec<Value> = times.iter().map(|t| json!({ "step": t.title, "seconds": t.seconds })).collect();
    json!({
        "synthetic": true,
        "software": concat!("host-train ", env!("CARGO_PKG_VERSION")),
        "seed": settings.seed,
        "moons": {
            "scene": seeds.scene, "training": seeds.training,
            "validation": seeds.validation, "calibration": seeds.calibration,
        },
        "scene": scene.about,
        "training": {
            "started_from": tuned.started_from, "recipe": settings.recipe, "parameters": tuned.parameters,
            "before": tuned.before, "after": tuned.after, "improved": tuned.improved,
            "steps_per_s": tuned.steps_per_s,
        },
        "int8": {
            "flash_bytes": shrunk.flash_bytes, "float_bytes": shrunk.float_bytes,
            "arena_bytes": shrunk.arena_bytes, "macs": shrunk.macs, "operators": shrunk.operators,
            "against_float_on_tiles": shrunk.comparison,
            "against_float_on_scene": verdict.int8_against_float,
        },
        "networks": networks,
        "against_truth": against_truth,
        "steps": steps,
    })
}
