//! The cFS application of `onboard/cfs`: it compiles with stubs of cFE's headers, and on a bus for tests it computes the same results as
//! Rust. Neither the stubs nor the bus are cFE: see `onboard/cfs/README.md`.

mod cc;
mod common;
use cc::*;
use common::*;
use elunar_core::terrain::{HazardLimits, LineMaps, LineOptions, PixelSize, Sun, TerrainLines, hazard};
use std::path::{Path, PathBuf};
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
    assert_eq!(all.len(), 7, "{all:?}");
    all.push(repository().join("onboard/capi/examples/service.c"));
    all
}

/// Builds the application with the bus of `test/bus.c` in a folder. Its model's slots are `model.eld` and `model2.eld` in the folder where it runs.
fn bus(folder: &Path) -> PathBuf {
    // As a mission's build does: a header for every default of the configuration.
    let headers = folder.join("inc");
    std::fs::create_dir_all(&headers).unwrap();
    for entry in std::fs::read_dir(cfs("config")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().strip_prefix("default_").unwrap().to_string();
        std::fs::write(headers.join(name), format!("#include \"{}\"\n", path.display())).unwrap();
    }
    let examples = repository().join("onboard/capi/examples");
    let includes = [cfs("fsw/inc"), cfs("fsw/src"), headers, cfs("test/stubs"), examples];
    let (archive, libraries) = archive();
    let program = folder.join("bus");
    run(compiler("c99")
        .args(includes.iter().flat_map(|folder| ["-I".to_string(), folder.display().to_string()]))
        .arg("-O1")
        .args(["-DELUNAR_APP_MODEL_FILE=\"model.eld\"", "-DELUNAR_APP_MODEL_FILE_2=\"model2.eld\""])
        .args(sources())
        .arg(cfs("test/bus.c"))
        .args(["-x", "none"])
        .arg(archive)
        .args(libraries)
        .arg("-o")
        .arg(&program));
    program
}

/// Returns the ids and texts of all events that the bus printed, in their order.
fn events(said: &str) -> Vec<(u32, &str)> {
    said.lines()
        .filter_map(|line| line.strip_prefix("event ")?.split_once(": "))
        .map(|(head, text)| (head.split(' ').next().unwrap().parse().unwrap(), text))
        .collect()
}

/// Returns a field of housekeeping packet `at`, by its name in `elunar_app_msgdefs.h`: what `tools/ground.py` decodes.
fn decoded(said: &str, at: usize) -> Option<Vec<(String, u64)>> {
    let packet = said.lines().filter_map(|line| line.strip_prefix("packet ")).nth(at).unwrap();
    let out = match Command::new("python3").arg(cfs("tools/ground.py")).args(["decode", packet]).output() {
        Ok(out) => out,
        Err(error) => {
            absent(&format!("the ground program of cFS: python3: {error} (Debian package python3)"));
            return None;
        }
    };
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
    let text = String::from_utf8(out.stdout).unwrap();
    Some(
        text.lines()
            .filter_map(|line| line.split_once(' '))
            .filter_map(|(name, value)| Some((name.to_string(), value.parse().ok()?)))
            .collect(),
    )
}

/// Returns the numbers of classified pixels and of hazards by the core, with the table's limits.
fn hazards(heights_m: &[f32], valid: &[u8]) -> (usize, usize) {
    let known = heights_m.iter().zip(valid).map(|(z, valid)| if *valid == 1 { *z } else { f32::NAN });
    let heights_m: Vec<f32> = known.collect();
    let (pixel, limits) = (PixelSize::square(2.0), HazardLimits::new(15.0, 0.5).unwrap());
    let options = LineOptions { cols: COLS, pixel, radius_px: 1, sun: Sun::default(), limits };
    let mut memory = vec![0.0; options.memory_len()];
    let mut terrain = TerrainLines::new(options, &mut memory).unwrap();
    let (mut classified, mut found, mut hazard) = (0, 0, [0; COLS]);
    let mut count = |hazard: &[u8; COLS]| {
        classified += hazard.iter().filter(|hazard| **hazard & hazard::UNKNOWN == 0).count();
        found += hazard.iter().filter(|hazard| **hazard != 0 && **hazard & hazard::UNKNOWN == 0).count();
    };
    for line in heights_m.chunks(COLS) {
        let mut maps = LineMaps { hazard: &mut hazard, ..LineMaps::default() };
        if terrain.push(line, &mut maps).unwrap().is_some() {
            count(&hazard);
        }
    }
    while terrain.finish(&mut LineMaps { hazard: &mut hazard, ..LineMaps::default() }).unwrap().is_some() {
        count(&hazard);
    }
    (classified, found)
}

