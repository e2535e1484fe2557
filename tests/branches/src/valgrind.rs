//! Valgrind's client requests (`valgrind.h`, `memcheck.h`): a sequence of instructions that does nothing on a processor.

/// `VG_USERREQ__RUNNING_ON_VALGRIND`.
const RUNNING_ON_VALGRIND: usize = 0x1001;
/// `VG_USERREQ__MAKE_MEM_UNDEFINED`, the second request of the tool "MC".
const MAKE_MEM_UNDEFINED: usize = (b'M' as usize) << 24 | (b'C' as usize) << 16 | 1;

/// Returns Valgrind's answer; 0 without Valgrind.
#[cfg(all(target_arch = "x86_64", unix))]
#[allow(unsafe_code)]
fn request(request: usize, first: usize, second: usize) -> usize {
    let words = [request, first, second, 0, 0, 0];
    let mut answer = 0usize;
    // SAFETY: the rotations of rdi add up to 128 bits and rbx is exchanged with itself, so nothing changes but flags; Valgrind reads the
    // words and sets rdx.
    unsafe {
        core::arch::asm!(
            "rol rdi, 3", "rol rdi, 13", "rol rdi, 61", "rol rdi, 51", "xchg rbx, rbx",
            in("rax") &raw const words, inout("rdx") answer, inout("rdi") 0usize => _,
        );
    }
    answer
}

#[cfg(not(all(target_arch = "x86_64", unix)))]
fn request(_: usize, _: usize, _: usize) -> usize {
    0
}

/// Returns whether Valgrind runs this program.
pub(crate) fn is_running() -> bool {
    request(RUNNING_ON_VALGRIND, 0, 0) > 0
}

/// Makes `bytes` bytes from an address on undefined for Memcheck. Their values stay.
pub(crate) fn undefine(address: usize, bytes: usize) {
    request(MAKE_MEM_UNDEFINED, address, bytes);
}
