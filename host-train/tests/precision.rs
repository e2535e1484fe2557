//! Effects of precision, and a model's bytes and time, measured on the narrow network of the golden case.

use elunar::picture::{arena, costs};
use elunar_core::nn::{Model, required};
use elunar_net::config::{NetConfig, config_of};
use elunar_net::export::calibrate::{Range, TileTruth, calibrate};
use elunar_net::export::choose::{ExportJob, choose};
use elunar_net::export::codes::{can_widen, wide_by_rule};
use elunar_net::export::compile::{Export, finish};
use elunar_net::export::graph::{Graph, Operation};
use elunar_net::export::report::compare;
use elunar_net::export::sensitivity::{Sensitivity, SensitivityPlan};
use elunar_net::export::{CalibrationTile, CompileOptions, MapBits, build};
use elunar_net::inspect::{model, plan_text, timing};
use elunar_net::kernels;
use elunar_net::weights::NetWeights;
use std::path::Path;
use support::Shell;

mod support;

/// Large enough that the last decoder blocks contain their upsampling.
const TILE: (usize, usize) = (64, 64);

struct Bench {
    config: NetConfig,
    graph: Graph,
    ranges: Vec<Range>,
    tiles: Vec<CalibrationTile>,
    options: CompileOptions,
}

/// Returns the golden network, calibrated on the tiles it is scored on, so that no sample lies beyond its codes.
fn bench() -> Bench {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mini/case.safetensors");
    let weights = NetWeights::read(&path).unwrap();
    let config = config_of(&weights, &path).unwrap();
    let graph = build::build(&config, &weights, &path, TILE).unwrap();
    let tiles: Vec<CalibrationTile> = (0..2).map(|seed| tile(config.nr, seed)).collect();
    let ranges = calibrate(&graph, &tiles, |_| {}).unwrap();
    let options = CompileOptions { tile: TILE, precision: MapBits::Mixed, name: "mini".into() };
    Bench { config, graph, ranges, tiles, options }
}

/// Returns a tile of waves, with noise on the image, and a truth that no network reaches.
fn tile(nr: f32, seed: usize) -> CalibrationTile {
    let (rows, cols) = TILE;
    let wave = |i: usize, step: f32| {
        0.5 + 0.4 * ((i / cols + 7 * seed) as f32 * step).sin() * ((i % cols) as f32 * 0.7 * step).cos()
    };
    let noise = |i: usize| ((i * 7919 + seed * 104_729) % 1013) as f32 / 1013.0 - 0.5;
    let image = (0..rows * cols).map(|i| (wave(i, 0.9) + 0.15 * noise(i)).clamp(0.0, 1.0)).collect();
    let coarse = (0..rows * cols).map(|i| nr * wave(i, 0.1)).collect();
    let truth = (0..rows * cols).map(|i| nr * wave(i, 0.13)).collect();
    CalibrationTile { image, coarse, ground: Some(TileTruth { metres_per_unit: 2.0, pixel_m: 2.0, truth }) }
}

impl Bench {
    fn export(&self, wide: &[bool]) -> Export {
        finish(&self.config, self.graph.clone(), &self.ranges, wide, &self.options).unwrap()
    }

    fn sensitivity(&self, wide: &[bool]) -> Sensitivity {
        SensitivityPlan::new(&self.graph, &self.ranges, self.config.nr, wide).measure(&self.tiles, |_| {}).unwrap()
    }
}

