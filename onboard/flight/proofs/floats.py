#!/usr/bin/env python3
"""Floating point in the runner's unit of work, for a processor without floating-point unit, where each operation is a call.

    floats.py ELF     which operations there are and where; exit status 1 if any lies elsewhere than in ALLOWED

The program has its source lines (profile `board`), so that a call is found in the function that wrote it, inlined or not."""
import collections
import re
import sys
from program import Program, tool

# A unit of work, in every kernel.
UNIT = r"elunar_core::nn::ops::run::<|elunar_core::nn::dispatch::.*::unit$"
# The compiler's functions for floating point (names as in libgcc), and libm.
HELPER = (
    r"^__(add|sub|mul|div|neg|pow)[sdt]f[2-3]?$|^__powi[sdt]f2$|^__(eq|ne|lt|le|gt|ge|cmp|unord)[sdt]f2$"
    r"|^__float(un)?(s|d|t)i(s|d|t)f$|^__fix(uns)?(s|d|t)f(s|d|t)i$|^__(extend|trunc)(h|s|d|t)f(h|s|d|t)f2$|\blibm::"
)
# Source file and function where the last layer turns its sums into numbers of the output.
ALLOWED = [("core/src/nn/kernels/requantise.rs", "floats")]


def frames(elf, addresses):
    """Per address the functions it lies in as (name, file:line:column), the innermost first."""
    text = "\n".join(f"0x{address:x}" for address in addresses)
    blocks = tool("llvm-symbolizer", f"--obj={elf}", "--inlines", text=text).strip().split("\n\n")
    lines = [block.splitlines() for block in blocks]
    return {address: list(zip(block[::2], block[1::2])) for address, block in zip(addresses, lines)}


def allowed(name, place):
    """Whether floating point may be computed in this function."""
    return any(name == function and place.partition(":")[0].endswith(file) for file, function in ALLOWED)


def main(arguments):
    """See the top."""
    if len(arguments) != 1:
        sys.exit("ERROR: expected floats.py ELF")
    program = Program(arguments[0])
    roots = program.find(UNIT)
    if not roots:
        sys.exit("ERROR: expected a unit of work, found none")
    reachable = program.reachable(roots)
    helper = re.compile(HELPER)
    # Helpers call each other; what counts is who calls them from outside.
    sites = {a: to.name for f, a, to in program.call_sites if f.address in reachable and helper.search(to.name) and not helper.search(f.name)}
    if not sites:
        sys.exit("ERROR: expected the last layer's floating point, found none: is this a processor without floating-point unit?")
    where, wrong = collections.Counter(), []
    for address, lines in frames(arguments[0], list(sites)).items():
        inside = [name for name, place in lines if allowed(name, place)]
        if inside:
            where[sites[address]] += 1
        else:
            name, place = lines[0] if lines else ("?", "?")
            wrong.append(f"{sites[address]} at 0x{address:x} in {name} ({place})")
    for line in wrong:
        print(line)
    if not wrong:
        operations = ", ".join(f"{name} ({count})" for name, count in sorted(where.items()))
        print(f"only in {', '.join(f'{file} {function}()' for file, function in ALLOWED)}: {operations}")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main(sys.argv[1:])
