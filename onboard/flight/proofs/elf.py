"""As much of the ELF format as the proofs need: sections, memory, symbols, frame sizes; either width, either byte order."""
import collections
import functools
import struct
import sys

WRITABLE, ALLOCATED, EXECUTABLE = 1, 2, 4
HAS_NO_BYTES = 8
NO_TYPE, FUNCTION = 0, 2
Symbol = collections.namedtuple("Symbol", "name address size kind section")


class Section(collections.namedtuple("Section", "name kind flags address offset size")):
    """A section's header."""

    def allocated(self):
        """Whether it is memory of the program."""
        return bool(self.flags & ALLOCATED)


class Elf:
    """A program or an object file."""

    def __init__(self, path):
        self.path = path
        with open(path, "rb") as file:
            self.bytes = file.read()
        if self.bytes[:4] != b"\x7fELF":
            sys.exit(f"ERROR: {path}: expected an ELF file, found something else")
        self.word_bytes = 4 if self.bytes[4] == 1 else 8
        self.order = "<" if self.bytes[5] == 1 else ">"
        self.sections = self._sections()

    def number(self, offset, size):
        """The unsigned number of 2, 4 or 8 bytes at an offset of the file."""
        return struct.unpack_from(self.order + {2: "H", 4: "I", 8: "Q"}[size], self.bytes, offset)[0]

    def _sections(self):
        wide = self.word_bytes == 8
        table = self.number(0x28 if wide else 0x20, self.word_bytes)
        entry, count, names = (self.number((0x3A if wide else 0x2E) + 2 * i, 2) for i in range(3))
        form = self.order + ("IIQQQQ" if wide else "IIIIII")
        raw = [struct.unpack_from(form, self.bytes, table + i * entry) for i in range(count)]
        strings = raw[names][4]
        return [Section(self._text(strings + name), *rest) for name, *rest in raw]

    def _text(self, offset):
        return self.bytes[offset : self.bytes.index(b"\0", offset)].decode()

    def loaded(self):
        """Sections that are memory of the program and have bytes in the file."""
        return [s for s in self.sections if s.allocated() and s.kind != HAS_NO_BYTES and s.size]

    def memory(self, address, size):
        """Bytes of the program's memory, or None outside of it."""
        for s in self.loaded():
            if s.address <= address and address + size <= s.address + s.size:
                return self.bytes[s.offset + address - s.address :][:size]
        return None

    @functools.cached_property
    def symbols(self):
        """All symbols that have a name."""
        named = {s.name: s for s in self.sections}
        if ".symtab" not in named:
            sys.exit(f"ERROR: {self.path}: expected symbols, found none")
        table, strings, found = named[".symtab"], named[".strtab"].offset, []
        form = self.order + ("IBBHQQ" if self.word_bytes == 8 else "IIIBBH")
        for fields in struct.iter_unpack(form, self.bytes[table.offset :][: table.size]):
            if self.word_bytes == 8:
                name, info, _, section, address, size = fields
            else:
                name, address, size, info, _, section = fields
            if name:
                found.append(Symbol(self._text(strings + name), address, size, info & 15, section))
        return found

    @functools.cached_property
    def frames(self):
        """Bytes of stack frame by the function's address, as the compiler wrote them (-Z emit-stack-sizes)."""
        sizes = {}
        for s in self.sections:
            at, end = s.offset, s.offset + s.size
            while s.name == ".stack_sizes" and at < end:
                address, size, shift = self.number(at, self.word_bytes), 0, 0
                at += self.word_bytes
                while True:
                    byte, at = self.bytes[at], at + 1
                    size |= (byte & 127) << shift
                    shift += 7
                    if byte < 128:
                        break
                sizes[address] = size
        return sizes
