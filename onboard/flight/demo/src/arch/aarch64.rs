//! A processor of the A profile in 64-bit state, started by the boot ROM at exception level 3.

use core::arch::global_asm;

// With the memory management unit off, all memory is device memory, and unaligned accesses fault. Therefore there is an identity map of 4
// GiB: the lower 2 GiB as cached memory (DDR), the upper 2 GiB as devices, in one table of four blocks.
global_asm!(
    r#"
    .section .text._start, "ax", %progbits
    .global _start
_start:
    mrs  x0, mpidr_el1
    and  x0, x0, #0xff
    cbnz x0, 9f                   // one core works, the others sleep
    ldr  x0, =__stack_top
    mov  sp, x0
    adr  x0, aarch64_vectors
    msr  vbar_el3, x0
    msr  cptr_el3, xzr            // no trap on floating point and vectors

    ldr  x0, =aarch64_map
    msr  ttbr0_el3, x0
    ldr  x0, =0x80803520          // 4 GiB of addresses, 4 KiB granule, cached table walks
    msr  tcr_el3, x0
    mov  x0, #0xff                // attribute 0: normal memory, write-back; attribute 1: device
    msr  mair_el3, x0
    tlbi alle3
    dsb  sy
    isb
    mrs  x0, sctlr_el3
    orr  x0, x0, #(1 << 0)        // memory management unit
    orr  x0, x0, #(1 << 2)        // data cache
    orr  x0, x0, #(1 << 12)       // instruction cache
    bic  x0, x0, #(1 << 1)        // unaligned accesses are allowed
    msr  sctlr_el3, x0
    isb

    ldr  x0, =__bss_start
    ldr  x1, =__bss_end
1:  cmp  x0, x1
    b.hs 2f
    str  xzr, [x0], #8
    b    1b
2:  bl   elunar_main
9:  wfe
    b    9b
    .ltorg

    .balign 2048
aarch64_vectors:
    .rept 16
    .balign 128
    mrs  x0, esr_el3              // why
    mrs  x1, elr_el3              // where
    b    elunar_fault
    .endr

    .section .rodata.aarch64_map, "a", %progbits
    .balign 4096
aarch64_map:                      // block | accessed | inner shareable | attribute
    .quad 0x00000000 | 0x701
    .quad 0x40000000 | 0x701
    .quad 0x80000000 | 0x405 | (1 << 54)
    .quad 0xc0000000 | 0x405 | (1 << 54)
"#
);
