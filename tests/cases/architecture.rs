//! Checks rules for the whole repository: dependencies between packages, length of files, places of `unsafe`.

use elunar_tests::repository;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};
use std::process::Command;

/// The packages of this repository, each with the others that it may depend on, in any way (normal, build or test).
const EDGES: [(&str, &[&str]); 21] = [
    ("elunar-core", &[]),
    ("elunar-testing", &[]),
    ("elunar-base", &[]),
    ("elunar-raster", &["elunar-core", "elunar-testing", "elunar-base"]),
    ("elunar-synth", &["elunar-core", "elunar-base", "elunar-raster"]),
    ("elunar-net", &["elunar-core", "elunar-testing", "elunar-base", "elunar-synth"]),
    ("elunar-picture", &["elunar-core", "elunar-testing", "elunar-base", "elunar-raster"]),
    ("elunar-evaluate", &["elunar-core", "elunar-testing", "elunar-base", "elunar-raster", "elunar-picture"]),
    (
        "elunar-data",
        &[
            "elunar-core",
            "elunar-testing",
            "elunar-base",
            "elunar-raster",
            "elunar-synth",
            "elunar-net",
            "elunar-picture",
        ],
    ),
    (
        "elunar-scene",
        &[
            "elunar-core",
            "elunar-testing",
            "elunar-base",
            "elunar-raster",
            "elunar-synth",
            "elunar-net",
            "elunar-picture",
        ],
    ),
    ("elunar-learn", &["elunar-core", "elunar-base", "elunar-net", "elunar-picture", "elunar-data", "elunar-scene"]),
    (
        "elunar",
        &[
            "elunar-core",
            "elunar-testing",
            "elunar-base",
            "elunar-raster",
            "elunar-synth",
            "elunar-net",
            "elunar-picture",
            "elunar-evaluate",
            "elunar-data",
            "elunar-scene",
        ],
    ),
    (
        "host-train",
        &[
            "elunar-core",
            "elunar-testing",
            "elunar-base",
            "elunar-raster",
            "elunar-synth",
            "elunar-net",
            "elunar-picture",
            "elunar-evaluate",
            "elunar-data",
            "elunar-scene",
            "elunar-learn",
            "elunar",
        ],
    ),
    (
        "elunar-python",
        &["elunar-core", "elunar-base", "elunar-raster", "elunar-synth", "elunar-evaluate", "elunar-scene", "elunar"],
    ),
    ("elunar-web", &["elunar-core", "elunar-base", "elunar-raster", "elunar-synth", "elunar-scene", "elunar"]),
    ("elunar-capi", &["elunar-core"]),
    ("elunar-provoke", &["elunar-core", "elunar-capi"]),
    ("elunar-branches", &["elunar-core", "elunar-capi", "elunar-provoke"]),
    ("elunar-inject", &["elunar-core", "elunar-testing", "elunar-base", "elunar-raster", "elunar-picture"]),
    (
        "elunar-tests",
        &[
            "elunar-core",
            "elunar-testing",
            "elunar-base",
            "elunar-raster",
            "elunar-synth",
            "elunar-net",
            "elunar-data",
            "elunar-scene",
            "elunar-learn",
            "host-train",
            "elunar-provoke",
            "elunar-capi",
        ],
    ),
    (
        "elunar-benches",
        &["elunar-core", "elunar-base", "elunar-raster", "elunar-net", "elunar-scene", "elunar-learn", "elunar-capi"],
    ),
];

/// The foreign packages that a flight archive may contain. `heapless` is not needed: core has no list that grows, and every length comes
/// from the caller or the model file.
const FLIGHT_PACKAGES: [&str; 1] = ["libm"];

/// Largest number of lines of a source file.
const MAX_LINES: usize = 600;

/// Places where `unsafe` is allowed: kernels and their choice, the C boundary, the programs' allocator, the start-up code of boards, functions that tools find by
/// name, and tests and benchmarks that count allocations or call C.
const UNSAFE_ALLOWED: [&str; 19] = [
    "core/src/nn/dispatch/",
    "core/src/nn/kernels/",
    "core/src/nn/tests/kernels.rs",
    "host-train/elunar/src/memory.rs",
    "host-train/net/src/kernels.rs",
    "onboard/capi/src/ffi",
    "onboard/embassy/src/",
    "onboard/capi/tests/",
    "onboard/flight/demo/src/arch/",
    "onboard/flight/demo/src/c_calls.rs",
    "onboard/flight/demo/src/c_lines.rs",
    "onboard/flight/demo/src/c_slots.rs",
    "onboard/flight/demo/src/inject.rs",
    "onboard/flight/demo/src/calls.rs",
    "onboard/flight/demo/src/mark.rs",
    "onboard/flight/demo/src/provoke.rs",
    "onboard/flight/staticlib/src/proof.rs",
    "tests/",
    "benches/",
];

