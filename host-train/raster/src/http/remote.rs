//! A file on the net, in blocks. The latest blocks are kept.

use super::ask::{Patience, Server, Version};
use elunar_base::{Error, Result, read};
use std::collections::{HashMap, VecDeque};
use std::io::{self, ErrorKind};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

/// Bytes of a block. The directories of most cloud-optimised files are in the first one (our choice, as the others).
pub(super) const BLOCK_BYTES: u64 = 64 << 10;
/// Most blocks that are kept: 32 MiB.
const MOST_BLOCKS: usize = 512;
/// Most blocks of one question: 8 MiB. So many are fetched before they are read, too.
const MOST_RUN: u64 = 128;
/// Most blocks that are read ahead, where nobody says what will be read: 1 MiB.
const MOST_AHEAD: u64 = 16;
/// Blocks between two runs that are fetched with them rather than with a question of their own.
const GAP: u64 = 1;

/// A file on the net.
pub(crate) struct Remote {
    path: PathBuf,
    server: Server,
    version: Version,
    blocks: Mutex<Blocks>,
}

/// Blocks by number.
#[derive(Default)]
struct Blocks {
    kept: HashMap<u64, Arc<[u8]>>,
    by_age: VecDeque<u64>,
    /// The block behind the last one that was fetched.
    next: u64,
    /// Blocks of the last question.
    run: u64,
}

impl Blocks {
    fn keep(&mut self, first: u64, bytes: &[u8]) {
        (self.next, self.run) = (first, 0);
        for block in bytes.chunks(BLOCK_BYTES as usize) {
            if self.kept.insert(self.next, block.into()).is_none() {
                self.by_age.push_back(self.next);
            }
            (self.next, self.run) = (self.next + 1, self.run + 1);
        }
        while self.by_age.len() > MOST_BLOCKS {
            if let Some(oldest) = self.by_age.pop_front() {
                self.kept.remove(&oldest);
            }
        }
    }
}

/// Opens a file on the net. As long as one reader of it is left in this process, all others read the same version.
///
/// # Errors
/// [`Error::Unsupported`] if the server does not serve ranges, or says nothing of the file's version; [`Error::Io`] if there is no file or no
/// answer.
pub(crate) fn open(path: &Path) -> Result<Arc<Remote>> {
    static OPEN: Mutex<Vec<Weak<Remote>>> = Mutex::new(Vec::new());
    let mut open = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    open.retain(|remote| remote.strong_count() > 0);
    if let Some(remote) = open.iter().filter_map(Weak::upgrade).find(|remote| remote.path == path) {
        return Ok(remote);
    }
    let remote = Arc::new(Remote::open(path, Patience::USUAL)?);
    open.push(Arc::downgrade(&remote));
    Ok(remote)
}

impl Remote {
    /// Opens a file: asks for its first block.
    pub(super) fn open(path: &Path, patience: Patience) -> Result<Self> {
        let server = Server::new(path, patience)?;
        let (version, first) = server.bytes(&(0..BLOCK_BYTES), None).map_err(|error| match error.kind() {
            ErrorKind::Unsupported => Error::unsupported(path, format!("{error}; {}", read::fetch_line(path))),
            _ => Error::io(path)(error),
        })?;
        if version.mark().is_none() {
            let what = "a strong ETag or Last-Modified expected from the server, found neither";
            return Err(Error::unsupported(path, format!("{what}; {}", read::fetch_line(path))));
        }
        let mut blocks = Blocks::default();
        blocks.keep(0, &first);
        Ok(Self { path: path.into(), server, version, blocks: Mutex::new(blocks) })
    }

    /// Returns the number of bytes of the file.
    pub(crate) fn length(&self) -> u64 {
        self.version.length
    }

    /// Returns what the server says of the file, in place of a hash of its bytes.
    pub(crate) fn identity(&self) -> String {
        let (path, length, mark) = (self.path.display(), self.version.length, self.version.mark().unwrap_or_default());
        format!("{path}, {length} bytes, {mark} (no hash of the bytes)")
    }

    /// Reads bytes, up to the end of a block.
    pub(crate) fn read_at(&self, at: u64, out: &mut [u8]) -> io::Result<usize> {
        if at >= self.length() || out.is_empty() {
            return Ok(0);
        }
        let number = at / BLOCK_BYTES;
        let mut blocks = self.lock();
        if !blocks.kept.contains_key(&number) {
            let run = if number == blocks.next { (2 * blocks.run).clamp(1, MOST_AHEAD) } else { 1 };
            let is_new = |block: &u64| !blocks.kept.contains_key(block);
            let end = (number..number + run).find(|block| !is_new(block)).unwrap_or(number + run);
            self.fetch(&mut blocks, number..end)?;
        }
        let block = blocks.kept.get(&number).map_or(&[][..], |block| block);
        let rest = block.get((at % BLOCK_BYTES) as usize..).unwrap_or_default();
        let count = rest.len().min(out.len());
        out[..count].copy_from_slice(&rest[..count]);
        Ok(count)
    }

    /// Fetches what will be read next, in few questions, unless the first of it is here.
    pub(crate) fn want(&self, ranges: &mut dyn Iterator<Item = Range<u64>>) -> io::Result<()> {
        let mut blocks = self.lock();
        let mut missing: Vec<u64> = vec![];
        for range in ranges {
            let end = range.end.min(self.length()).div_ceil(BLOCK_BYTES);
            let new = (range.start / BLOCK_BYTES..end).filter(|block| !blocks.kept.contains_key(block));
            missing.extend(new.take(MOST_RUN as usize));
            if missing.is_empty() {
                return Ok(());
            }
            if missing.len() as u64 >= MOST_RUN {
                break;
            }
        }
        missing.sort_unstable();
        let mut rest = &missing[..];
        while let Some(&first) = rest.first() {
            let joins = |pair: &[u64]| pair[1] - pair[0] <= 1 + GAP && pair[1] - first < MOST_RUN;
            let count = 1 + rest.windows(2).take_while(|pair| joins(pair)).count();
            self.fetch(&mut blocks, first..rest[count - 1] + 1)?;
            rest = &rest[count..];
        }
        Ok(())
    }

    fn fetch(&self, blocks: &mut Blocks, numbers: Range<u64>) -> io::Result<()> {
        let range = numbers.start * BLOCK_BYTES..(numbers.end * BLOCK_BYTES).min(self.length());
        let (_, bytes) = self.server.bytes(&range, Some(&self.version))?;
        blocks.keep(numbers.start, &bytes);
        Ok(())
    }

    /// Another reader that panicked leaves whole blocks.
    fn lock(&self) -> MutexGuard<'_, Blocks> {
        self.blocks.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
