//! The end of a program.

use elunar_raster::Result;
use std::process::ExitCode;

/// Runs a program. An error is one line on stderr. A closed standard output ends the program without a message.
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

/// Ends the program without a message if its standard output is closed, as behind `| head`. `println!` would panic. The exit status is that
/// of a broken pipe, as in other programs.
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
