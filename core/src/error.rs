//! The error that all modules share: a buffer of the wrong length. Every other error is defined beside the operation that returns it, as a
//! small `Copy` enum that prints as one line.

use core::fmt;

/// A buffer whose length differs from the required one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LengthError {
    /// Samples required.
    pub expected: usize,
    /// Samples found.
    pub found: usize,
}

impl fmt::Display for LengthError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "expected a buffer of {} samples, found {}", self.expected, self.found)
    }
}

impl core::error::Error for LengthError {}

/// Returns an error unless `found` equals `expected`, in samples.
pub(crate) fn same_length(expected: usize, found: usize) -> Result<(), LengthError> {
    if expected == found { Ok(()) } else { Err(LengthError { expected, found }) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_message_names_expected_and_found() {
        let text = LengthError { expected: 4, found: 3 }.to_string();
        assert_eq!(text, "expected a buffer of 4 samples, found 3");
    }
}
