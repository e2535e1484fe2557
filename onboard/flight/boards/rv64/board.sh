# QEMU virt: RISC-V 64 (rv64gc).
target=riscv64gc-unknown-none-elf
flags=()
qemu=(qemu-system-riscv64 -M virt -m 1G -bios none -nographic -monitor none -serial none -semihosting-config enable=on,target=native)
