"""The call graph of a linked program, from its disassembly."""
import bisect
import collections
import os
import re
import subprocess
import sys
import tomllib

from elf import EXECUTABLE, FUNCTION, NO_TYPE, Elf

HERE = os.path.dirname(os.path.abspath(__file__))
ARM = 40
# Branches and calls of all processor families begin like this; what they are followed by tells them from other instructions.
BRANCH = re.compile(r"(?:b|c?bn?z|tbn?z|call|jal|jalr|j|tail)[\w.+-]*$")
NAMED = re.compile(r"<([^<>+]+|.*?)(?:\+0x([0-9a-f]+))?>$")
ADDRESS = re.compile(r"(?<!#)0x([0-9a-f]+)(?= <|$)")
# Jumps and calls to an address in a register.
CALL = re.compile(r"blx\s+(?:r\d+|ip|lr)$|blr\s+x|jalr\s+(?![^<]*<)|call\s+%|bctrl|blrl|jmpl\s")
JUMP = re.compile(r"bx\s+(?!lr)|br\s+x|jr\s+(?![^<]*<)|jmp\s+%(?![io]7\+)|bctr$|(?:mov|ldr(?:\.w)?|add)\s+pc,(?! \[sp\], )")
# Does not come back: nothing that follows belongs to the call. That none is reached is a proof of its own.
PANIC = re.compile(r"^core::panicking::|rust_begin_unwind$|^core::slice::index::slice_\w*fail$")
# Through a table of offsets in the code, bounded by the instruction before: it stays in its function.
TABLE = re.compile(r"(?:ldr|add)\s+pc,.*lsl #2")
Function = collections.namedtuple("Function", "name address end")
Site = collections.namedtuple("Site", "function address text")


def tool(name, *arguments, text=None):
    """What one of LLVM's tools prints."""
    command = [f"{name}-{os.environ['ELUNAR_LLVM']}" if "ELUNAR_LLVM" in os.environ else name, *arguments]
    return subprocess.run(command, input=text, capture_output=True, text=True, check=True).stdout


class Program:
    """Functions by address; who calls whom; calls through registers."""

    def __init__(self, path):
        self.elf = Elf(path)
        self.thumb = self.elf.number(18, 2) == ARM
        self.functions = self._functions()
        self._starts = sorted(self.functions)
        self.calls = collections.defaultdict(set)
        # Every direct call: (caller, instruction's address, callee). Every indirect one: Site.
        self.call_sites, self.indirect_calls, self.indirect_jumps = [], [], []
        self._disassemble()

    def _functions(self):
        """Where each function begins and ends; assembly has symbols without a type, and ends where the next one begins."""
        code = {i: s for i, s in enumerate(self.elf.sections) if s.flags & EXECUTABLE}
        typed, other = {}, {}
        for symbol in self.elf.symbols:
            if symbol.section not in code or symbol.name.startswith(("$", ".L")):
                continue
            address = symbol.address & ~1 if self.thumb and symbol.kind == FUNCTION else symbol.address
            if symbol.kind == FUNCTION and symbol.size:
                typed.setdefault(address, (symbol.name, address + symbol.size))
            elif symbol.kind in (FUNCTION, NO_TYPE):
                other.setdefault(address, (symbol.name, code[symbol.section].address + code[symbol.section].size))
        ends = sorted((address, end) for address, (_, end) in typed.items())
        inside = lambda address: any(start <= address < end for start, end in ends)
        typed.update({address: found for address, found in other.items() if not inside(address)})
        # The compiler numbers copies of a function behind its name.
        plain = tool("llvm-cxxfilt", text="\n".join(name.split(".")[0] for name, _ in typed.values())).splitlines()
        starts, found = sorted(typed), {}
        names = dict(zip(typed, plain))
        for address, following in zip(starts, starts[1:] + [1 << 64]):
            found[address] = Function(names[address], address, min(typed[address][1], following))
        return found

    def function_at(self, address):
        """The function that an address lies in, or None."""
        at = bisect.bisect_right(self._starts, address) - 1
        found = self.functions[self._starts[at]] if at >= 0 else None
        return found if found and address < found.end else None

    def _disassemble(self):
        by_symbol = {s.name: s.address & ~1 if self.thumb else s.address for s in self.elf.symbols}
        unknown = lines = 0
        processor = [f"--mcpu={os.environ['ELUNAR_CPU']}"] if os.environ.get("ELUNAR_CPU") else []
        for line in tool("llvm-objdump", "-d", "--no-show-raw-insn", *processor, self.elf.path).splitlines():
            at, separator, text = line.partition(":")
            text = text.strip().replace("\t", " ")
            if not separator or not text or not re.fullmatch(r"\s*[0-9a-f]+", at):
                continue
            address = int(at, 16)
            function = self.function_at(address)
            if function is None:
                continue
            lines, unknown = lines + 1, unknown + ("<unknown>" in text)
            if CALL.match(text):
                self.indirect_calls.append(Site(function, address, text))
            elif JUMP.match(text) and not TABLE.match(text):
                self.indirect_jumps.append(Site(function, address, text))
            else:
                target = self._target(text, by_symbol)
                if target and target.address != function.address and not PANIC.search(target.name):
                    self.calls[function.address].add(target.address)
                    self.call_sites.append((function, address, target))
        if lines == 0 or unknown > lines // 1000:
            sys.exit(f"ERROR: {self.elf.path}: expected code that can be disassembled, found {unknown} of {lines} instructions unknown")

    def _target(self, text, by_symbol):
        mnemonic, _, operands = text.partition(" ")
        if not BRANCH.match(mnemonic):
            return None
        named, plain = NAMED.search(operands), ADDRESS.search(operands)
        if mnemonic in ("jalr", "jr") and named and named[1] in by_symbol:
            return self.function_at(by_symbol[named[1]] + int(named[2] or "0", 16))
        return self.function_at(int(plain[1], 16)) if plain else None

    def find(self, pattern):
        """Functions whose name matches."""
        return [f for f in self.functions.values() if re.search(pattern, f.name)]

    def resolve(self):
        """Adds the indirect calls that indirect.toml lists to the graph; returns those it does not list."""
        with open(os.path.join(HERE, "indirect.toml"), "rb") as file:
            listed = tomllib.load(file)
        open_sites = []
        for site in self.indirect_calls:
            rules = [rule for rule in listed["call"] if re.search(rule["from"], site.function.name)]
            targets = [target for rule in rules for target in self.find(rule["to"])]
            self.calls[site.function.address].update(target.address for target in targets)
            if not targets:
                open_sites.append(site)
        for site in self.indirect_jumps:
            if not any(re.search(rule["in"], site.function.name) for rule in listed.get("table", [])):
                open_sites.append(site)
        return open_sites

    def reachable(self, roots):
        """Addresses of all functions that these call, themselves among them."""
        seen, todo = set(), [root.address for root in roots]
        while todo:
            address = todo.pop()
            if address not in seen:
                seen.add(address)
                todo += self.calls[address]
        return seen