/// Where the ground's programs open files for reading: inputs in the first, their own locks and rows in the others.
const READING_ALLOWED: [&str; 3] =
    ["host-train/base/src/read.rs", "host-train/base/src/output/", "host-train/testing/"];

/// Runs `cargo tree` and returns (depth, package) per line.
fn tree(arguments: &[&str]) -> Vec<(usize, String)> {
    let out = Command::new(env!("CARGO"))
        .args(["tree", "--offline", "--locked", "--prefix", "depth", "--format", " {p}"])
        .args(arguments)
        .current_dir(repository())
        .output()
        .unwrap();
    assert!(out.status.success(), "cargo tree {arguments:?}: {}", String::from_utf8_lossy(&out.stderr));
    parse(&String::from_utf8(out.stdout).unwrap())
}

fn parse(text: &str) -> Vec<(usize, String)> {
    let line = |line: &str| {
        let mut words = line.split_whitespace();
        Some((words.next()?.parse().ok()?, words.next()?.to_string()))
    };
    text.lines().filter_map(line).collect()
}

/// Returns the edges between our packages that [`EDGES`] does not list, and our packages that it does not contain.
fn forbidden_edges(tree: &[(usize, String)], ours: &BTreeSet<String>) -> Vec<String> {
    let allowed: BTreeMap<&str, &[&str]> = EDGES.into_iter().collect();
    let mut found = Vec::new();
    let mut root = "";
    for (depth, package) in tree {
        if *depth == 0 {
            root = package;
            if !allowed.contains_key(root) {
                found.push(format!("{root} is not in the list of packages"));
            }
        } else if ours.contains(package) && !allowed.get(root).is_some_and(|a| a.contains(&package.as_str())) {
            found.push(format!("{root} -> {package}"));
        }
    }
    found
}

/// Returns the foreign packages below `root` that are not in [`FLIGHT_PACKAGES`].
fn foreign(tree: &[(usize, String)], ours: &BTreeSet<String>) -> Vec<String> {
    let names: BTreeSet<&String> = tree.iter().map(|(_, package)| package).collect();
    let flies = |p: &String| ours.contains(p) || FLIGHT_PACKAGES.contains(&p.as_str());
    names.into_iter().filter(|p| !flies(p)).cloned().collect()
}

fn ours() -> BTreeSet<String> {
    let found: BTreeSet<String> =
        tree(&["--workspace", "--depth", "0"]).into_iter().map(|(_, package)| package).collect();
    let listed: BTreeSet<String> = EDGES.iter().map(|(package, _)| (*package).to_string()).collect();
    assert_eq!(found, listed, "the list of packages is out of date");
    found
}

#[test]
fn dependencies_point_one_way() {
    let edges = tree(&["--workspace", "--depth", "1", "--no-dedupe", "--edges", "normal,build,dev"]);
    assert!(edges.len() > 20, "cargo tree found only {edges:?}");
    assert_eq!(forbidden_edges(&edges, &ours()), [""; 0]);
}

#[test]
fn what_flies_is_core_and_libm() {
    let ours = ours();
    let direct = tree(&["--package", "elunar-core", "--edges", "normal", "--depth", "1"]);
    let direct: Vec<&str> =
        direct.iter().filter(|(depth, _)| *depth == 1).map(|(_, package)| package.as_str()).collect();
    assert_eq!(direct, ["libm"], "direct dependencies of core");

    for package in ["elunar-core", "elunar-capi"] {
        let whole = tree(&["--package", package, "--edges", "normal,build"]);
        assert_eq!(foreign(&whole, &ours), [""; 0], "below {package}");
        assert!(!whole.iter().any(|(_, p)| p == "host-train"), "{package} meets host-train");
    }
    let host = tree(&["--package", "host-train", "--edges", "normal,build"]);
    assert!(!host.iter().any(|(_, p)| p == "elunar-testing"), "what only tests need is linked into host-train");
    let host = tree(&["--package", "host-train", "--edges", "normal,build,dev"]);
    assert!(host.iter().any(|(_, p)| p == "elunar-core") && !host.iter().any(|(_, p)| p == "elunar-capi"));
}

