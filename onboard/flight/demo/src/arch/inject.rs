//! A timer that interrupts the work once and flips a bit of it: Cortex-M7 (SysTick) and RISC-V 64 (the timer of QEMU's `virt`).
//!
//! With QEMU's `-icount` the timers count instructions, so that an injection can be made again from its numbers. The handler runs on a stack of
//! its own where it can; the stack pointer of the Cortex-M7, which its handler works on, is not flipped.

use core::sync::atomic::{AtomicUsize, Ordering::Relaxed};

/// What is flipped: classes of an injection.
const REGISTER: usize = 1;
const STACK: usize = 2;
const CODE: usize = 3;
/// After the flip: the next interrupt finds that the tile does not end.
const LATE: usize = 4;

/// Class, place and bit of the injection.
static CLASS: AtomicUsize = AtomicUsize::new(0);
static PLACE: AtomicUsize = AtomicUsize::new(0);
static BIT: AtomicUsize = AtomicUsize::new(0);
/// Ticks that the tile may take after the flip.
static LIMIT: AtomicUsize = AtomicUsize::new(0);
/// Where the stack of the library's caller begins.
static CALLER: AtomicUsize = AtomicUsize::new(0);
/// Ticks that are left, beyond the period that runs.
#[cfg(target_arch = "arm")]
static LEFT: AtomicUsize = AtomicUsize::new(0);

unsafe extern "C" {
    static __text_start: u8;
    static __text_end: u8;
}

/// Returns the program's code.
pub(crate) fn code() -> &'static [u8] {
    let (start, end) = (&raw const __text_start, &raw const __text_end);
    // SAFETY: the linker script puts the code there. It changes by an injection alone, in an interrupt outside of any reading.
    unsafe { core::slice::from_raw_parts(start, end as usize - start as usize) }
}

/// An injection: a flipped bit at a moment.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Injection {
    /// Ticks of the timer from the start of the tile.
    pub(crate) when: usize,
    /// 0 nothing, 1 a register, 2 the stack, 3 the code.
    pub(crate) class: usize,
    /// Number of the register; bytes from the stack pointer, or from 128 bytes before the instruction.
    pub(crate) place: usize,
    /// The bit, 0 for the lowest.
    pub(crate) bit: usize,
    /// Ticks that the tile may take after it.
    pub(crate) limit: usize,
}

/// Starts the timer.
#[inline(never)]
pub(crate) fn start(injection: Injection) {
    let mark = 0usize;
    CALLER.store(&raw const mark as usize, Relaxed);
    PLACE.store(injection.place, Relaxed);
    BIT.store(injection.bit, Relaxed);
    LIMIT.store(injection.limit, Relaxed);
    CLASS.store(injection.class, Relaxed);
    timer::start(injection.when);
}

/// Stops the timer; returns the ticks since the start.
#[inline(never)]
pub(crate) fn stop() -> usize {
    CLASS.store(0, Relaxed);
    timer::stop()
}

/// Flips the bit: `register` returns the place of a register, `stack` is the interrupted stack pointer, `at` the interrupted instruction.
fn flip(register: impl FnOnce(usize) -> *mut usize, stack: usize, at: usize) {
    let (class, place, bit) = (CLASS.swap(LATE, Relaxed), PLACE.load(Relaxed), BIT.load(Relaxed));
    let flip_byte = |address: usize| {
        let byte = address as *mut u8;
        // SAFETY: within the stack or the code; to damage them is what the program is for.
        unsafe { byte.write_volatile(byte.read_volatile() ^ 1 << (bit % 8)) };
    };
    match class {
        REGISTER => {
            let word = register(place);
            // SAFETY: a saved register.
            unsafe { word.write_volatile(word.read_volatile() ^ 1 << (bit as u32 % usize::BITS)) };
        }
        // The library's frames alone: those below its caller's.
        STACK => flip_byte(stack + place % CALLER.load(Relaxed).saturating_sub(stack).clamp(1, 2048)),
        CODE => {
            let all = code().as_ptr_range();
            let address = (at + place).wrapping_sub(128);
            flip_byte(address.clamp(all.start as usize, all.end as usize - 1));
        }
        LATE => super::hang(),
        _ => (),
    }
}

#[cfg(target_arch = "arm")]
mod timer {
    use super::{LEFT, LIMIT, Relaxed, flip};
    use core::arch::global_asm;

    /// Control, reload and value of SysTick; the table of vectors.
    const CSR: *mut u32 = 0xe000_e010_usize as _;
    const RVR: *mut u32 = 0xe000_e014_usize as _;
    const CVR: *mut u32 = 0xe000_e018_usize as _;
    const VTOR: *mut u32 = 0xe000_ed08_usize as _;
    /// Ticks of a period: SysTick has 24 bits.
    const PERIOD: usize = 1 << 23;

    /// A table of vectors in memory that can be written.
    #[repr(align(128))]
    #[derive(Clone, Copy)]
    struct Vectors {
        words: [u32; 16],
    }
    static mut VECTORS: Vectors = Vectors { words: [0; 16] };
    /// Ticks of the periods that were begun.
    static mut BEGUN: usize = 0;

    unsafe extern "C" {
        fn cortex_m_tick();
    }

    // What the processor has stacked, and the other registers, go to the handler.
    global_asm!(
        r#"
    .section .text.cortex_m_tick, "ax", %progbits
    .thumb
    .global cortex_m_tick
    .type cortex_m_tick, %function
    .thumb_func
cortex_m_tick:
    mov  r0, sp
    mov  r2, lr
    push {{r4-r11, lr}}
    mov  r1, sp
    bl   elunar_tick
    pop  {{r4-r11, pc}}
    "#
    );

