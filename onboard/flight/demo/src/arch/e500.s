# Start-up of an e500 core: Book E, where addresses are always translated. The boot loader (here QEMU) hands over with one map entry
# from address 0 on that covers the program. Registers as in Freescale's EREF; by number, since assemblers do not name them all.


        # Every exception arrives here, at IVPR + 0: report why and where.
        .section .vectors, "ax", @progbits
        .balign 65536
e500_fault:
        mfspr   3, 62                   # ESR
        mfspr   4, 26                   # SRR0
        lis     1, __stack_top@ha
        addi    1, 1, __stack_top@l
        addi    1, 1, -16
        b       elunar_fault

        # Fills entry \entry of the second map: \pages is log2 of its KiB, \attributes 0 (cached memory) or 0xa (devices, not cached).
        .macro  map entry, pages, address, attributes
        lis     3, 0x1000 + \entry
        mtspr   624, 3                  # MAS0: which entry
        lis     3, 0xc000
        ori     3, 3, \pages << 7
        mtspr   625, 3                  # MAS1: valid, kept, size
        lis     3, \address >> 16
        ori     3, 3, \attributes
        mtspr   626, 3                  # MAS2: from where
        lis     3, \address >> 16
        ori     3, 3, 0x15
        mtspr   627, 3                  # MAS3: to where; read, write, execute as supervisor
        li      3, 0
        mtspr   944, 3                  # MAS7
        isync
        tlbwe
        isync
        .endm

        .section .text._start, "ax", @progbits
        .global _start
_start:
        map     1, 14, 0xe0000000, 0xa  # 16 MiB of device registers
        map     2, 16, 0x08000000, 0    # 64 MiB for model and arena
        lis     3, e500_fault@ha
        addi    3, 3, e500_fault@l
        mtspr   63, 3                   # IVPR
        li      3, 0
        .irp    vector, 400, 401, 402, 403, 404, 405, 406, 407, 408, 409, 410, 411, 412, 413, 414, 415
        mtspr   \vector, 3              # IVOR0 to IVOR15
        .endr
        mfmsr   3
        ori     3, 3, 0x2000            # floating point on
        mtmsr   3
        isync
        lis     3, __bss_start@ha
        addi    3, 3, __bss_start@l
        lis     4, __bss_end@ha
        addi    4, 4, __bss_end@l
        li      0, 0
1:      cmplw   3, 4
        bge     2f
        stw     0, 0(3)
        addi    3, 3, 4
        b       1b
2:      lis     1, __stack_top@ha
        addi    1, 1, __stack_top@l
        addi    1, 1, -16               # room for the back chain and the link register
        stw     0, 0(1)
        bl      elunar_main
