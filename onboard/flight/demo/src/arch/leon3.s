! Start-up of a LEON3: SPARC V8 with 8 register windows. Registers and traps as in The SPARC Architecture Manual, version 8.

        WINDOWS = 8

        ! A trap arrives in a fresh window with the program counters in %l1 and %l2. Four instructions per entry.
        .macro  entry handler, number
        rd      %wim, %l3
        sethi   %hi(\handler), %l4
        jmp     %l4 + %lo(\handler)
        mov     \number, %l0
        .endm

        .section .vectors, "ax", @progbits
        .align  4096
leon3_traps:
        number = 0
        .rept   256
        .if     number == 0
        entry   _start, 0
        .elseif number == 5
        entry   leon3_spill, 5
        .elseif number == 6
        entry   leon3_fill, 6
        .else
        entry   leon3_fault, number
        .endif
        number = number + 1
        .endr

        .section .text._start, "ax", @progbits
        .global _start
_start:
        wr      %g0, 0xfc0, %psr        ! supervisor, interrupts masked, traps off, window 0
        nop
        nop
        nop
        wr      %g0, 2, %wim            ! window 1 is the guard: the seventh call from here spills
        set     leon3_traps, %g1
        wr      %g1, %tbr
        nop
        nop
        nop
        set     0x1fe0, %g1             ! floating point and traps on
        wr      %g1, %psr
        nop
        nop
        nop
        set     __bss_start, %g1
        set     __bss_end, %g2
1:      cmp     %g1, %g2
        bgeu    2f
        nop
        st      %g0, [%g1]
        ba      1b
        add     %g1, 4, %g1
2:      set     __stack_top, %g1
        sub     %g1, 96, %sp            ! room for one window and the arguments, as every frame has it
        mov     %g0, %fp
        call    elunar_main
        nop

! `save` ran into the guard: move the guard one window on and store the window found there on its own stack.
leon3_spill:
        mov     %g1, %l7
        srl     %l3, 1, %g1             ! the guard, rotated right
        sll     %l3, WINDOWS - 1, %l4
        or      %g1, %l4, %g1
        save
        wr      %g1, %wim
        nop
        nop
        nop
        std     %l0, [%sp]
        std     %l2, [%sp + 8]
        std     %l4, [%sp + 16]
        std     %l6, [%sp + 24]
        std     %i0, [%sp + 32]
        std     %i2, [%sp + 40]
        std     %i4, [%sp + 48]
        std     %i6, [%sp + 56]
        restore
        mov     %l7, %g1
        jmp     %l1
        rett    %l2

! `restore` ran into the guard: move the guard one window back and load the window it uncovers.
leon3_fill:
        sll     %l3, 1, %l4             ! the guard, rotated left
        srl     %l3, WINDOWS - 1, %l5
        or      %l4, %l5, %l5
        wr      %l5, %wim
        nop
        nop
        nop
        restore
        restore
        ldd     [%sp], %l0
        ldd     [%sp + 8], %l2
        ldd     [%sp + 16], %l4
        ldd     [%sp + 24], %l6
        ldd     [%sp + 32], %i0
        ldd     [%sp + 40], %i2
        ldd     [%sp + 48], %i4
        ldd     [%sp + 56], %i6
        save
        save
        jmp     %l1
        rett    %l2

! Any other trap: no window is left to return to, so start afresh on a clean set and report.
leon3_fault:
        mov     %l0, %g2
        mov     %l1, %g3
        wr      %g0, 0xfc0, %psr
        nop
        nop
        nop
        wr      %g0, 2, %wim
        set     0x1fe0, %g1
        wr      %g1, %psr
        nop
        nop
        nop
        set     __stack_top, %g1
        sub     %g1, 96, %sp
        mov     %g2, %o0
        call    elunar_fault
        mov     %g3, %o1
