# QEMU virt: RISC-V 32 (rv32imac), a processor without floating-point unit: an instruction for one would be a fault.
target=riscv32imac-unknown-none-elf
flags=()
qemu=(qemu-system-riscv32 -M virt -cpu "rv32,f=off,d=off" -m 1G -bios none -nographic -monitor none -serial none -semihosting-config enable=on,target=native)
soft_float=yes
