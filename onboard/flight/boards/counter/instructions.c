/* A QEMU TCG plugin that counts the guest's instructions between two places of the program, or of all of it.
 *
 *   cc -O2 -shared -fPIC -DAPI=1 -o instructions.so instructions.c
 *   qemu-system-... -plugin ./instructions.so,start=0x1234,stop=0x5678,out=counts.txt
 *
 *   qemu-aarch64 -plugin ./instructions.so,out=count.txt PROGRAM
 *
 * start, stop: addresses of functions. Whenever the second is entered, a line with the number of instructions executed since
 * the first was entered is written to `out`; without both, one line at the end of the program. The count is the sum of the
 * lengths of executed translated blocks, so a block that a trap leaves early counts whole (on SPARC: some instructions per
 * spilled register window). Only the running processor is counted.
 *
 * API: plugin.h. */
#include "plugin.h"

#include <inttypes.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t start_address, stop_address;
static uint64_t count;
static FILE *out;

static void add(unsigned cpu, void *instructions)
{
    (void)cpu;
    count += (uintptr_t)instructions;
}

static void start(unsigned cpu, void *instructions)
{
    (void)cpu;
    (void)instructions;
    count = 0;
}

static void stop(unsigned cpu, void *instructions)
{
    (void)cpu;
    (void)instructions;
    fprintf(out, "%" PRIu64 "\n", count);
}

/* A called function begins a new block, so only the first address of each block is checked. */
static void translated(plugin_id id, struct qemu_plugin_tb *block)
{
    (void)id;
    uint64_t address = qemu_plugin_tb_vaddr(block);
    void *instructions = (void *)(uintptr_t)qemu_plugin_tb_n_insns(block);
    void (*what)(unsigned, void *) = address == start_address ? start : address == stop_address ? stop : add;
    qemu_plugin_register_vcpu_tb_exec_cb(block, what, NO_REGISTERS, instructions);
}

static void finish(plugin_id id, void *unused)
{
    (void)id;
    (void)unused;
    if (!start_address)
        fprintf(out, "%" PRIu64 "\n", count);
    fclose(out);
}

EXPORT int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv)
{
    (void)info;
    for (int i = 0; i < argc; i++) {
        if (!strncmp(argv[i], "start=", 6)) /* bit 0 of an Arm function's address says Thumb */
            start_address = strtoull(argv[i] + 6, NULL, 0) & ~UINT64_C(1);
        else if (!strncmp(argv[i], "stop=", 5))
            stop_address = strtoull(argv[i] + 5, NULL, 0) & ~UINT64_C(1);
        else if (!strncmp(argv[i], "out=", 4) && !out)
            out = fopen(argv[i] + 4, "w");
    }
    if (!start_address != !stop_address || !out) {
        fprintf(stderr, "ERROR: expected [start=ADDRESS,stop=ADDRESS,]out=FILE\n");
        return 1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, finish, NULL);
    return 0;
}
