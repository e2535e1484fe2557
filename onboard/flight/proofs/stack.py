#!/usr/bin/env python3
"""The stack that calls of the library can take at most, from the frames' sizes and the call graph of a linked program.

    stack.py ELF [LOG]     the bounds, with what the demo printed (LOG) also what it took, by paint; the deepest chains on standard error

Refused: recursion, and calls through pointers that indirect.toml does not list. With LOG, what was painted must not exceed the bound
by more than MARGIN_BYTES, the frame of the painter itself."""
import re
import sys
from program import Program

# The calls: of the demo (demo/src/calls.rs), of the archive (staticlib/src/proof.rs) and of the C interface.
ROOTS = r"^(elunar_call_|elunar_root_|eld_)"
# What the painter's own frames and the alignment of a frame at run time add to a painted depth.
MARGIN_BYTES = 256
# Assumed of a function without a known frame: assembly of the compiler's library, which saves a few registers.
ASSEMBLY_BYTES = 64


class Refused(Exception):
    """A program whose stack has no bound, line by line."""


def analyse(path):
    """{call: (bytes, chain of functions)}; raises Refused."""
    program = Program(path)
    roots = program.find(ROOTS)
    if not roots:
        raise Refused([f"{path}: expected calls of the library, found none"])
    unlisted = program.resolve()
    reachable = program.reachable(roots)
    wrong = [f"indirect, not in indirect.toml: {s.function.name}: {s.text}" for s in unlisted if s.function.address in reachable]
    depths = {}

    def frame(address):
        thumb = address | 1 if program.thumb else address
        return program.elf.frames.get(address, program.elf.frames.get(thumb, ASSEMBLY_BYTES))

    def depth(address, path):
        if address in path:
            names = [program.functions[a].name for a in path[path.index(address) :] + [address]]
            wrong.append("recursion: " + " -> ".join(names))
            return 0, []
        if address not in depths:
            below = max((depth(callee, path + [address]) for callee in program.calls[address]), default=(0, []))
            depths[address] = (frame(address) + below[0], [f"{program.functions[address].name} {frame(address)}"] + below[1])
        return depths[address]

    found = {root.name: depth(root.address, []) for root in roots}
    if wrong:
        raise Refused(list(dict.fromkeys(wrong)))
    return found


def bounds(path):
    """{call: bytes}; ends the program if there is no bound."""
    try:
        return {name: found[0] for name, found in analyse(path).items()}
    except Refused as refused:
        sys.exit("ERROR: " + "\n".join(refused.args[0]))


def painted(path):
    """{call: bytes} of what the demo printed: the deepest of all runs."""
    deepest = {}
    with open(path, encoding="utf-8", errors="replace") as file:
        for call, depth in re.findall(r"^stack (\w+) (\d+) bytes", file.read(), re.MULTILINE):
            deepest[call] = max(deepest.get(call, 0), int(depth))
    return deepest


def main(arguments):
    """See the top."""
    if len(arguments) not in (1, 2):
        sys.exit("ERROR: expected stack.py ELF [LOG]")
    try:
        found = analyse(arguments[0])
    except Refused as refused:
        print("\n".join(refused.args[0]))
        sys.exit(1)
    measured = painted(arguments[1]) if len(arguments) == 2 else {}
    wrong, words = [], []
    for name, (limit, chain) in sorted(found.items()):
        call = name.removeprefix("elunar_call_")
        print(f"    {name}: {limit} bytes: " + " > ".join(chain), file=sys.stderr)
        words.append(f"{call} {limit}" + (f" (painted {measured[call]})" if call in measured else ""))
        if len(arguments) == 2 and call not in measured:
            wrong.append(f"{call}: not painted")
        elif measured.get(call, 0) > limit + MARGIN_BYTES:
            wrong.append(f"{call}: {measured[call]} bytes painted, above the bound of {limit}")
    deepest = max(limit for limit, _ in found.values())
    short = f"at most {deepest} bytes in any of {len(found)} calls"
    print("; ".join(wrong) if wrong else "at most " + ", ".join(words) + " bytes" if measured else short)
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main(sys.argv[1:])
