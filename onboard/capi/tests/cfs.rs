//! The cFS application of `onboard/cfs`: it compiles with stubs of cFE's headers, and on a bus for tests it computes the same results as
//! Rust. Neither the stubs nor the bus are cFE: see `onboard/cfs/README.md`.

mod cc;
mod common;
use cc::*;
use common::*;
use std::path::PathBuf;
use std::process::Command;

fn cfs(name: &str) -> PathBuf {
    repository().join("onboard/cfs").join(name)
}

/// Returns the sources of the application, its table, and the service that it shares with the guides.
fn sources() -> Vec<PathBuf> {
    let files = |folder: &str| std::fs::read_dir(cfs(folder)).unwrap().map(|entry| entry.unwrap().path());
    let mut all: Vec<PathBuf> =
        files("fsw/src").chain(files("fsw/tables")).filter(|path| path.extension().is_some_and(|e| e == "c")).collect();
    all.sort();
    assert_eq!(all.len(), 6, "{all:?}");
    all.push(repository().join("onboard/capi/examples/service.c"));
    all
}

fn includes() -> Vec<String> {
    let folders = [cfs("fsw/inc"), cfs("fsw/src"), cfs("test/stubs"), repository().join("onboard/capi/examples")];
    folders.iter().flat_map(|folder| ["-I".to_string(), folder.display().to_string()]).collect()
}

/// Returns the numbers of classified pixels and of hazards, by slope and roughness as `elunar_app_hazard.c` describes them, with the
/// table's limits.
fn hazards(heights_m: &[f32], valid: &[u8]) -> (usize, usize) {
    let (max_slope, max_roughness_m, pixel_m) = (0.2679f32, 0.5f32, 2.0f32);
    let (mut classified, mut found) = (0, 0);
    for at in (1..ROWS - 1).flat_map(|row| (1..COLS - 1).map(move |col| row * COLS + col)) {
        let cross = [at, at - 1, at + 1, at - COLS, at + COLS];
        if cross.iter().all(|i| valid[*i] == 1) {
            let [z, left, right, above, below] = cross.map(|i| heights_m[i]);
            let (dx, dy) = ((right - left) / (2.0 * pixel_m), (below - above) / (2.0 * pixel_m));
            let rough = z - 0.25 * (left + right + above + below);
            classified += 1;
            found += usize::from(dx * dx + dy * dy > max_slope * max_slope || rough.abs() > max_roughness_m);
        }
    }
    (classified, found)
}

#[test]
fn the_application_computes_what_rust_computes() {
    if !exists("c99") {
        return;
    }
    let folder = folder("cfs");
    let model = repository().join("host-train/models/nano.eld");
    let tile = repository().join("tests/golden/flight_tile");
    // Paths in commands must be short.
    for (from, to) in [(tile.join("image.f32"), "image.f32"), (tile.join("coarse_m.f32"), "coarse_m.f32")] {
        std::fs::copy(from, folder.join(to)).unwrap();
    }
    let (archive, libraries) = archive();
    let program = folder.join("bus");
    run(compiler("c99")
        .args(includes())
        .arg("-O1")
        // The model is in the repository, at another path than in cFS.
        .arg(format!("-DELUNAR_APP_MODEL_FILE=\"{}\"", model.display()))
        .args(sources())
        .arg(cfs("test/bus.c"))
        .args(["-x", "none"])
        .arg(archive)
        .args(libraries)
        .arg("-o")
        .arg(&program));
    let said = run(Command::new(&program).current_dir(&folder).args(["image.f32", "coarse_m.f32", "out.f32"]));
    println!("{said}");

    let golden = Tile { valid: None, ..Tile::golden() };
    let (heights_m, valid) = golden.expected();
    let expected: Vec<u8> = heights_m.iter().flat_map(|v| v.to_ne_bytes()).chain(valid.iter().copied()).collect();
    assert!(std::fs::read(folder.join("out.f32")).unwrap() == expected, "other bytes than Rust's");

    // The ids of all events of the script, in their order.
    let ids: Vec<u32> =
        said.lines().filter_map(|line| line.strip_prefix("event ")?.split_once(' ')?.0.parse().ok()).collect();
    assert_eq!(ids, [1, 2, 6, 5, 4, 15, 18, 9, 16, 12, 13, 6, 11, 19, 18, 17, 18, 8, 3]);
    let (classified, found) = hazards(&heights_m, &valid);
    assert!(found > 0 && found < classified, "{found} of {classified}: nothing is shown");
    let packets: Vec<&str> = said.lines().filter(|line| line.starts_with("hk ")).collect();
    let counted =
        format!("tiles 2 written 1 dropped 0 classified {classified} hazards {found} scrub passes 0 faults 0 status");
    assert!(packets[0].starts_with(&format!("hk commands 2 errors 5 state 3 {counted}")), "{}", packets[0]);
    let counted = format!("tiles 4 written 1 dropped 0 classified {classified} hazards {found}");
    assert!(packets[1].starts_with(&format!("hk commands 4 errors 6 state 3 {counted}")), "{}", packets[1]);
    assert!(
        packets[2].starts_with("hk commands 0 errors 0 state 3 ")
            && packets[2].ends_with(" faults 1 status 0x00000000"),
        "{}",
        packets[2]
    );
    assert!(said.contains("19 events, 3 packets, table released"), "{said}");
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Runs the script for real cFS trees on a tree of stubs: it finds the headers, and refuses a folder without them.
#[test]
fn the_script_compiles_against_a_tree_and_wants_one() {
    if !exists("c99") {
        return;
    }
    let script = |tree: PathBuf| Command::new(cfs("check.sh")).arg(tree).env("CFLAGS", "-pedantic").output().unwrap();
    let found = script(cfs("test/stubs"));
    assert!(found.status.success(), "{}", String::from_utf8_lossy(&found.stderr));
    let refused = script(cfs("fsw"));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(!refused.status.success() && said.starts_with("ERROR: ") && said.lines().count() == 1, "{said}");
}

/// Numbers of events and commands are unique, and `README.md` lists them.
#[test]
fn events_and_commands_are_listed() {
    let readme = std::fs::read_to_string(cfs("README.md")).unwrap();
    for (file, suffix, least) in [("fsw/inc/elunar_app_eventids.h", "_EID", 20), ("fsw/inc/elunar_app_msg.h", "_CC", 5)]
    {
        let text = std::fs::read_to_string(cfs(file)).unwrap();
        let defined: Vec<(&str, u32)> = text
            .lines()
            .filter_map(|line| line.strip_prefix("#define ELUNAR_APP_"))
            .filter_map(|line| {
                let mut words = line.split_whitespace();
                Some((words.next()?.strip_suffix(suffix)?, words.next()?.parse().ok()?))
            })
            .collect();
        assert_eq!(defined.len(), least, "{file}: {defined:?}");
        for (i, (name, number)) in defined.iter().enumerate() {
            assert!(!defined[..i].iter().any(|(_, other)| other == number), "{name}: {number} twice");
            assert!(readme.contains(&format!("| {number} | `{name}` |")), "{name}, {number}: not in README.md");
        }
    }
}
