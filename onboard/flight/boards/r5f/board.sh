# Cortex-R5F. QEMU 7 starts no machine of a Zynq UltraScale+ on its R5F, so the core sits in a Versatile board, whose memory also begins at 0.
target=armv7r-none-eabihf
flags=(-C target-cpu=cortex-r5)
qemu=(qemu-system-arm -M versatilepb -cpu cortex-r5f -m 256M -net none -nographic -monitor none -serial none -semihosting-config enable=on,target=native)
