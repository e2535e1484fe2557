//! The end of a program: one line for every error, and its exit code.

use elunar_raster::{Error, Result};
use std::fmt::Arguments;
use std::io::{ErrorKind, Write};
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU8, Ordering};

/// Exit code of a request that cannot be met, of a broken file, and of an error of the system.
pub const FAILED: u8 = 1;
/// Exit code of a defect of this program.
pub const DEFECT: u8 = 70;
/// Exit code if the system refuses memory or threads.
pub const NO_MEMORY: u8 = 71;
/// Exit code if another run writes the output: try again later.
pub const TRY_AGAIN: u8 = 75;
/// Exit code if the reader of standard output has left, as in other programs.
pub const BROKEN_PIPE: u8 = 128 + 13;

/// Exit code of the first panic or refusal of memory, 0 if there was none.
static PANICKED: AtomicU8 = AtomicU8::new(0);

/// Runs a program. An error is one line on stderr, and nothing ends in a trace. A closed standard output ends the program without a message.
pub fn finish(run: impl FnOnce() -> Result<()>) -> ExitCode {
    std::panic::set_hook(Box::new(say));
    // What is still buffered belongs to the result.
    let flush = || match std::io::stdout().flush() {
        // The reader has all that it wanted.
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        flushed => flushed.map_err(Error::io("standard output")),
    };
    let ended = catch_unwind(AssertUnwindSafe(|| run().and_then(|()| flush())));
    let panicked = PANICKED.load(Ordering::SeqCst);
    ExitCode::from(match ended {
        _ if panicked != 0 => panicked,
        Ok(Ok(())) => return ExitCode::SUCCESS,
        Ok(Err(error)) => {
            line(format_args!("{error}"));
            if matches!(error, Error::Busy { .. }) { TRY_AGAIN } else { FAILED }
        }
        Err(_) => DEFECT,
    })
}

/// Says why the program ends, unless that was said before. Allocates nothing.
pub(crate) fn fail_once(code: u8, what: Arguments<'_>) -> bool {
    let first = PANICKED.compare_exchange(0, code, Ordering::SeqCst, Ordering::SeqCst).is_ok();
    if first {
        line(what);
    }
    first
}

/// Writes an error line. A closed stderr is no reason to fail once more.
fn line(what: Arguments<'_>) {
    let _ = writeln!(std::io::stderr(), "ERROR: {what}");
}

/// Says in one line what the first panic means. Later ones are its consequences.
fn say(panic: &PanicHookInfo<'_>) {
    let text = panic.payload_as_str().unwrap_or("unknown").replace('\n', " ");
    match meaning(&text, panic) {
        (code, Some(what)) => {
            fail_once(code, format_args!("{what}"));
        }
        (code, None) => PANICKED.store(code, Ordering::SeqCst),
    }
}

/// Returns the exit code of a panic with this text, and what to say.
fn meaning(text: &str, panic: &PanicHookInfo<'_>) -> (u8, Option<String>) {
    // The texts are those of the standard library and of rayon.
    if let Some(why) = text.strip_prefix("failed printing to stdout: ") {
        let left = why.contains("Broken pipe");
        return if left { (BROKEN_PIPE, None) } else { (FAILED, Some(format!("standard output: {why}"))) };
    }
    if text.starts_with("failed printing to stderr") {
        return (FAILED, None);
    }
    if text.contains("failed to spawn thread") || text.contains("ThreadPoolBuildError") {
        return (NO_MEMORY, Some(format!("not enough memory or threads: {text}")));
    }
    let place = panic.location().map_or_else(String::new, |at| format!(" at {}:{}", at.file(), at.line()));
    (DEFECT, Some(format!("a defect of this program{place}: {text}")))
}
