//! The code of `onboard/docs/integration.md` compiles, and the super-loop and the service compute the same heights as Rust, also with
//! faults.

mod cc;
mod common;
use cc::*;
use common::*;
use elunar_capi::status::*;
use elunar_core::nn::file::{set_word, word};
use std::path::{Path, PathBuf};
use std::process::Command;

fn example(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples").join(name)
}

/// Returns the golden tile's heights and validity, as bytes.
fn golden() -> (Vec<u8>, Vec<u8>) {
    let (heights_m, valid) = Tile::golden().expected();
    (heights_m.iter().flat_map(|v| v.to_ne_bytes()).collect(), valid)
}

/// Builds a guide with the examples and the test programs.
fn build_guide(sources: &[PathBuf], language: &str, folder: &Path) -> PathBuf {
    // All files are copied to one folder, where the compiler finds their headers first.
    for from in ["examples", "tests/c"] {
        for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join(from)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|e| e == "h" || e == "c") {
                std::fs::copy(&path, folder.join(path.file_name().unwrap())).unwrap();
            }
        }
    }
    let beside: Vec<PathBuf> = sources.iter().map(|source| folder.join(source.file_name().unwrap())).collect();
    build(&beside, language, folder)
}

#[test]
fn the_super_loop_computes_what_rust_computes() {
    let folder = folder("super_loop");
    let (heights, valid) = golden();
    let expected = [heights.clone(), valid.clone(), heights, valid].concat();
    let sources = ["super_loop.c", "duty.c", "service.c"].map(example).into_iter().chain([source("platform_host.c")]);
    let sources: Vec<PathBuf> = sources.collect();
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        let program = build_guide(&sources, language, &folder);
        // Faults during the self test, the first tile, and scrubbing: they cause events, and the heights stay the same.
        for (harm, reloads) in [(0, 0), (40, 1), (500, 1), (1100, 1)] {
            let out = folder.join("heights");
            let said = run(Command::new(&program)
                .env("ELUNAR_MODEL", repository().join("host-train/models/nano.eld"))
                .env("ELUNAR_FOLDER", repository().join("tests/golden/flight_tile"))
                .env("ELUNAR_OUT", &out)
                .env("ELUNAR_HARM", harm.to_string()));
            println!("{language}, harm at {harm}: {}", said.trim());
            assert!(said.contains(&format!("2 tiles, {reloads} events, {reloads} reloads")), "{said}");
            assert!(std::fs::read(&out).unwrap() == expected, "{language}, harm at {harm}: other bytes than Rust's");
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn the_service_mends_what_can_be_mended() {
    let folder = folder("service");
    // A tile without light keeps its coarse heights.
    let dark = Tile { image: vec![1.0; PX], ..Tile::golden() }.expected().0;
    let dark: Vec<u8> = dark.iter().flat_map(|v| v.to_ne_bytes()).collect();
    let expected = [golden().0.repeat(3), dark, golden().0].concat();
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        let program = build_guide(&[source("service_harmed.c"), example("service.c")], language, &folder);
        let (out, tile) = (folder.join("heights"), repository().join("tests/golden/flight_tile"));
        let model = repository().join("host-train/models/nano.eld");
        run(Command::new(&program).arg(model).arg(&tile).arg(&out));
        assert!(std::fs::read(&out).unwrap() == expected, "{language}: other bytes than Rust's");
        let distrusted = folder.join("distrusted.eld");
        std::fs::write(&distrusted, changed(|model| set_word(model, word::SELF_TEST_CRC, 1))).unwrap();
        run(Command::new(&program).arg(distrusted).arg(&tile));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn tasks_compile_against_stubs() {
    let folder = folder("tasks");
    for task in ["freertos_task.c", "rtems_task.c", "zephyr_thread.c"] {
        if exists("c99") {
            let stubs = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/c/stubs");
            run(compiler("c99").arg("-I").arg(stubs).arg("-c").arg(example(task)).arg("-o").arg(folder.join("task.o")));
        }
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// Zephyr's module names files that exist, and CMake, if it is here, finds nothing wrong with them; `west` and Zephyr itself are in no test.
#[test]
fn the_module_of_zephyr_is_whole() {
    let module = Path::new(env!("CARGO_MANIFEST_DIR")).join("../zephyr");
    let read = |name: &str| std::fs::read_to_string(module.join(name)).unwrap();
    let (yaml, cmake, kconfig) = (read("zephyr/module.yml"), read("CMakeLists.txt"), read("Kconfig"));
    assert!(yaml.contains("\n  cmake: .\n  kconfig: Kconfig\n"), "{yaml}");
    let words = |text: &str| -> Vec<String> {
        let split = text.split(|c: char| !(c.is_ascii_alphanumeric() || "_/.{}$".contains(c)));
        split.map(|word| word.trim_matches(|c: char| "${}".contains(c)).to_string()).collect()
    };
    for word in words(&cmake) {
        if let Some(path) = word.strip_prefix("elunar_onboard}/") {
            assert!(module.join("..").join(path).exists(), "{path}");
        }
        if let Some(option) = word.strip_prefix("CONFIG_") {
            assert!(kconfig.contains(&format!("config {option}\n")), "{option}");
        }
    }
    let folder = folder("zephyr");
    let stub = format!(
        "cmake_minimum_required(VERSION 3.20)\nproject(stub NONE)\nset(CONFIG_ELUNAR y)\nset(CONFIG_ELUNAR_THREAD y)\n\
         set(CONFIG_ELUNAR_RUST_TARGET thumbv7em-none-eabihf)\nfunction(zephyr_include_directories)\nendfunction()\n\
         function(zephyr_link_libraries)\nendfunction()\nfunction(zephyr_library_named)\nendfunction()\n\
         function(zephyr_library_sources)\nendfunction()\nadd_subdirectory({} elunar)\n",
        module.display()
    );
    std::fs::write(folder.join("CMakeLists.txt"), stub).unwrap();
    match Command::new("cmake").arg("-S").arg(&folder).arg("-B").arg(folder.join("build")).output() {
        Ok(out) => assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr)),
        Err(error) => common::absent(&format!("the module of Zephyr: cmake: {error}")),
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

/// The action after every status agrees with the table of `onboard/README.md`.
#[test]
fn every_status_has_the_action_of_the_readme() {
    let name = |status: u32| match status {
        ELD_FAULT_MODEL_CHANGED => "RELOAD",
        ELD_FAULT_SELF_TEST => "DISTRUST",
        ELD_FAULT_CONTEXT_LOST | ELD_FAULT_CONTEXT_MOVED => "START_AGAIN",
        _ if severity(status) == FAULT => "BEGIN_AGAIN",
        _ if severity(status) == REFUSED => "SKIP",
        _ => "GO_ON",
    };
    let folder = folder("actions");
    let mut text = String::from("#include \"service.h\"\nint main(void) {\n    int wrong = 0;\n");
    for known in STATUSES {
        text += &format!("    wrong += service_action({}) != SERVICE_{};\n", known.name, name(known.status));
    }
    text += "    return wrong;\n}\n";
    std::fs::write(folder.join("actions.c"), text).unwrap();
    for language in LANGUAGES.into_iter().filter(|language| exists(language)) {
        run(&mut Command::new(build_guide(&[folder.join("actions.c"), example("service.c")], language, &folder)));
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
