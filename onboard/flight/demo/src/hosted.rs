//! The same report as an ordinary program, with the model from a file and the arena on the heap.

use crate::report;
use elunar_core::nn::{Model, required};
use std::fmt;
use std::process::ExitCode;

/// Standard output.
struct Console;

impl fmt::Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        print!("{text}");
        Ok(())
    }
}

/// The stack of an operating system grows automatically and is not measured.
pub(crate) mod stack {
    /// Runs `call`; its stack depth is unknown here.
    pub(crate) fn depth(call: impl FnOnce()) -> Option<usize> {
        call();
        None
    }
}

/// `elunar-demo MODEL.eld`
pub(crate) fn main() -> ExitCode {
    let Some(path) = std::env::args().nth(1) else {
        eprintln!("ERROR: expected a model file: elunar-demo MODEL.eld");
        return ExitCode::FAILURE;
    };
    let bytes = match std::fs::read(&path) {
        Ok(bytes) => bytes,
        Err(error) => {
            eprintln!("ERROR: {path}: {error}");
            return ExitCode::FAILURE;
        }
    };
    let more = if cfg!(feature = "c_calls") { 8 << 20 } else { 0 };
    let arena_bytes = Model::new(&bytes).map_or(0, |model| required(&model)) + more;
    let passed = report::run(&bytes, &mut vec![0; arena_bytes], &mut Console);
    if passed { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
