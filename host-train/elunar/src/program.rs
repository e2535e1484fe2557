//! The end of a program: one line for every error, and its exit code.

use elunar_base::interrupt::outlive_file_limit;
use elunar_base::{Error, Result};
use std::fmt::Arguments;
use std::io::{ErrorKind, Write};
use std::panic::{AssertUnwindSafe, PanicHookInfo, catch_unwind};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::sync::{Mutex, PoisonError};

/// Exit code of a command line that cannot be read, or of options that cannot be met.
pub const USAGE: u8 = 64;
/// Exit code of an input that is missing, broken, or does not serve. The same command never succeeds on it.
pub const BAD_INPUT: u8 = 65;
/// Exit code of a defect of this program.
pub const DEFECT: u8 = 70;
/// Exit code if the system refuses memory or threads.
pub const NO_MEMORY: u8 = 71;
/// Exit code of what may pass: a run that was asked to stop, another run that writes the output, a full disk, another error of the system.
pub const TRY_AGAIN: u8 = 75;
/// Exit code if the reader of standard output has left, as in other programs.
pub const BROKEN_PIPE: u8 = 128 + 13;

/// Exit code of the first panic or refusal of memory, 0 if there was none.
static PANICKED: AtomicU8 = AtomicU8::new(0);
/// Whether errors are printed as JSON, too.
pub(crate) static JSON: AtomicBool = AtomicBool::new(false);
/// Whether that is known.
pub(crate) static LOOKED: AtomicBool = AtomicBool::new(false);
/// What was said of the first panic.
static SAID: Mutex<String> = Mutex::new(String::new());

/// Runs a program. An error is one line on stderr, and nothing ends in a trace. A closed standard output ends the program without a message.
pub fn finish(run: impl FnOnce() -> Result<()>) -> ExitCode {
    std::panic::set_hook(Box::new(say));
    outlive_file_limit();
    look_for_json();
    // What is still buffered belongs to the result.
    let flush = || match std::io::stdout().flush() {
        // The reader has all that it wanted.
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        flushed => flushed.map_err(Error::io("standard output")),
    };
    let ended = catch_unwind(AssertUnwindSafe(|| run().and_then(|()| flush())));
    let panicked = PANICKED.load(Ordering::SeqCst);
    let (code, object) = match ended {
        _ if panicked != 0 => (panicked, object(panicked, &SAID.lock().unwrap_or_else(PoisonError::into_inner))),
        Ok(Ok(())) => return ExitCode::SUCCESS,
        Ok(Err(error)) => {
            line(format_args!("{error}"));
            (code_of(&error), object_of(&error))
        }
        Err(_) => (DEFECT, object(DEFECT, "")),
    };
    if JSON.load(Ordering::Relaxed) {
        print_object(object);
    }
    ExitCode::from(code)
}

/// Looks whether the command line asks for JSON. Errors are then objects on standard output, too.
fn look_for_json() {
    let asks = std::env::args_os().skip(1).take_while(|word| word != "--").any(|word| word == "--json");
    JSON.store(asks, Ordering::Relaxed);
    LOOKED.store(true, Ordering::Relaxed);
}

/// Returns an error as it stands under `error` in the object that a command prints with `--json`.
fn object_of(error: &Error) -> serde_json::Value {
    object(code_of(error), &error.to_string())
}

/// Adds the error to the object that a command prints itself. [`finish`] then prints none.
pub fn add_error(found: &mut serde_json::Value, error: &Error) {
    found["error"] = object_of(error);
    JSON.store(false, Ordering::Relaxed);
}

fn object(code: u8, message: &str) -> serde_json::Value {
    serde_json::json!({ "code": code, "kind": kind_of(code), "message": message })
}

/// Prints the object of an error on standard output.
fn print_object(error: serde_json::Value) {
    // If nobody reads standard output any more, the error line remains.
    let mut out = std::io::stdout();
    let _ = writeln!(out, "{}", serde_json::json!({ "error": error })).and_then(|()| out.flush());
}

