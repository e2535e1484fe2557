//! Random calls, changed models and random programs on a board, as `tests/provoke` makes them: what flight software never does, and what the
//! library must refuse. Each run of a model has its own seed, so that runs differ.

use core::alloc::{GlobalAlloc, Layout};
use core::fmt::Write;
use core::ptr::null_mut;
use core::sync::atomic::{AtomicPtr, AtomicUsize, Ordering::Relaxed};
use elunar_capi::elunar_core::nn::Kernel;
use elunar_provoke::Random;
use elunar_provoke::c_abi::{Tally, c_abi};
use elunar_provoke::c_lines::c_lines;
use elunar_provoke::model::{kernels, mutated_model};
use elunar_provoke::programs::{Sizes, output, program};

/// Rounds of each kind of provocation.
const ROUNDS: usize = 40;

#[global_allocator]
static HEAP: Heap = Heap { first: AtomicPtr::new(null_mut()), bytes: AtomicUsize::new(0) };

/// Memory in blocks one behind the other, each with a [`Head`]; the first free one that is long enough is taken.
struct Heap {
    first: AtomicPtr<Head>,
    bytes: AtomicUsize,
}

/// What stands before a block.
#[repr(C, align(16))]
struct Head {
    /// Bytes of the block, with its head.
    bytes: usize,
    is_free: bool,
}

const HEAD: usize = size_of::<Head>();

impl Heap {
    /// Gives the heap its memory, once.
    fn lend(&self, memory: &'static mut [u8]) {
        let shift = memory.as_ptr().align_offset(HEAD).min(memory.len());
        let memory = &mut memory[shift..];
        let (bytes, first) = (memory.len() / HEAD * HEAD, memory.as_mut_ptr().cast::<Head>());
        assert!(bytes > HEAD, "expected memory for a heap, found {bytes} bytes");
        // SAFETY: aligned, long enough, and nobody else's.
        unsafe { first.write(Head { bytes, is_free: true }) };
        self.bytes.store(bytes, Relaxed);
        self.first.store(first, Relaxed);
    }
}

// SAFETY: blocks do not overlap, and are aligned to HEAD bytes; one processor without interrupts calls.
unsafe impl GlobalAlloc for Heap {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let (first, mut at) = (self.first.load(Relaxed), 0);
        let wanted = layout.size().div_ceil(HEAD) * HEAD + HEAD;
        let end = if layout.align() > HEAD || wanted < HEAD { 0 } else { self.bytes.load(Relaxed) };
        while at < end {
            // SAFETY: heads lie one behind the other up to the end of the memory, here and below.
            let head = unsafe { &mut *first.wrapping_byte_add(at) };
            while head.is_free && at + head.bytes < end {
                // SAFETY: as above; this head is another one.
                let next = unsafe { &*first.wrapping_byte_add(at + head.bytes) };
                if !next.is_free {
                    break;
                }
                head.bytes += next.bytes;
            }
            if head.is_free && head.bytes >= wanted {
                let rest = head.bytes - wanted;
                if rest > HEAD {
                    // SAFETY: within the free block.
                    unsafe { first.wrapping_byte_add(at + wanted).write(Head { bytes: rest, is_free: true }) };
                    head.bytes = wanted;
                }
                head.is_free = false;
                return first.wrapping_byte_add(at + HEAD).cast();
            }
            at += head.bytes;
        }
        null_mut()
    }

    unsafe fn dealloc(&self, block: *mut u8, _: Layout) {
        // SAFETY: `alloc` gave it, with a head before it.
        unsafe { (*block.wrapping_sub(HEAD).cast::<Head>()).is_free = true };
    }
}

/// Makes everything random that `tests/provoke` knows; a wrong answer is a panic. `memory` is lent to the allocator.
pub(crate) fn run(seed: u32, memory: &mut [u8], console: &mut impl Write) -> bool {
    // SAFETY: nothing else uses the arena from here to the end of the run.
    HEAP.lend(unsafe { core::slice::from_raw_parts_mut(memory.as_mut_ptr(), memory.len()) });
    let random = &mut Random::of_seed(seed.into());
    let (mut tally, mut lines) = (Tally::default(), Tally::default());
    for _ in 0..ROUNDS {
        let len = 20 + random.number() as usize % 400;
        add(&mut tally, c_abi(&random.bytes(len)));
    }
    // Strips are a quarter of these, and some of them refused.
    for _ in 0..3 * ROUNDS {
        let len = 200 + random.number() as usize % 4000;
        add(&mut lines, c_lines(&random.bytes(len)));
    }
    let _ = writeln!(console, "provoked: {} calls, {} refused, {} faults", tally.calls, tally.refused, tally.faults);
    let _ = writeln!(console, "provoked: {} calls of lines, {} refused", lines.calls, lines.refused);
    let (mut accepted, mut products, mut ran) = (0, 0, 0);
    for _ in 0..4 * ROUNDS {
        let patches = 1 + random.number() as usize % 3;
        accepted += usize::from(mutated_model(&random.bytes(1 + 10 * patches)));
        let len = random.number() as usize % 400;
        products += usize::from(kernels(&random.bytes(len)));
    }
    for _ in 0..ROUNDS {
        let Some(program) = program(random, &Sizes::SMALL) else { continue };
        let mut expected = None;
        for kernel in Kernel::available() {
            let found = output(&program, kernel).ok();
            assert!(*expected.get_or_insert(found) == found, "kernels differ");
            ran += usize::from(found.is_some());
        }
    }
    let _ = writeln!(console, "provoked: {accepted} changed models, {products} products, {ran} runs of programs");
    tally.refused.min(tally.faults).min(lines.refused).min(accepted).min(products).min(ran) > 0
}

fn add(tally: &mut Tally, one: Tally) {
    tally.calls += one.calls;
    tally.refused += one.refused;
    tally.faults += one.faults;
}
