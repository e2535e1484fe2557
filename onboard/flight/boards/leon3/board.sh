# GRLIB LEON3: SPARC V8, big-endian.
target=sparc-unknown-none-elf
# rustc's own linker does not know SPARC.
linker=(-C linker=sparc64-linux-gnu-ld -C linker-flavor=ld -C link-arg=-melf32_sparc)
flags=(-C target-cpu=leon3)
qemu=(qemu-system-sparc -M leon3_generic -m 1G -nographic -monitor none -serial stdio)
exit_status=no   # always 0: the last line on the console decides
