#!/usr/bin/env python3
"""Source lines of the panics that a linked program can still reach.

    panic_sites.py ELF [ELF...]     one line per place: file:line:column, how many of the programs have it, and the source line

Every panic carries a `core::panic::Location` (file name, its length, line, column) in read-only data, and the linker keeps only
those that remaining code refers to. So the constants of that form are the places where code still panics. A lead to follow, not
a proof: the proof is the link (panics.sh), and a constant that is kept without being used is listed, too."""
import collections
import sys
from elf import Elf


def locations(elf):
    """The places (file, line, column) of one program."""
    word, found = elf.word_bytes, set()
    for section in elf.loaded():
        for offset in range(0, section.size - 2 * word - 8 + 1, 4):
            at = section.offset + offset
            name, length = elf.number(at, word), elf.number(at + word, word)
            line, column = elf.number(at + 2 * word, 4), elf.number(at + 2 * word + 4, 4)
            if 4 < length < 300 and 0 < line < 100_000 and 0 < column < 400:
                file = elf.memory(name, length) or b""
                if file.endswith(b".rs") and file.isascii():
                    found.add((file.decode(), line, column))
    return found


def source(file, line):
    """The line of the source, or nothing where the file is not at hand."""
    try:
        with open(file, encoding="utf-8") as lines:
            return lines.read().splitlines()[line - 1].strip()
    except (OSError, IndexError):
        return ""


def main(paths):
    """Prints the places of all programs together."""
    if not paths:
        sys.exit("ERROR: expected programs: panic_sites.py ELF [ELF...]")
    seen = collections.Counter()
    for path in paths:
        seen.update(locations(Elf(path)))
    for (file, line, column), programs in sorted(seen.items()):
        print(f"{file}:{line}:{column}  [{programs}]  {source(file, line)}")


if __name__ == "__main__":
    main(sys.argv[1:])
