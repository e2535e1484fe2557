//! Cortex-M: the vector table and its handlers.

use core::arch::global_asm;

// Coprocessors 10 and 11 are the floating-point unit and, on the M55, Helium. Without access to them the first vector instruction faults.
global_asm!(
    r#"
    .section .vectors, "a", %progbits
    .balign 128
    .word __stack_top
    .word _start
    .rept 14
    .word cortex_m_fault
    .endr

    .section .text._start, "ax", %progbits
    .thumb
    .global _start
    .type _start, %function
    .thumb_func
_start:
    ldr  r0, =0xE000ED88          @ CPACR: full access to coprocessors 10 and 11
    ldr  r1, [r0]
    orr  r1, r1, #(0xf << 20)
    str  r1, [r0]
    dsb
    isb
    ldr  r0, =__bss_start
    ldr  r1, =__bss_end
    movs r2, #0
1:  cmp  r0, r1
    bhs  2f
    str  r2, [r0], #4
    b    1b
2:  bl   elunar_main

    .global cortex_m_fault
    .type cortex_m_fault, %function
    .thumb_func
cortex_m_fault:
    ldr  r0, =0xE000ED28          @ CFSR: why
    ldr  r0, [r0]
    ldr  r1, [sp, #24]            @ the stacked program counter: where
    bl   elunar_fault
    .ltorg
"#
);