#[test]
fn the_application_computes_what_rust_computes() {
    if !exists("c99") {
        return;
    }
    let folder = folder("cfs");
    std::fs::copy(repository().join("host-train/models/nano.eld"), folder.join("model.eld")).unwrap();
    let tile = repository().join("tests/golden/flight_tile");
    // Paths in commands must be short.
    for (from, to) in [(tile.join("image.f32"), "image.f32"), (tile.join("coarse_m.f32"), "coarse_m.f32")] {
        std::fs::copy(from, folder.join(to)).unwrap();
    }
    let program = bus(&folder);
    let said = run(Command::new(&program).current_dir(&folder).args(["image.f32", "coarse_m.f32", "out.f32"]));
    println!("{said}");

    let golden = Tile { valid: None, ..Tile::golden() };
    let (heights_m, valid) = golden.expected();
    let expected: Vec<u8> = heights_m.iter().flat_map(|v| v.to_ne_bytes()).chain(valid.iter().copied()).collect();
    assert!(std::fs::read(folder.join("out.f32")).unwrap() == expected, "other bytes than Rust's");

    let events = events(&said);
    let ids: Vec<u32> = events.iter().map(|event| event.0).collect();
    assert_eq!(ids, [1, 2, 6, 5, 4, 15, 18, 9, 16, 12, 13, 6, 11, 19, 18, 17, 18, 8, 3]);
    let kernel = said.lines().next().unwrap();
    let started = events[0].1;
    assert!(started.starts_with("ELUNAR: model 0x") && started.contains(" from slot 1, "), "{started}");
    assert!(kernel.starts_with("kernel ") && started.ends_with(kernel), "{started}");
    if let Some(fields) = decoded(&said, 1) {
        let value = |name: &str| fields.iter().find(|field| field.0 == name).map(|field| field.1);
        for (name, expected) in
            [("CommandCounter", 4), ("ModelSlot", 1), ("RetryWakeups", 0), ("Tiles", 4), ("TilesWritten", 1)]
        {
            assert_eq!(value(name), Some(expected), "{name}: {fields:?}");
        }
        assert_eq!(value("ClassifiedPx"), Some(hazards(&heights_m, &valid).0 as u64));
    }
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

/// Without a model the application says why, tries ever more seldom, and tries at once after RESET_COUNTERS, which also lets events pass again.
/// A second copy of the model replaces the first, also if that one turns out to be damaged.
#[test]
fn a_missing_model_is_told_and_tried_ever_more_seldom() {
    if !exists("c99") {
        return;
    }
    let folder = folder("cfs-without");
    let program = bus(&folder);
    let mut model = std::fs::read(repository().join("host-train/models/nano.eld")).unwrap();
    std::fs::write(folder.join("spare.eld"), &model).unwrap();
    model[3_000_000] ^= 1;
    std::fs::write(folder.join("damaged.eld"), &model).unwrap();
    let said = run(Command::new(&program).current_dir(&folder));
    println!("{said}");
    let opened: Vec<&str> = said.lines().filter_map(|line| line.strip_prefix("opened ")).collect();
    // 2 + 4 + ... + 512 wakeups hold ten tries, and 1000 each three more.
    assert_eq!(
        opened,
        [
            "1 and 1 times at the start",
            "13 and 13 times in 4000 wakeups",
            "1 and 1 times after a reset",
            "2 and 2 times after damage"
        ]
    );
    let events = events(&said);
    let started = events.iter().find(|event| event.0 == 1).unwrap().1;
    assert!(started.starts_with("ELUNAR: no model: slot 1: cannot be opened; library 2."), "{started}");
    assert!(said.contains("\nevent 1 type 3: "), "{said}");
    // Of 28 events about files before the reset sixteen pass, and the next two after it.
    let reset = events.iter().position(|event| event.0 == 3).unwrap();
    let files = |part: &[(u32, &str)]| part.iter().filter(|event| event.0 == 9).count();
    assert_eq!((files(&events[..reset]), files(&events[reset..reset + 3])), (16, 2), "{events:?}");
    let loaded: Vec<&str> = events.iter().filter(|event| event.0 == 19).map(|event| event.1).collect();
    assert!(loaded[0].starts_with("ELUNAR: model 0x") && loaded[0].ends_with(" loaded from slot 2"), "{loaded:?}");
    assert_eq!(loaded[1..], ["ELUNAR: model loaded again from slot 2"]);
    let refused = events.iter().filter(|event| event.0 == 11 && event.1.starts_with("ELUNAR: 0x80030006: ")).count();
    assert_eq!(refused, 2, "the model of slot 1, before and after the damage");
    for (at, state, slot, waits) in [(0, 0, 0, true), (1, 3, 2, false), (2, 3, 2, false)] {
        let Some(fields) = decoded(&said, at) else { break };
        let value = |name: &str| fields.iter().find(|field| field.0 == name).unwrap().1;
        assert_eq!((value("State"), value("ModelSlot"), value("RetryWakeups") > 0), (state, slot, waits), "{fields:?}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Every counter that the library reports is in housekeeping.
#[test]
fn housekeeping_has_all_counters_of_the_library() {
    let header = std::fs::read_to_string(repository().join("onboard/capi/include/elunar.h")).unwrap();
    let end = header.find("} eld_telemetry_t;").unwrap();
    let structure = &header[header[..end].rfind("typedef struct {").unwrap()..end];
    let sent = std::fs::read_to_string(cfs("fsw/src/elunar_app_dispatch.c")).unwrap();
    let fields: Vec<&str> = structure
        .lines()
        .filter_map(|line| line.trim().strip_suffix(';')?.split_once(' ').map(|found| found.1))
        .collect();
    assert!(fields.len() > 15, "{fields:?}");
    for field in fields.iter().filter(|field| **field != "struct_bytes") {
        assert!(sent.contains(&format!("Counters.{field};")), "{field}: not in housekeeping");
    }
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
    // cFE 7 has a header of the processor in a folder where no other header is that is searched for.
    let tree = folder("cfs-tree");
    for part in ["cfe", "psp"] {
        std::fs::create_dir_all(tree.join(part)).unwrap();
    }
    for entry in std::fs::read_dir(cfs("test/stubs")).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        let more = if path.ends_with("cfe.h") { "#include \"pspconfig.h\"\n" } else { "" };
        std::fs::write(tree.join("cfe").join(path.file_name().unwrap()), text + more).unwrap();
    }
    std::fs::write(tree.join("psp/pspconfig.h"), "").unwrap();
    let found = script(tree.clone());
    assert!(found.status.success(), "{}", String::from_utf8_lossy(&found.stderr));
    std::fs::remove_dir_all(&tree).unwrap();
    // A tree without cFE, into which this folder is linked as into a mission's: the stubs are not taken for cFE.
    let linked = folder("cfs-linked");
    std::fs::create_dir_all(linked.join("apps")).unwrap();
    std::os::unix::fs::symlink(cfs(""), linked.join("apps/elunar_app")).unwrap();
    for tree in [cfs("fsw"), linked.clone()] {
        let refused = script(tree);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert!(!refused.status.success() && said.starts_with("ERROR: ") && said.lines().count() == 1, "{said}");
    }
    std::fs::remove_dir_all(&linked).unwrap();
}

/// Numbers of events and commands are unique. Each has its meaning beside it, and `README.md` lists the commands.
#[test]
fn events_and_commands_are_listed() {
    let readme = std::fs::read_to_string(cfs("README.md")).unwrap();
    for (file, suffix, least) in
        [("fsw/inc/elunar_app_eventids.h", "_EID", 20), ("config/default_elunar_app_fcncodes.h", "_CC", 5)]
    {
        let text = std::fs::read_to_string(cfs(file)).unwrap();
        let defined: Vec<(&str, u32)> = text
            .lines()
            .filter_map(|line| line.strip_prefix("#define ELUNAR_APP_"))
            .filter(|line| line.ends_with(" */"))
            .filter_map(|line| {
                let mut words = line.split_whitespace();
                Some((words.next()?.strip_suffix(suffix)?, words.next()?.parse().ok()?))
            })
            .collect();
        assert_eq!(defined.len(), least, "{file}: {defined:?}");
        for (i, (name, number)) in defined.iter().enumerate() {
            assert!(!defined[..i].iter().any(|(_, other)| other == number), "{name}: {number} twice");
            let listed = suffix == "_EID" || readme.contains(&format!("| {number} | `{name}` |"));
            assert!(listed, "{name}, {number}: not in README.md");
        }
    }
}
