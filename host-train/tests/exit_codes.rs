//! The exit codes of the commands that only this program has. Those that it shares with `elunar` are tested there.

use elunar_testing::exit_codes::{Called, check};
use std::path::Path;

/// Commands that `elunar` has, too.
const SHARED: [&str; 19] = [
    "predict",
    "join",
    "latency",
    "manifest",
    "batch",
    "status",
    "plan",
    "synth",
    "prepare",
    "export",
    "sfs",
    "evaluate",
    "hillshade",
    "render",
    "diff",
    "mosaic",
    "lola",
    "inspect",
    "sun",
];

#[test]
fn every_command_ends_with_the_documented_code() {
    let out = Some("out/owner.lock");
    let called = |words, code, lock| Called { words, code, lock };
    let commands = [
        called(&["demo", "--out", "out"], None, out),
        called(&["init", "--preset", "nano", "-o", "out.safetensors"], None, Some("out.safetensors.lock")),
        called(&["check", "no.safetensors"], Some(65), None),
        called(&["train", "--data", "no", "--out", "out"], Some(65), None),
        called(
            &["average", "no.safetensors", "no2.safetensors", "-o", "out.safetensors"],
            Some(65),
            Some("out.safetensors.lock"),
        ),
        called(&["experiment", "no.toml", "--out", "out"], Some(65), None),
        called(&["suite", "--suite", "no.toml", "--out", "out"], Some(65), None),
        called(&["report", "no", "-o", "out.html"], Some(65), Some("out.html.lock")),
        called(&["faults", "no.eld", "--out", "out"], Some(65), None),
        called(&["train-speed", "--start-from", "no.safetensors"], Some(65), None),
        called(&["devices"], None, None),
    ];
    check(Path::new(env!("CARGO_BIN_EXE_host-train")), &commands, &SHARED);
}
