//! Numbers of threads on the command line.

/// Most threads that a user may ask for (our choice).
const MOST_THREADS: usize = 1024;

/// Reads a number of threads.
///
/// # Errors
/// A text of what was expected.
pub fn number(text: &str) -> std::result::Result<usize, String> {
    match text.parse() {
        Ok(threads @ 0..=MOST_THREADS) => Ok(threads),
        _ => Err(format!("a number from 0 to {MOST_THREADS} expected")),
    }
}
