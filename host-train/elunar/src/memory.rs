//! The programs' allocator: the system's. If the system refuses memory, the program ends with one line, without an abort.

#[cfg(unix)]
use crate::program::{JSON, LOOKED, kind_of, with_said};
use crate::program::{NO_MEMORY, fail_once};
use elunar_base::memory::is_fallible;
use std::alloc::{GlobalAlloc, Layout, System};
#[cfg(unix)]
use std::fmt::{Arguments, Write as _};
#[cfg(unix)]
use std::io::{Cursor, Write};
#[cfg(unix)]
use std::sync::atomic::Ordering;
use std::time::Duration;

/// The allocator of both programs.
#[derive(Debug)]
pub struct Memory;

/// Ends the program if memory was refused to code that cannot handle that.
#[inline]
fn granted(at: *mut u8, bytes: usize) -> *mut u8 {
    if at.is_null() && !is_fallible() {
        end(bytes);
    }
    at
}

/// Ends the program at once. Nothing runs that could allocate again: no unwinding, no handlers of the end.
#[cold]
fn end(bytes: usize) -> ! {
    if fail_once(NO_MEMORY, format_args!("not enough memory: the system refused {bytes} bytes")) {
        #[cfg(unix)]
        object(format_args!("not enough memory: the system refused {bytes} bytes"));
    } else {
        // Another thread has begun to say why the program ends; or this one has, and memory is refused on its way out.
        std::thread::sleep(Duration::from_millis(100));
        #[cfg(unix)]
        with_said(object);
    }
    #[cfg(unix)]
    #[allow(unsafe_code)]
    // SAFETY: `_exit` takes any number and does not return.
    unsafe {
        libc::_exit(NO_MEMORY.into())
    }
    #[cfg(not(unix))]
    std::process::exit(NO_MEMORY.into())
}

/// Looks at the command line as Linux has it, without an allocation: memory was refused before the line was read.
#[cfg(unix)]
#[allow(unsafe_code)]
fn line_asks_for_json() -> bool {
    let mut line = [0u8; 4096];
    // SAFETY: the path ends in a zero, and as many bytes are read as the array has. A file that is not there gives -1, and no bytes.
    let found = unsafe {
        let file = libc::open(c"/proc/self/cmdline".as_ptr(), libc::O_RDONLY);
        libc::read(file, line.as_mut_ptr().cast(), line.len())
    };
    let line = &line[..usize::try_from(found).unwrap_or(0)];
    line.split(|byte| *byte == 0).skip(1).take_while(|word| *word != b"--").any(|word| word == b"--json")
}

/// Prints the object of the error, if JSON is asked for. Nothing is allocated, and the library's buffer is left alone: this thread may hold it.
#[cfg(unix)]
fn object(message: Arguments<'_>) {
    let asked = if LOOKED.load(Ordering::Relaxed) { JSON.load(Ordering::Relaxed) } else { line_asks_for_json() };
    if !asked {
        return;
    }
    let mut text = Cursor::new([0; 1024]);
    let (code, kind) = (NO_MEMORY, kind_of(NO_MEMORY));
    let _ = write!(text, "{{\"error\":{{\"code\":{code},\"kind\":\"{kind}\",\"message\":\"")
        .and_then(|()| write!(Escaped(&mut text), "{message}").map_err(std::io::Error::other))
        .and_then(|()| writeln!(text, "\"}}}}"));
    let length = text.position() as usize;
    #[allow(unsafe_code)]
    // SAFETY: the first `length` bytes of the array are initialised, and 1 is standard output, or an error that is ignored.
    unsafe {
        libc::write(1, text.get_ref().as_ptr().cast(), length);
    }
}

/// Text within a string of JSON.
#[cfg(unix)]
struct Escaped<'t>(&'t mut Cursor<[u8; 1024]>);

#[cfg(unix)]
impl std::fmt::Write for Escaped<'_> {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        for c in text.chars() {
            // Control characters have been replaced before.
            let escape = if matches!(c, '"' | '\\') { "\\" } else { "" };
            write!(self.0, "{escape}{c}").map_err(|_| std::fmt::Error)?;
        }
        Ok(())
    }
}

// SAFETY: every call is passed to the system's allocator as it is, and its answer is returned unless the program ends. Ending allocates
// nothing.
#[allow(unsafe_code)]
unsafe impl GlobalAlloc for Memory {
    #[inline]
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: the caller's promises are those of the system's allocator.
        granted(unsafe { System.alloc(layout) }, layout.size())
    }

    #[inline]
    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as above.
        granted(unsafe { System.alloc_zeroed(layout) }, layout.size())
    }

    #[inline]
    unsafe fn realloc(&self, at: *mut u8, layout: Layout, bytes: usize) -> *mut u8 {
        // SAFETY: as above.
        granted(unsafe { System.realloc(at, layout, bytes) }, bytes)
    }

    #[inline]
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(at, layout) }
    }
}