/// Returns the name of an exit code in the object of an error.
#[must_use]
pub fn kind_of(code: u8) -> &'static str {
    match code {
        USAGE => "usage",
        BAD_INPUT => "bad_input",
        NO_MEMORY => "no_memory",
        TRY_AGAIN => "try_again",
        BROKEN_PIPE => "broken_pipe",
        _ => "defect",
    }
}

/// Returns the exit code of an error. Every command ends through it.
#[must_use]
pub fn code_of(error: &Error) -> u8 {
    match error {
        Error::Usage(_) => USAGE,
        Error::Broken { .. } | Error::Unsupported { .. } | Error::Input(_) => BAD_INPUT,
        Error::Stopped(_) | Error::Busy { .. } => TRY_AGAIN,
        Error::Io { source, .. } => code_of_system(source.kind()),
    }
}

/// Returns the exit code of an error of the system. What the same command would meet again is bad input; all else may pass.
fn code_of_system(kind: ErrorKind) -> u8 {
    match kind {
        ErrorKind::NotFound
        | ErrorKind::PermissionDenied
        | ErrorKind::AlreadyExists
        | ErrorKind::NotADirectory
        | ErrorKind::IsADirectory
        | ErrorKind::InvalidFilename
        | ErrorKind::ReadOnlyFilesystem
        | ErrorKind::InvalidInput
        | ErrorKind::InvalidData
        | ErrorKind::UnexpectedEof
        | ErrorKind::Unsupported => BAD_INPUT,
        ErrorKind::OutOfMemory => NO_MEMORY,
        ErrorKind::BrokenPipe => BROKEN_PIPE,
        _ => TRY_AGAIN,
    }
}

/// Reads the command line, or ends the program: with 0 behind `--help` and `--version`, otherwise with [`USAGE`].
pub fn read_command_line<T>(parse: impl FnOnce() -> std::result::Result<T, clap::Error>) -> T {
    // Memory may be refused while the line is read.
    look_for_json();
    parse().unwrap_or_else(|error| {
        if error.exit_code() != 0 && JSON.load(Ordering::Relaxed) {
            print_object(object(USAGE, &usage_line(&error)));
        }
        let said = error.print().and_then(|()| std::io::stdout().flush());
        let code = match said {
            Err(why) if why.kind() == ErrorKind::BrokenPipe => BROKEN_PIPE,
            Err(why) if error.exit_code() == 0 => {
                line(format_args!("standard output: {why}"));
                TRY_AGAIN
            }
            _ if error.exit_code() == 0 => 0,
            _ => USAGE,
        };
        std::process::exit(code.into())
    })
}