#[test]
fn only_learn_and_what_stands_on_it_is_built_with_burn() {
    let has_burn = |package: &str| {
        let whole = tree(&["--package", package, "--edges", "normal,build,dev"]);
        whole.iter().any(|(_, package)| package == "burn" || package.starts_with("burn-"))
    };
    assert!(has_burn("elunar-learn") && has_burn("host-train"));
    for package in
        ["elunar-base", "elunar-raster", "elunar-synth", "elunar-net", "elunar-scene", "elunar", "elunar-python"]
    {
        assert!(!has_burn(package), "{package} is built with Burn");
    }
    let direct = tree(&["--package", "host-train", "--edges", "normal,build", "--depth", "1"]);
    assert!(!direct.iter().any(|(_, package)| package.starts_with("burn")), "host-train names Burn itself: {direct:?}");
}

/// Networks are compiled without a reader of rasters. Its tests may use one.
#[test]
fn net_does_not_reach_raster() {
    let reaches = |package: &str, other: &str| {
        let whole = tree(&["--package", package, "--edges", "normal,build"]);
        whole.iter().any(|(_, package)| package == other)
    };
    for other in ["elunar-raster", "tiff"] {
        assert!(reaches("elunar-scene", other) && !reaches("elunar-net", other), "elunar-net is built with {other}");
    }
}

#[test]
fn the_flight_workspace_flies_nothing_else() {
    let mut known = ours();
    known.insert("elunar-staticlib".into());
    let whole = tree(&["--manifest-path", "onboard/flight/Cargo.toml", "--edges", "normal,build"]);
    assert_eq!(foreign(&whole, &known), [""; 0]);
    let packages: BTreeSet<&str> = whole.iter().map(|(_, p)| p.as_str()).collect();
    assert!(packages.contains("elunar-capi") && !packages.contains("host-train"));
}

/// What a command of Cargo compiles: for every step a hash of all that it depends on, and its name and features. By Cargo's own plan, which only
/// unstable options print.
fn compiled(arguments: &[&str]) -> BTreeMap<u64, String> {
    let out = Command::new(env!("CARGO"))
        .args(arguments)
        .args(["--offline", "--locked", "--unit-graph", "-Z", "unstable-options"])
        .env("RUSTC_BOOTSTRAP", "1")
        .current_dir(repository())
        .output()
        .unwrap();
    assert!(out.status.success(), "cargo {arguments:?}: {}", String::from_utf8_lossy(&out.stderr));
    let plan: Value = serde_json::from_slice(&out.stdout).unwrap();
    let steps = plan["units"].as_array().unwrap();
    let mut hashes = vec![None; steps.len()];
    (0..steps.len()).map(|i| (hash(steps, i, &mut hashes), name(&steps[i]))).collect()
}

/// Returns package, target and features of a step.
fn name(step: &Value) -> String {
    let package = step["pkg_id"].as_str().unwrap().rsplit('/').next().unwrap();
    let features: Vec<&str> = step["features"].as_array().unwrap().iter().map(|f| f.as_str().unwrap()).collect();
    format!("{package} {} {}", step["target"]["name"].as_str().unwrap(), features.join(","))
}

/// Returns a hash of a step and of all that it depends on.
fn hash(steps: &[Value], i: usize, known: &mut [Option<u64>]) -> u64 {
    if let Some(hash) = known[i] {
        return hash;
    }
    let step = &steps[i];
    // `dev` and `test` are the same settings under two names.
    let mut profile = step["profile"].clone();
    profile["name"] = Value::Null;
    let dependencies = step["dependencies"].as_array().unwrap().iter();
    let mut all: Vec<u64> = dependencies.map(|d| hash(steps, d["index"].as_u64().unwrap() as usize, known)).collect();
    all.sort_unstable();
    let mut hasher = DefaultHasher::new();
    let settings = [&profile, &step["mode"], &step["target"]["kind"], &step["platform"]].map(Value::to_string);
    (name(step), settings, all).hash(&mut hasher);
    known[i] = Some(hasher.finish());
    hasher.finish()
}

#[test]
fn running_and_testing_share_one_build_of_the_dependencies() {
    let tested = compiled(&["test", "--workspace", "--no-run"]);
    let apart = |run: &BTreeMap<u64, String>| -> Vec<String> {
        run.iter().filter(|(hash, _)| !tested.contains_key(hash)).map(|(_, name)| name.clone()).collect()
    };
    let run = compiled(&["build", "--package", "host-train"]);
    assert!(run.values().any(|name| name.starts_with("crates.io-index#burn-core@")) && run.len() > 300, "{run:?}");
    assert_eq!(apart(&run), [""; 0], "compiled once more: see the last dependencies in host-train/learn/Cargo.toml");
    // Burn is slow to build, so testing `learn` alone must not build it again. Our own crates may differ in features.
    let learn = apart(&compiled(&["test", "--package", "elunar-learn", "--no-run"]));
    let foreign: Vec<&String> = learn.iter().filter(|name| name.starts_with("crates.io-index#")).collect();
    assert_eq!(foreign, [""; 0], "compiled once more by `cargo test -p elunar-learn`");
}

