/* A QEMU TCG plugin that records where the guest goes after the last instruction of each block: for a conditional branch, its outcomes.
 *
 *   cc -O2 -shared -fPIC -DAPI=1 -o outcomes.so outcomes.c
 *   qemu-system-... -plugin ./outcomes.so,out=edges.txt
 *
 * At the end `out` has a line per place that was left: the address of a block's last instruction, and of the blocks that were entered next, as far
 * as there were no more than SUCCESSORS. Each conditional branch ends a translated block, a delayed one together with the instruction in its delay
 * slot. A trap or the end of a page also ends one: the reader of the file, outcomes.py, knows the program's branches and takes theirs alone. Only the
 * running processor is recorded.
 *
 * API: plugin.h. */
#include "plugin.h"

#include <inttypes.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SUCCESSORS = 8, BUCKETS = 1 << 16 };

/* The last instruction of blocks. */
struct last {
    struct last *next;
    uint64_t address;
    unsigned known;
    uint64_t successors[SUCCESSORS];
};

/* A translated block. A processor may translate the same code several times. */
struct block {
    uint64_t first;
    struct last *last;
};

static struct last *buckets[BUCKETS];
static struct last *left;
static FILE *out;

static void *allocated(size_t bytes)
{
    void *memory = calloc(1, bytes);
    if (!memory) {
        fprintf(stderr, "ERROR: outcomes: expected memory, found none\n");
        exit(1);
    }
    return memory;
}

static struct last *last_at(uint64_t address)
{
    struct last **bucket = &buckets[(address >> 1) % BUCKETS], *found;
    for (found = *bucket; found; found = found->next)
        if (found->address == address)
            return found;
    found = allocated(sizeof *found);
    found->address = address;
    found->next = *bucket;
    *bucket = found;
    return found;
}

static void entered(unsigned cpu, void *data)
{
    (void)cpu;
    const struct block *block = data;
    if (left) {
        unsigned i = 0;
        while (i < left->known && left->successors[i] != block->first)
            i++;
        if (i == left->known && i < SUCCESSORS)
            left->successors[left->known++] = block->first;
    }
    left = block->last;
}

static void translated(plugin_id id, struct qemu_plugin_tb *tb)
{
    (void)id;
    struct block *block = allocated(sizeof *block);
    block->first = qemu_plugin_tb_vaddr(tb);
    block->last = last_at(qemu_plugin_insn_vaddr(qemu_plugin_tb_get_insn(tb, qemu_plugin_tb_n_insns(tb) - 1)));
    qemu_plugin_register_vcpu_tb_exec_cb(tb, entered, NO_REGISTERS, block);
}

static void finish(plugin_id id, void *unused)
{
    (void)id;
    (void)unused;
    for (size_t bucket = 0; bucket < BUCKETS; bucket++)
        for (const struct last *last = buckets[bucket]; last; last = last->next) {
            if (!last->known)
                continue;
            fprintf(out, "%" PRIx64, last->address);
            for (unsigned i = 0; i < last->known; i++)
                fprintf(out, " %" PRIx64, last->successors[i]);
            fprintf(out, "\n");
        }
    fclose(out);
}

EXPORT int qemu_plugin_install(plugin_id id, const void *info, int argc, char **argv)
{
    (void)info;
    for (int i = 0; i < argc; i++)
        if (!strncmp(argv[i], "out=", 4) && !out)
            out = fopen(argv[i] + 4, "w");
    if (!out) {
        fprintf(stderr, "ERROR: expected out=FILE\n");
        return 1;
    }
    qemu_plugin_register_vcpu_tb_trans_cb(id, translated);
    qemu_plugin_register_atexit_cb(id, finish, NULL);
    return 0;
}