/// Returns what the command line's reader says, in one line without the usage that it adds.
#[must_use]
pub fn usage_line(error: &clap::Error) -> String {
    let text = error.to_string();
    let first = text.trim_start_matches("error: ").split("\n\n").next().unwrap_or_default();
    first.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Says why the program ends, unless that was said before. Allocates nothing.
pub(crate) fn fail_once(code: u8, what: Arguments<'_>) -> bool {
    let first = PANICKED.compare_exchange(0, code, Ordering::SeqCst, Ordering::SeqCst).is_ok();
    if first {
        line(what);
    }
    first
}

/// Writes an error line in one piece, so that no other thread's words come between; a line that is too long, in several. Allocates nothing. A
/// closed stderr is no reason to fail once more.
fn line(what: Arguments<'_>) {
    let mut buffer = std::io::Cursor::new([0; 512]);
    let _ = match writeln!(buffer, "ERROR: {what}") {
        Ok(()) => std::io::stderr().write_all(&buffer.get_ref()[..buffer.position() as usize]),
        Err(_) => writeln!(std::io::stderr(), "ERROR: {what}"),
    };
}

/// Passes on what was said, if the program ends for want of memory and nobody is writing it. Allocates nothing.
#[cfg(unix)]
pub(crate) fn with_said(pass_on: impl FnOnce(Arguments<'_>)) {
    if PANICKED.load(Ordering::SeqCst) == NO_MEMORY
        && let Ok(said) = SAID.try_lock()
        && !said.is_empty()
    {
        pass_on(format_args!("{said}"));
    }
}

/// Says in one line what the first panic means. Later ones are its consequences.
fn say(panic: &PanicHookInfo<'_>) {
    let text = panic.payload_as_str().unwrap_or("unknown").replace('\n', " ");
    match meaning(&text, panic) {
        (code, Some(what)) => {
            if fail_once(code, format_args!("{what}")) {
                *SAID.lock().unwrap_or_else(PoisonError::into_inner) = what;
            }
        }
        (code, None) => PANICKED.store(code, Ordering::SeqCst),
    }
    #[cfg(all(panic = "abort", unix))]
    end();
}

/// Ends the static program, which does not unwind, as [`finish`] ends the others.
#[cfg(all(panic = "abort", unix))]
fn end() -> ! {
    let code = PANICKED.load(Ordering::SeqCst);
    if JSON.load(Ordering::Relaxed) {
        print_object(object(code, &SAID.lock().unwrap_or_else(PoisonError::into_inner)));
    }
    std::process::exit(code.into())
}

/// Returns the exit code of a panic with this text, and what to say.
fn meaning(text: &str, panic: &PanicHookInfo<'_>) -> (u8, Option<String>) {
    // The texts are those of the standard library and of rayon.
    if let Some(why) = text.strip_prefix("failed printing to stdout: ") {
        let left = why.contains("Broken pipe");
        return if left { (BROKEN_PIPE, None) } else { (TRY_AGAIN, Some(format!("standard output: {why}"))) };
    }
    if text.starts_with("failed printing to stderr") {
        return (TRY_AGAIN, None);
    }
    if text.contains("failed to spawn thread") || text.contains("ThreadPoolBuildError") {
        return (NO_MEMORY, Some(format!("not enough memory or threads: {text}")));
    }
    let place = panic.location().map_or_else(String::new, |at| format!(" at {}:{}", at.file(), at.line()));
    (DEFECT, Some(format!("a defect of this program{place}: {text}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Error as System;

    #[test]
    fn every_kind_of_error_has_its_code() {
        let io = |kind: ErrorKind| Error::io("a.tif")(System::from(kind));
        let cases = [
            (Error::usage("--x"), 64),
            (Error::input("no overlap"), 65),
            (Error::broken("a.tif", "cut"), 65),
            (Error::unsupported("a.tif", "LERC"), 65),
            (Error::stopped("after 3 tiles"), 75),
            (Error::busy("a.tif", "process 7"), 75),
            (io(ErrorKind::NotFound), 65),
            (io(ErrorKind::UnexpectedEof), 65),
            (io(ErrorKind::FileTooLarge), 75),
            (io(ErrorKind::PermissionDenied), 65),
            (io(ErrorKind::StorageFull), 75),
            (io(ErrorKind::QuotaExceeded), 75),
            (io(ErrorKind::StaleNetworkFileHandle), 75),
            (io(ErrorKind::TimedOut), 75),
            (io(ErrorKind::OutOfMemory), 71),
            (Error::io("a.tif")(System::from_raw_os_error(5)), 75),
        ];
        for (error, code) in cases {
            assert_eq!(code_of(&error), code, "{error}");
            // What is added to the message changes no code.
            let text = error.to_string();
            let kind = std::mem::discriminant(&error);
            let longer = error.and("; more").about("scene 1");
            assert_eq!(std::mem::discriminant(&longer), kind, "{text}");
            assert!(longer.to_string().contains("; more") && longer.to_string().contains("scene 1"), "{longer}");
            assert_eq!(code_of(&longer), code, "{text}");
        }
    }
}