#[test]
fn a_forbidden_edge_is_noticed() {
    let ours = ours();
    let tree =
        parse("0 elunar-core v0.1.0 (/x)\n1 libm v0.2.1\n1 host-train v0.1.0\n0 newcomer v0.1.0\n1 elunar-core v1\n");
    let expected = ["elunar-core -> host-train", "newcomer is not in the list of packages", "newcomer -> elunar-core"];
    assert_eq!(forbidden_edges(&tree, &ours), expected);
    assert_eq!(foreign(&parse("0 elunar-core v1\n1 libm v0.2\n1 rand v0.9\n"), &ours), ["rand"]);
}

/// Returns every Rust file of the repository, with its path relative to the root.
fn sources() -> Vec<(String, String)> {
    let root = repository();
    let mut found = Vec::new();
    let mut folders: Vec<PathBuf> =
        ["core", "host-train", "onboard", "tests", "benches"].iter().map(|f| root.join(f)).collect();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                if path.file_name().is_some_and(|name| name != "target") {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|e| e == "rs") {
                let name = relative(&path, &root);
                found.push((name, std::fs::read_to_string(&path).unwrap()));
            }
        }
    }
    assert!(found.len() > 30, "found only {} source files", found.len());
    found
}

fn relative(path: &Path, root: &Path) -> String {
    path.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/")
}

/// Returns whether a line of code, without comments, contains the word `unsafe`.
fn says_unsafe(line: &str) -> bool {
    let code = line.split("//").next().unwrap_or_default();
    code.split(|c: char| !(c.is_alphanumeric() || c == '_')).any(|word| word == "unsafe")
}

#[test]
fn no_source_file_is_too_long() {
    let long: Vec<String> = sources()
        .into_iter()
        .map(|(name, text)| (name, text.lines().count()))
        .filter(|(_, lines)| *lines > MAX_LINES)
        .map(|(name, lines)| format!("{name}: {lines} lines"))
        .collect();
    assert_eq!(long, [""; 0], "more than {MAX_LINES} lines");
}

/// The test runner hides what a passing test prints with `println!` and `eprintln!`.
#[test]
fn a_skipped_check_is_shown_by_the_terminal() {
    let shown_by_a_program = ["benches/", "host-train/src/cli/suite.rs"];
    let hidden: Vec<String> = sources()
        .into_iter()
        .filter(|(name, _)| !shown_by_a_program.iter().any(|place| name.starts_with(place)))
        .flat_map(|(name, text)| {
            text.lines()
                .filter(|l| l.contains(concat!("println!(\"", "SKIPPED")))
                .map(|l| format!("{name}: {}", l.trim()))
                .collect::<Vec<_>>()
        })
        .collect();
    assert_eq!(hidden, [""; 0], "use elunar_testing::skipped");
}

#[test]
fn unsafe_stays_in_its_rooms() {
    assert!(says_unsafe("    unsafe { x }") && !says_unsafe("#![deny(unsafe_code)] // unsafe"));
    let outside: Vec<String> = sources()
        .into_iter()
        .filter(|(name, _)| !UNSAFE_ALLOWED.iter().any(|room| name.starts_with(room)))
        .filter(|(_, text)| text.lines().any(says_unsafe))
        .map(|(name, _)| name)
        .collect();
    assert_eq!(outside, [""; 0], "`unsafe` outside {UNSAFE_ALLOWED:?}");
}

/// A reader that is not bounded, or opens what is no file, takes all memory or waits for ever.
#[test]
fn inputs_are_opened_in_one_place() {
    let opens = |line: &str| {
        // A type of our own.
        let line = line.replace("ShardFile::open(", "");
        ["File::open(", "fs::read(", "fs::read_to_string("].iter().any(|call| line.contains(call))
    };
    let outside: Vec<String> = sources()
        .into_iter()
        .filter(|(name, _)| name.starts_with("host-train/") && name.contains("/src/") && !name.contains("tests"))
        .filter(|(name, _)| !READING_ALLOWED.iter().any(|place| name.starts_with(place)))
        .filter(|(_, text)| {
            let code = text.split("#[cfg(test)]\nmod").next().unwrap_or_default();
            code.lines().filter(|line| !line.trim_start().starts_with("//")).any(opens)
        })
        .map(|(name, _)| name)
        .collect();
    assert!(opens("File::open(path)") && outside.is_empty(), "{outside:?}: use elunar_base::read");
}
