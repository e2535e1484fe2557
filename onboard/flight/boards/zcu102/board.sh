# Xilinx ZCU102: Cortex-A53.
target=aarch64-unknown-none
# The target assumes that every access must be aligned; with the memory management unit on (../../demo/src/arch) none must.
flags=(-C target-cpu=cortex-a53 -C target-feature=-strict-align)
qemu=(qemu-system-aarch64 -M xlnx-zcu102,secure=on -m 2G -nographic -monitor none -serial none -semihosting-config enable=on,target=native)
