# MPC8544DS with an e500mc core: PowerPC, Book E, big-endian.
target=powerpc-unknown-linux-gnu
# Rust knows no PowerPC target without operating system; nothing of Linux is linked, so the copies and fills that a C library would
# bring come from Rust's own.
features_of_core=compiler-builtins-mem
flags=(-C target-cpu=e500mc -C relocation-model=static -C target-feature=+crt-static)
qemu=(qemu-system-ppc -M mpc8544ds -cpu e500mc -m 256M -net none -nographic -monitor none -serial stdio -no-reboot)
load=-bios       # what QEMU calls a program to start here
exit_status=no   # always 0: the last line on the console decides
