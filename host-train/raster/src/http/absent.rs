//! Without the feature `http` there are no files on the net.

use elunar_base::{Error, Result, read};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// A file on the net: there is none.
pub(crate) enum Remote {}

impl Remote {
    pub(crate) fn length(&self) -> u64 {
        match *self {}
    }

    pub(crate) fn identity(&self) -> String {
        match *self {}
    }

    pub(crate) fn read_at(&self, _: u64, _: &mut [u8]) -> std::io::Result<usize> {
        match *self {}
    }

    pub(crate) fn want(&self, _: &mut dyn Iterator<Item = Range<u64>>) -> std::io::Result<()> {
        match *self {}
    }
}

/// Refuses an address, with the line that fetches the file.
///
/// # Errors
/// As [`read::refuse_address`].
pub(crate) fn open(path: &Path) -> Result<Arc<Remote>> {
    read::refuse_address(path)?;
    Err(Error::unsupported(path, "an address expected"))
}

#[cfg(test)]
mod tests {
    use crate::content::identity_of_raster_while;
    use crate::{format::Format, source};
    use std::path::Path;

    #[test]
    fn an_address_is_refused_with_the_line_that_fetches_it() {
        let path = Path::new("http://127.0.0.1/b/a.tif");
        let refusals = [
            source::open(path).map(drop),
            Format::of(path).map(drop),
            identity_of_raster_while(path, &|| true).map(drop),
        ];
        for refusal in refusals {
            let text = refusal.unwrap_err().to_string();
            assert!(
                text.contains("found an address") && text.contains("/vsicurl/http://127.0.0.1/b/a.tif a.tif"),
                "{text}"
            );
        }
    }
}