    #[unsafe(no_mangle)]
    extern "C" fn elunar_tick(stacked: *mut u32, others: *mut u32, return_code: u32) {
        if LEFT.load(Relaxed) > 0 {
            begin_period();
            return;
        }
        // SAFETY: the processor has stacked eight words (with floating point 26, and one more where it aligned them).
        let (at, has_floats, status) = unsafe { (*stacked.add(6), return_code & 1 << 4 == 0, *stacked.add(7)) };
        let words = if has_floats { 26 } else { 8 } + (status >> 9 & 1) as usize;
        let register = |number: usize| {
            // SAFETY: as above: r0 to r3, r12, lr, pc; the handler has saved r4 to r11.
            unsafe {
                match number % 15 {
                    low @ 0..4 => stacked.add(low),
                    middle @ 4..12 => others.add(middle - 4),
                    high => stacked.add(high - 8),
                }
            }
            .cast()
        };
        flip(register, stacked as usize + 4 * words, at as usize);
        LEFT.store(LIMIT.load(Relaxed), Relaxed);
        begin_period();
    }

    fn begin_period() {
        let ticks = LEFT.load(Relaxed).min(PERIOD);
        LEFT.fetch_sub(ticks, Relaxed);
        // SAFETY: registers of this processor; the interrupt, which writes the count too, is off or this one.
        unsafe {
            BEGUN += ticks;
            RVR.write_volatile(ticks.max(1) as u32);
            CVR.write_volatile(0);
            CSR.write_volatile(7);
        }
    }

    pub(super) fn start(when: usize) {
        // SAFETY: one thread, no interrupt yet; the board's table has 16 words at address 0.
        unsafe {
            let table = (&raw mut VECTORS.words).cast::<u32>();
            for k in 0..16 {
                // Address 0 is the table's, which Rust's pointers to nothing are not.
                let word: u32;
                core::arch::asm!("ldr {}, [{}]", out(reg) word, in(reg) 4 * k, options(readonly, nostack));
                table.add(k).write_volatile(word);
            }
            table.add(15).write_volatile(cortex_m_tick as *const () as u32);
            VTOR.write_volatile(table as u32);
            BEGUN = 0;
        }
        LEFT.store(when, Relaxed);
        begin_period();
    }

    pub(super) fn stop() -> usize {
        // SAFETY: registers of this processor.
        unsafe {
            let value = CVR.read_volatile();
            CSR.write_volatile(0);
            BEGUN - value as usize
        }
    }
}

#[cfg(target_arch = "riscv64")]
mod timer {
    use super::{LIMIT, Relaxed, flip};
    use core::arch::{asm, global_asm};

    /// The timer of QEMU's `virt`: compared time, and time.
    const COMPARE: *mut u64 = 0x0200_4000_usize as _;
    const TIME: *mut u64 = 0x0200_bff8_usize as _;
    static mut STARTED: u64 = 0;

    unsafe extern "C" {
        fn riscv_tick();
    }

    // All registers go to memory; the handler has a stack of its own.
    global_asm!(
        r#"
    .section .bss.riscv_saved, "aw", @nobits
    .balign 16
riscv_saved:
    .space 256
    .space 4096
riscv_tick_stack:

    .section .text.riscv_tick, "ax", @progbits
    .balign 4
    .global riscv_tick
riscv_tick:
    csrw mscratch, t0
    la   t0, riscv_saved
    .irp n, 1,2,3,4,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20,21,22,23,24,25,26,27,28,29,30,31
    sd   x\n, 8*\n(t0)
    .endr
    csrr t1, mscratch
    sd   t1, 40(t0)
    csrr a0, mcause
    bltz a0, 1f
    csrr a1, mepc
    la   sp, riscv_tick_stack
    j    elunar_fault
1:  csrr t1, mepc
    sd   t1, 0(t0)
    la   sp, riscv_tick_stack
    mv   a0, t0
    call elunar_tick
    la   t0, riscv_saved
    ld   t1, 0(t0)
    csrw mepc, t1
    ld   t1, 40(t0)
    csrw mscratch, t1
    .irp n, 1,2,3,4,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20,21,22,23,24,25,26,27,28,29,30,31
    ld   x\n, 8*\n(t0)
    .endr
    csrr t0, mscratch
    mret
    "#
    );

    /// `saved`: the instruction, then registers 1 to 31.
    #[unsafe(no_mangle)]
    extern "C" fn elunar_tick(saved: *mut usize) {
        // SAFETY: a register of this board; the trap has saved 32 words.
        let (at, stack) = unsafe {
            COMPARE.write_volatile(TIME.read_volatile() + LIMIT.load(Relaxed) as u64);
            (*saved, *saved.add(2))
        };
        // SAFETY: as above.
        flip(|number| unsafe { saved.add(number % 32) }, stack, at);
    }

    pub(super) fn start(when: usize) {
        // SAFETY: registers of this board and of its only processor.
        unsafe {
            STARTED = TIME.read_volatile();
            COMPARE.write_volatile(STARTED.saturating_add(when as u64));
            asm!("csrw mtvec, {}", "csrs mie, {}", "csrsi mstatus, 8", in(reg) riscv_tick as *const () as usize, in(reg) 1usize << 7);
        }
    }

    pub(super) fn stop() -> usize {
        // SAFETY: as above.
        unsafe {
            asm!("csrci mstatus, 8");
            (TIME.read_volatile() - STARTED) as usize
        }
    }
}
