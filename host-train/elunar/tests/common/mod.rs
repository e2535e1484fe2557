//! The program, as users run it.
#![allow(dead_code)] // each test file uses only some functions

use std::path::Path;
use std::process::{Command, Output};

/// Returns the program with these words, in a folder.
pub(crate) fn command(folder: &Path, words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_elunar"));
    command.current_dir(folder).args(words);
    command
}

/// Runs the program.
pub(crate) fn elunar(folder: &Path, words: &[&str]) -> Output {
    command(folder, words).output().unwrap()
}

/// Returns the output of a command that must succeed.
pub(crate) fn made(folder: &Path, words: &[&str]) -> String {
    let out = elunar(folder, words);
    assert!(out.status.success(), "{words:?}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8_lossy(&out.stdout).into_owned()
}
