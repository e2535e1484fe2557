# ARM MPS2 with AN500: Cortex-M7.
target=thumbv7em-none-eabihf
flags=(-C target-cpu=cortex-m7)
qemu=(qemu-system-arm -M mps2-an500 -nographic -monitor none -serial none -semihosting-config enable=on,target=native)
