//! Chooses the board: with `ELUNAR_BOARD` set, the program is linked bare with that board's memory map.

use std::{env, path::PathBuf};

fn main() {
    println!("cargo:rerun-if-env-changed=ELUNAR_BOARD");
    let Ok(board) = env::var("ELUNAR_BOARD") else { return };
    let boards = PathBuf::from(env::var("CARGO_MANIFEST_DIR").expect("cargo sets it")).join("../boards");
    let memory = boards.join(&board).join("memory.x");
    assert!(memory.exists(), "ELUNAR_BOARD: expected a board with a memory map, found no {}", memory.display());
    println!("cargo:rustc-cfg=bare");
    // Only these files of the folder: budgets and counts change after every record.
    for script in [memory, boards.join("sections.x")] {
        println!("cargo:rustc-link-arg=-T{}", script.display());
        println!("cargo:rerun-if-changed={}", script.display());
    }
    println!("cargo:rustc-link-arg=--gc-sections");
}
