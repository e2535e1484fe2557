//! Files that grow: rows of an unfinished job, journals. Their names are known beforehand, so others may plant something there.

use super::step::{Step, before};
use super::target::{check_regular, check_target};
use crate::{Error, Result};
use std::fs::{File, OpenOptions};
use std::io::ErrorKind;
use std::path::Path;

/// Opens a regular file for reading and for writing at its end, or creates it exclusively. Links are not followed, also not hard ones: what
/// has a second name belongs to somebody else.
///
/// # Errors
/// [`Error::Usage`] if `path` is a link or no regular file; [`Error::Io`] if it cannot be opened.
pub fn open_growing(path: &Path) -> Result<File> {
    check_target(path)?;
    let mut options = OpenOptions::new();
    options.read(true).append(true);
    before(Step::Create, path).map_err(Error::io(path))?;
    match options.clone().create_new(true).open(path) {
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
        created => return created.map_err(Error::io(path)),
    }
    let file = without_following(&mut options).open(path).map_err(Error::io(path))?;
    let found = file.metadata().map_err(Error::io(path))?;
    check_regular(path, &found)?;
    #[cfg(unix)]
    {
        let names = std::os::unix::fs::MetadataExt::nlink(&found);
        // A simulated disk keeps one of its own.
        #[cfg(test)]
        let names = if super::simulated::is_active() { names.min(1) } else { names };
        if names > 1 {
            let what = format!("{}: a file of one name expected, one of {names} names found", path.display());
            return Err(Error::usage(what));
        }
    }
    Ok(file)
}

/// Lets the system refuse a link that was planted since the last look.
pub(super) fn without_following(options: &mut OpenOptions) -> &mut OpenOptions {
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, rustix::fs::OFlags::NOFOLLOW.bits() as i32);
    options
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Seek, Write};

    #[test]
    fn a_file_grows_at_its_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.part");
        open_growing(&path).unwrap().write_all(b"one").unwrap();
        let mut file = open_growing(&path).unwrap();
        file.write_all(b" two").unwrap();
        file.rewind().unwrap();
        let mut text = String::new();
        file.read_to_string(&mut text).unwrap();
        assert_eq!(text, "one two");
    }

    #[cfg(unix)]
    #[test]
    fn links_are_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let [victim, part] = ["victim", "a.part"].map(|name| folder.path().join(name));
        std::fs::write(&victim, "precious").unwrap();
        std::os::unix::fs::symlink(&victim, &part).unwrap();
        let error = open_growing(&part).unwrap_err().to_string();
        assert!(error.ends_with("a.part: a regular file or nothing expected, a link found"), "{error}");
        std::fs::remove_file(&part).unwrap();
        std::fs::hard_link(&victim, &part).unwrap();
        let error = open_growing(&part).unwrap_err().to_string();
        assert!(error.ends_with("a file of one name expected, one of 2 names found"), "{error}");
        assert_eq!(std::fs::read(&victim).unwrap(), b"precious");
        // A link that appears after the first look is refused by the system.
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&victim, &link).unwrap();
        assert!(without_following(OpenOptions::new().read(true)).open(&link).is_err());
    }
}
