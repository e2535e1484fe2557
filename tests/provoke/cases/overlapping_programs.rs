//! Random programs whose tensors share bytes compute what they compute apart, with every kernel, in memory between pages that must not be
//! touched. The campaign of many programs is a command:
//!
//! ```sh
//! ELUNAR_SEED=1 ELUNAR_PROGRAMS=100000 cargo test --release -p elunar-provoke --test overlapping_programs -- --ignored --nocapture
//! ```
#![allow(unsafe_code)] // pages of the operating system

use elunar_core::nn::ModelError;
use elunar_provoke::Random;
use elunar_provoke::programs::{Judged, judge, pair};
use std::collections::BTreeMap;
use std::time::Instant;

/// Memory that ends, or begins, where the next page may not be touched; elsewhere than on Unix, plain memory.
mod pages {
    /// More than the largest arena.
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

    /// Returns a function that lends this much memory, filled with a byte: now at the end, now at the start.
    pub(super) fn lender() -> impl FnMut(usize, u8) -> &'static mut [u8] {
        let (base, mut turn) = (new(), 0usize);
        move |len, fill| {
            assert!(len <= BYTES, "{len}");
            turn += 1;
            let start = if turn.is_multiple_of(4) { 0 } else { BYTES - len };
            // SAFETY: within the pages, which are never given back; a run ends before the next begins.
            let memory = unsafe { std::slice::from_raw_parts_mut(base.add(start), len) };
            memory.fill(fill);
            memory
        }
    }
}

/// Judges pairs until `wanted` of them ran; returns how many share bytes.
fn campaign(seed: u64, wanted: usize) -> usize {
    let (mut made, mut ran, mut sharing, mut all_runs) = (0u64, 0, 0, 0);
    let (begin, mut lend, mut at) = (Instant::now(), pages::lender(), seed);
    let mut reasons = BTreeMap::new();
    let reason = |what: &str, error: ModelError| {
        let text: String = error.to_string().chars().filter(|c| !c.is_ascii_digit()).collect();
        format!("{what}: {text}")
    };
    while ran < wanted {
        // Neighbouring seeds must not give neighbouring numbers.
        let mut random = Random(at.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        (0..4).for_each(|_| _ = random.number());
        at += 1;
        if at.is_multiple_of(100_000) {
            println!("seed {at}, {ran} accepted, {:?}", begin.elapsed());
        }
        let Some(pair) = pair(&mut random) else { continue };
        made += 1;
        let judged = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| judge(&pair, &mut random, &mut lend)));
        match judged.unwrap_or_else(|_| panic!("seed {}", at - 1)) {
            Judged::Illegal(error) => *reasons.entry(reason("illegal", error)).or_insert(0) += 1,
            Judged::Refused(error) => *reasons.entry(reason("refused", error)).or_insert(0) += 1,
            Judged::Ran { shared, runs } => {
                (ran, all_runs, sharing) = (ran + 1, all_runs + runs, sharing + usize::from(shared));
            }
        }
    }
    println!("{reasons:?}");
    println!(
        "seeds {seed}..{at}: {made} programs, {ran} accepted, {sharing} with shared bytes, {all_runs} runs, {:?}",
        begin.elapsed()
    );
    sharing
}

#[test]
fn programs_that_share_bytes_compute_what_they_compute_apart() {
    let wanted = 300;
    let sharing = campaign(1, wanted);
    assert!(sharing > wanted / 2, "{sharing}");
}

#[test]
#[ignore = "a campaign: minutes to hours"]
fn many_programs() {
    let number = |name: &str, default: u64| {
        std::env::var(name)
            .map_or(default, |text| text.parse().unwrap_or_else(|_| panic!("{name}: expected a number, found {text}")))
    };
    let wanted = number("ELUNAR_PROGRAMS", 100_000) as usize;
    assert!(campaign(number("ELUNAR_SEED", 1), wanted) > wanted / 2);
}