#[test]
fn every_rounding_is_measured_and_their_sum_foretells_the_runner() {
    let bench = bench();
    for precision in [MapBits::Int8, MapBits::Mixed, MapBits::Int16] {
        let wide = wide_by_rule(&bench.graph, precision);
        let found = bench.sensitivity(&wide);
        assert_eq!((found.tiles, found.layers.len()), (2, bench.graph.nodes.len()));
        for (id, (layer, node)) in found.layers.iter().zip(&bench.graph.nodes).enumerate() {
            let free = can_widen(&bench.graph, id);
            assert_eq!(layer.map8.is_some() && layer.map16.is_some(), free, "{}", layer.name);
            assert_eq!(layer.weights8.is_some(), matches!(node.operation, Operation::Conv { .. }), "{}", layer.name);
            assert_eq!(layer.bits == Some(16), node.inputs().is_empty() || (free && wide[id]), "{}", layer.name);
            if let (Some(eight), Some(sixteen)) = (layer.map8, layer.map16) {
                assert!(sixteen.rmse_m <= eight.rmse_m && eight.cut_ppm == 0.0, "{layer:?}");
            }
        }
        // All at once, in integers: between half and twice the effect of independent roundings. A wrong or missing rounding of one layer
        // would exceed this.
        let ground = compare(&bench.export(&wide), &bench.tiles, |_| {}).unwrap().ground.unwrap();
        let ratios = [found.predicted.rmse_m / ground.rmse_m, found.predicted.slope_rmse_deg / ground.slope_rmse_deg];
        assert!(ratios.iter().all(|r| (0.5..2.0).contains(r)), "{precision:?}: {ratios:?} {ground:?}");
        assert!((found.float_slope_error_deg - ground.float_slope_error_deg).abs() < 1e-9);
    }
}

#[test]
fn maps_are_chosen_until_the_bound_holds() {
    let bench = bench();
    let rule = wide_by_rule(&bench.graph, MapBits::Mixed);
    let found = bench.sensitivity(&rule);
    let Bench { config, graph, ranges, tiles, options } = &bench;
    let tiles = &tiles[..1];
    let job = ExportJob { config, graph, ranges, options, tiles };
    let growth = |export: &Export| compare(export, tiles, |_| {}).unwrap().ground.unwrap().slope_error_growth_percent;
    let none = choose(&job, &found, 100.0, |_| {}).unwrap();
    assert_eq!((none.trials.len(), none.wide.iter().filter(|w| **w).count()), (1, 0));
    let order = found.by_gain();
    let mut wide = vec![false; graph.nodes.len()];
    order[..2].iter().for_each(|id| wide[*id] = true);
    // The bound is the growth with the first two maps. At most these two are chosen.
    let bound = growth(&bench.export(&wide));
    let some = choose(&job, &found, bound, |_| {}).unwrap();
    assert!(some.trials.len() <= 3 && growth(&some.export) <= bound, "{:?}", some.trials);
    for (index, id) in order.iter().enumerate() {
        assert_eq!(some.wide[*id], index + 1 < some.trials.len());
    }
    let text: serde_json::Value = serde_json::from_str(Model::new(&some.export.bytes).unwrap().text()).unwrap();
    assert_eq!(text["precision"], "chosen");
    let refused = choose(&job, &found, -50.0, |_| {}).unwrap_err().to_string();
    assert!(refused.contains("growth of the slope error of -50 % at most, found"), "{refused}");
}

#[test]
fn sensitivities_are_shown_by_their_size() {
    let bench = bench();
    let found = bench.sensitivity(&wide_by_rule(&bench.graph, MapBits::Mixed));
    let text = found.to_string();
    let place = |name: &str| text.find(&format!("\n{name} ")).unwrap_or_else(|| panic!("{name}: {text}"));
    let ranked = found.ranked();
    assert!(ranked.windows(2).all(|pair| place(&pair[0].name) < place(&pair[1].name)), "{text}");
    assert_eq!(costs(&found).unwrap().width(), 1000);
    let untrue = [CalibrationTile { ground: None, ..bench.tiles[0].clone() }];
    let wide = wide_by_rule(&bench.graph, MapBits::Mixed);
    let refused = SensitivityPlan::new(&bench.graph, &bench.ranges, bench.config.nr, &wide).measure(&untrue, |_| {});
    assert!(refused.unwrap_err().to_string().contains("expected tiles with truth"));
}

