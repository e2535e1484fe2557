//! How a program ends.

use elunar_raster::Result;
use std::process::ExitCode;

/// Runs a program: an error is one line on stderr, and nobody is told that nobody reads on.
pub fn finish(run: impl FnOnce() -> Result<()>) -> ExitCode {
    end_with_the_reader();
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("ERROR: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Where nobody reads on, as behind `| head`, `println!` panics: end as other programs do then, without a word, with the status of a
/// broken pipe.
fn end_with_the_reader() {
    const BROKEN_PIPE: i32 = 128 + 13;
    let hook = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        if panic.payload_as_str().is_some_and(|text| text.contains("stdout: Broken pipe")) {
            std::process::exit(BROKEN_PIPE);
        }
        hook(panic);
    }));
}
