//! RISC-V in machine mode.

use core::arch::global_asm;

global_asm!(
    r#"
    .section .text._start, "ax", %progbits
    .global _start
_start:
    csrr t0, mhartid
    bnez t0, 9f                   // one hart works, the others sleep
    la   t0, riscv_trap
    csrw mtvec, t0
    li   t0, 0x2000               // mstatus.FS: floating point on
    csrs mstatus, t0
    la   sp, __stack_top
    la   t0, __bss_start
    la   t1, __bss_end
1:  bgeu t0, t1, 2f
    sw   zero, 0(t0)
    addi t0, t0, 4
    j    1b
2:  call elunar_main
9:  wfi
    j    9b

    .balign 4
riscv_trap:
    csrr a0, mcause
    csrr a1, mepc
    j    elunar_fault
"#
);
