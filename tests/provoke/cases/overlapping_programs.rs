//! Random programs whose tensors share bytes compute what they compute apart, with every kernel, model and memory between pages that must
//! not be touched. The campaign of many programs is a command: ../../campaigns/README.md.
#![allow(unsafe_code)] // pages of the operating system

use elunar_provoke::Random;
use elunar_provoke::programs::{Judged, Lent, Sizes, judge, program};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Write as _;
use std::time::Instant;

/// Memory that ends, or begins, where the next page may not be touched; elsewhere than on Unix, plain memory.
mod pages {
    use super::Lent;

    /// More than the largest arena and the largest file.
    const BYTES: usize = 1 << 23;

    #[cfg(unix)]
    pub(super) fn new() -> *mut u8 {
        use std::ffi::c_void;
        unsafe extern "C" {
            fn mmap(at: *mut c_void, len: usize, access: i32, flags: i32, file: i32, offset: isize) -> *mut c_void;
            fn mprotect(at: *mut c_void, len: usize, access: i32) -> i32;
        }
        const PAGE: usize = 1 << 16;
        let (nothing, read_write, private) = (0, 3, 2);
        let anonymous = if cfg!(target_os = "linux") { 0x20 } else { 0x1000 };
        // SAFETY: new memory of this process; the pages in the middle become writable.
        unsafe {
            let base = mmap(std::ptr::null_mut(), BYTES + 2 * PAGE, nothing, private | anonymous, -1, 0);
            assert!(base.addr() != usize::MAX, "no memory");
            let inner = base.wrapping_byte_add(PAGE);
            assert_eq!(mprotect(inner, BYTES, read_write), 0);
            inner.cast()
        }
    }

    #[cfg(not(unix))]
    pub(super) fn new() -> *mut u8 {
        vec![0; BYTES].leak().as_mut_ptr()
    }

    /// Returns a function that lends this much memory: now at the end, now at the start.
    pub(super) fn lender() -> impl FnMut(Lent, usize) -> &'static mut [u8] {
        let (model, arena, mut turn) = (new(), new(), 0usize);
        move |what, len| {
            assert!(len <= BYTES, "{len}");
            turn += 1;
            let start = if turn.is_multiple_of(4) { 0 } else { BYTES - len };
            let base = if what == Lent::Model { model } else { arena };
            // SAFETY: within the pages, which are never given back; a run ends before the next begins, and all runs of a model before the
            // next model is lent.
            unsafe { std::slice::from_raw_parts_mut(base.add(start), len) }
        }
    }
}

/// Seeds between two lines of progress.
const BLOCK: u64 = 2000;

/// What came of the seeds `first..next`.
#[derive(Debug, Clone, Copy)]
struct Sums {
    first: u64,
    next: u64,
    programs: u64,
    accepted: u64,
    layouts: u64,
    shared: u64,
    runs: u64,
    milliseconds: u64,
}

impl Sums {
    fn new(first: u64) -> Self {
        let (programs, accepted, layouts, shared, runs, milliseconds) = Default::default();
        Self { first, next: first, programs, accepted, layouts, shared, runs, milliseconds }
    }

    /// Returns the line of a progress file.
    fn line(&self) -> String {
        let mut line = String::new();
        let fields = [
            ("first", self.first),
            ("next", self.next),
            ("programs", self.programs),
            ("accepted", self.accepted),
            ("layouts", self.layouts),
            ("shared", self.shared),
            ("runs", self.runs),
            ("milliseconds", self.milliseconds),
        ];
        fields.iter().for_each(|(name, value)| _ = write!(line, "{name} {value} "));
        line + "."
    }

    /// Reads [`Self::line`]; `None` if the line is not complete.
    fn read(line: &str) -> Option<Self> {
        let numbers: Vec<u64> = line.split(' ').skip(1).step_by(2).map_while(|word| word.parse().ok()).collect();
        let &[first, next, programs, accepted, layouts, shared, runs, milliseconds] = &numbers[..] else { return None };
        let sums = Self { first, next, programs, accepted, layouts, shared, runs, milliseconds };
        (sums.line() == line).then_some(sums)
    }
}

/// Judges programs until `wanted` layouts ran; calls `progress` after each block of seeds.
fn campaign(from: Sums, wanted: u64, mut progress: impl FnMut(&Sums)) -> Sums {
    let (mut sums, begin, mut lend) = (from, Instant::now(), pages::lender());
    let mut reasons = BTreeMap::new();
    while sums.layouts < wanted {
        let seed = sums.next;
        let mut random = Random::of_seed(seed);
        if let Some(program) = program(&mut random, &Sizes::USUAL) {
            sums.programs += 1;
            let judge = || judge(&program, &mut random, &mut lend);
            let judged = std::panic::catch_unwind(std::panic::AssertUnwindSafe(judge));
            match judged.unwrap_or_else(|_| panic!("seed {seed}")) {
                Judged::Illegal(error) => {
                    let text: String = error.to_string().chars().filter(|c| !c.is_ascii_digit()).collect();
                    *reasons.entry(text).or_insert(0) += 1;
                }
                Judged::Ran { layouts, shared, runs, .. } => {
                    sums.accepted += 1;
                    sums.layouts += layouts as u64;
                    sums.shared += shared as u64;
                    sums.runs += runs as u64;
                }
            }
        }
        sums.next += 1;
        if sums.next.is_multiple_of(BLOCK) || sums.layouts >= wanted {
            sums.milliseconds = from.milliseconds + begin.elapsed().as_millis() as u64;
            progress(&sums);
        }
    }
    println!("illegal: {reasons:?}");
    println!("{}", sums.line());
    sums
}

#[test]
fn programs_that_share_bytes_compute_what_they_compute_apart() {
    let sums = campaign(Sums::new(1), 3000, |_| {});
    assert!(sums.shared > sums.layouts / 2 && sums.accepted > sums.programs / 2, "{sums:?}");
}

#[test]
fn a_line_of_progress_is_read_whole_or_not_at_all() {
    let sums = campaign(Sums::new(5), 10, |_| {});
    let line = sums.line();
    assert_eq!(Sums::read(&line).expect("whole").line(), line);
    (0..line.len()).for_each(|end| assert!(Sums::read(&line[..end]).is_none(), "{}", &line[..end]));
}

#[test]
#[ignore = "a campaign: minutes to hours"]
fn many_programs() {
    let number = |name: &str, default: u64| {
        std::env::var(name)
            .map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}: expected a number, found {text}")))
    };
    let (seed, wanted) = (number("ELUNAR_SEED", 1), number("ELUNAR_LAYOUTS", 100_000));
    let path = std::env::var("ELUNAR_PROGRESS").ok();
    let earlier = path.as_ref().and_then(|path| std::fs::read_to_string(path).ok()).unwrap_or_default();
    let from = earlier.lines().rev().find_map(Sums::read).unwrap_or_else(|| Sums::new(seed));
    assert_eq!(from.first, seed, "the progress file is of another seed");
    let mut file = path.map(|path| std::fs::OpenOptions::new().create(true).append(true).open(path).expect("a file"));
    let sums = campaign(from, wanted, |sums| {
        println!("{}", sums.line());
        if let Some(file) = &mut file {
            writeln!(file, "{}", sums.line()).expect("room for a line");
        }
    });
    assert!(sums.shared > sums.layouts / 2, "{sums:?}");
}
