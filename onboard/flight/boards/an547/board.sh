# ARM MPS3 with AN547: Cortex-M55 (Helium).
target=thumbv8m.main-none-eabihf
flags=(-C target-cpu=cortex-m55)
qemu=(qemu-system-arm -M mps3-an547 -nographic -monitor none -serial none -semihosting-config enable=on,target=native)
