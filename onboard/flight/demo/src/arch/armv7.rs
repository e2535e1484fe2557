//! 32-bit Arm of the A and the R profile: Cortex-A9, Cortex-R5F.

use core::arch::global_asm;

// Exceptions share one handler, because the demo can only report them. A processor of the R profile has its vectors at address 0, where its
// memory map puts this section; the A profile gets the address below.
global_asm!(
    r#"
    .section .vectors, "ax", %progbits
    .arm
    .balign 32
armv7_vectors:
    b    _start
    b    armv7_undefined
    b    armv7_call
    b    armv7_prefetch
    b    armv7_data
    b    .
    b    armv7_interrupt
    b    armv7_interrupt

    .section .text._start, "ax", %progbits
    .arm
    .global _start
    .type _start, %function
_start:
    cpsid if, #0x13               @ supervisor, no interrupts
    ldr  sp, =__stack_top
    mrc  p15, 0, r0, c1, c0, 2    @ CPACR: full access to coprocessors 10 and 11, floating point and vectors
    orr  r0, r0, #(0xf << 20)
    mcr  p15, 0, r0, c1, c0, 2
    isb
    mov  r0, #(1 << 30)
    .inst 0xeee80a10              @ vmsr fpexc, r0: and on
    ldr  r0, =__bss_start
    ldr  r1, =__bss_end
    mov  r2, #0
1:  cmp  r0, r1
    bhs  2f
    str  r2, [r0], #4
    b    1b
2:  bl   armv7_memory
    bl   elunar_main

armv7_undefined:
    mov  r0, #1
    b    armv7_fault
armv7_call:
    mov  r0, #2
    b    armv7_fault
armv7_prefetch:
    mov  r0, #3
    b    armv7_fault
armv7_data:
    mov  r0, #4
    b    armv7_fault
armv7_interrupt:
    mov  r0, #6
armv7_fault:                      @ r0: the vector's number
    mov  r1, lr                   @ where, up to two instructions later
    cps  #0x13
    ldr  sp, =__stack_top
    bl   elunar_fault
    .ltorg
"#
);

// With the memory management unit off, all memory is device memory, and unaligned accesses fault. Therefore there is an identity map of
// 4096 sections of 1 MiB: the first GiB (DDR) as cached memory, the rest as devices. The boot ROM leaves the caches invalidated.
#[cfg(target_feature = "aclass")]
global_asm!(
    r#"
    .section .text._start, "ax", %progbits
    .arm
armv7_memory:
    ldr  r0, =armv7_vectors
    mcr  p15, 0, r0, c12, c0, 0   @ VBAR
    ldr  r0, =armv7_map
    ldr  r1, =0x1c0e              @ section, any access, normal memory, write-back
    ldr  r2, =0x0c16              @ section, any access, device, never executed
    mov  r3, #0
1:  cmp  r3, #(1 << 30 >> 20)
    orrlo r12, r1, r3, lsl #20
    orrhs r12, r2, r3, lsl #20
    str  r12, [r0, r3, lsl #2]
    add  r3, r3, #1
    cmp  r3, #4096
    blo  1b
    dsb
    mcr  p15, 0, r0, c2, c0, 0    @ TTBR0: the map
    mov  r0, #0
    mcr  p15, 0, r0, c2, c0, 2    @ TTBCR: for all addresses
    mcr  p15, 0, r0, c8, c7, 0    @ TLBIALL
    mcr  p15, 0, r0, c7, c5, 0    @ ICIALLU
    mov  r0, #1
    mcr  p15, 0, r0, c3, c0, 0    @ DACR: as the map says
    dsb
    isb
    mrc  p15, 0, r0, c1, c0, 0    @ SCTLR
    orr  r0, r0, #(1 << 0)        @ memory management unit
    orr  r0, r0, #(1 << 2)        @ data cache
    orr  r0, r0, #(1 << 12)       @ instruction cache
    bic  r0, r0, #(1 << 1)        @ unaligned accesses are allowed
    mcr  p15, 0, r0, c1, c0, 0
    isb
    bx   lr
    .ltorg

    .section .bss.armv7_map, "aw", %nobits
    .balign 16384
armv7_map:
    .space 16384
"#
);

// With the memory protection unit off, the lower half of the addresses is normal memory, where unaligned accesses are allowed.
#[cfg(not(target_feature = "aclass"))]
global_asm!(
    r#"
    .section .text._start, "ax", %progbits
    .arm
armv7_memory:
    bx   lr
"#
);