#[test]
fn a_plan_tells_what_the_runner_does() {
    let bench = bench();
    let made = bench.export(&wide_by_rule(&bench.graph, MapBits::Mixed));
    let model = Model::new(&made.bytes).unwrap();
    let mut plan = model::ModelFigures::of(&model);
    assert_eq!(plan.operators.iter().map(|line| line.macs).sum::<u64>(), model.macs());
    assert_eq!((plan.arena_bytes, plan.operators.len()), (required(&model), model.operator_count()));
    let tensors_end = plan.tensors.iter().map(|t| t.offset + t.bytes).max().unwrap();
    assert_eq!(tensors_end, model.scratch_offset());
    assert!(plan.live_peak_bytes <= tensors_end && plan.live_peak_bytes > tensors_end / 2);
    assert_eq!((plan.tensors[0].name.as_str(), plan.tensors[0].first_entry), ("image", 0));
    let last = plan.tensors.iter().map(|t| t.last_mac).max();
    assert_eq!(last, Some(model.macs()), "entries add up to the tile");
    let output = plan.operators.last().unwrap();
    assert_eq!((output.name.as_str(), output.shape, output.dtype), ("output", [TILE.0, TILE.1 / 8, 8], "f32"));
    let conv = plan.operators.iter().find(|line| line.name == "e1").unwrap();
    assert!(conv.weight_bytes > 0 && conv.rows_kept < conv.shape[0] && conv.margin == 2, "{conv:?}");

    for kernel in kernels::kernels() {
        plan.set_times(timing::measure(kernel, model, 1).unwrap());
        let shares: f64 = plan.operators.iter().map(|line| line.share.unwrap()).sum();
        assert!((shares - 1.0).abs() < 1e-9 && plan.operators.iter().all(|line| line.ms.unwrap() > 0.0));
        assert_eq!(plan.time.as_ref().unwrap().kernel, kernel.name());
    }
    let text = plan_text(&plan);
    assert!(text.contains("GMAC/s") && text.lines().count() == plan.operators.len() + 9, "{text}");
}

#[test]
fn memory_is_drawn_where_it_lies() {
    let bench = bench();
    let made = bench.export(&wide_by_rule(&bench.graph, MapBits::Mixed));
    let plan = model::ModelFigures::of(&Model::new(&made.bytes).unwrap());
    let drawn = arena(&plan).unwrap();
    let of = |colour: [u8; 3]| drawn.pixels().filter(|pixel| pixel.0 == colour).count() as f64;
    // The output's rectangle as a share of the plot, which is about 1299 x 701 pixels and 1.12 arenas high, minus the line on it.
    let output = plan.tensors.iter().find(|t| t.name == "output").unwrap();
    let wide = (output.last_mac - output.first_mac) as f64 / plan.macs as f64;
    let expected = 1299.0 * 701.0 * wide * output.bytes as f64 / (1.12 * plan.arena_bytes as f64);
    let found = of([222, 136, 146]);
    assert!((found / expected - 1.0).abs() < 0.05, "{found} {expected}");
}

#[test]
fn inspect_takes_models_apart_and_nothing_else() {
    let bench = bench();
    let made = bench.export(&wide_by_rule(&bench.graph, MapBits::Mixed));
    let shell = Shell::new();
    std::fs::write(shell.path("mini.eld"), &made.bytes).unwrap();
    std::fs::write(shell.path("points.csv"), "lon,lat,radius_km\n1,2,1737.5\n").unwrap();
    let text = shell.made(&["inspect", "mini.eld", "--time"]);
    assert!(text.contains(&format!("kernel {}", kernels::best().name())) && text.contains("share"), "{text}");
    let json: serde_json::Value =
        serde_json::from_str(&shell.made(&["inspect", "mini.eld", "--json", "--plan", "plan.png"])).unwrap();
    assert_eq!(json["operators"].as_array().unwrap().len(), made.program.operators.len());
    for key in ["macs", "weight_bytes", "activation_bytes", "rows_kept", "margin", "kind", "shape", "dtype"] {
        assert!(!json["operators"][0][key].is_null(), "{key}: {}", json["operators"][0]);
    }
    assert!(json["operators"][0]["ms"].is_null() && json["time"].is_null());
    assert!(image::open(shell.path("plan.png")).unwrap().width() > 1000);
    let before = shell.files();
    for (arguments, expected) in [
        (&["inspect", "points.csv", "--json"][..], "points.csv: expected a model (.eld)"),
        (&["inspect", "mini.eld", "--plan", "plan.jpg"], "plan.jpg: a name ending in .png expected"),
        (&["latency", "--model", "mini.eld", "--kernel", "abacus"], "--kernel: expected one of"),
    ] {
        let text = shell.refused(arguments);
        assert!(text.contains(expected), "{text}");
    }
    assert_eq!(shell.files(), before, "nothing was left behind");
}
