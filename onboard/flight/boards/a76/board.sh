# QEMU virt: Cortex-A76, for the dot-product extension.
target=aarch64-unknown-none
# Aligned accesses: as for zcu102.
flags=(-C target-cpu=cortex-a76 -C target-feature=-strict-align)
qemu=(qemu-system-aarch64 -M virt,secure=on,virtualization=on -cpu cortex-a76 -m 1G -nographic -net none -monitor none -serial none -semihosting-config enable=on,target=native)
