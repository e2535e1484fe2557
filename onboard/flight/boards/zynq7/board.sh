# Xilinx Zynq-7000: Cortex-A9 with NEON.
target=armv7a-none-eabihf
# Aligned accesses: as for zcu102.
flags=(-C target-cpu=cortex-a9 -C "target-feature=+neon,-strict-align")
qemu=(qemu-system-arm -M xilinx-zynq-a9 -m 512M -nographic -monitor none -serial none -semihosting-config enable=on,target=native)
