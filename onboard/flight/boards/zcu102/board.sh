# Xilinx ZCU102: Cortex-A53.
target=aarch64-unknown-none
flags=(-C target-cpu=cortex-a53)
qemu=(qemu-system-aarch64 -M xlnx-zcu102,secure=on -m 2G -nographic -monitor none -serial none -semihosting-config enable=on,target=native)
