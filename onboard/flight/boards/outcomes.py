#!/usr/bin/env python3
"""The outcomes of every conditional branch of the library in a board's program: outcomes.sh calls it.

    outcomes.py BOARD PROGRAM EDGES.. [--record] [--missed]

EDGES are files of counter/outcomes.c, one per run. Prints per function how many branches have seen both outcomes, one, or never ran, and how many of
the last two are not argued (below). More of those than outcomes.csv states is an error; --record writes it. --missed also prints each of them, with
its source line.

A branch is one conditional instruction: on Arm (Thumb) b<condition>, cbz and cbnz, and returns and calls inside an IT block; on PowerPC also
conditional returns. Other conditional instructions choose numbers, not ways, and are not counted; nor are jumps through tables. It is the library's
if the line tables have a function of core, the C interface or libm around it, inlined with a line or not inlined. Functions of Rust's own library
that stand alone, and what the compiler brings for copies and divisions, are not.

A branch without both outcomes is argued by the innermost line of our source around it; one to which the compiler gives none, by the first line that
each way leads to that it did not go:
    copy       another branch from the same place of the source has both: generic and inlined functions are in the program several times
    host       the tests on the host run that line, and reach both outcomes of its conditions: all lines but those in tests/missed.csv, which
               tests/coverage.sh --write writes (loops and arms of `match` have no conditions there)
    unreached  tests/unreached.csv says why no data reach it
    on boards  argued.csv beside this file says why these boards do not; a row that argues nothing is an error
or it is in libm, a foreign package with tests of its own, of which core calls less than there is."""
import collections
import csv
import os
import pathlib
import re
import sys

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
sys.path.insert(0, str(HERE.parent / "proofs"))
from program import Program, tool  # noqa: E402

TABLE = HERE / "outcomes.csv"
OUTCOMES, OPEN, LIBM, WHOLE = ("never", "one", "both"), "not argued", "libm", "*"
COLUMNS = ["board", "branches", "both", "one", "never", "copy", "host", "unreached", "on boards", LIBM, OPEN]
OURS = ("core/src/", "onboard/capi/src/")
ARM, POWERPC, SPARC = 40, 20, 2
CONDITIONS = "eq|ne|hs|lo|mi|pl|vs|vc|hi|ls|ge|lt|gt|le"
# Conditional branches with a target, by the ELF number of the processor; then those that return or call.
DIRECT = {
    ARM: re.compile(rf"(?:b(?:{CONDITIONS})(?:\.[nw])?|cbn?z|bl(?:{CONDITIONS}))$"),
    POWERPC: re.compile(r"(?:b[tf]|bdn?z[tf]?|b(?:lt|le|gt|ge|eq|ne|so|ns)|bc)[-+]?$"),
    SPARC: re.compile(r"(?:b(?:ne|e|g|le|ge|l|gu|leu|cc|cs|pos|neg|vc|vs)|fb(?:u|g|ug|l|ul|lg|ne|e|ue|ge|uge|le|ule|o))(?:,a)?(?:,p[tn])?$"),
}
INDIRECT = {
    ARM: re.compile(rf"(?:b(?:x|lx)(?:{CONDITIONS}) |(?:pop|ldm\w*)(?:{CONDITIONS})(?:\.w)? .*\bpc\b|ldr(?:{CONDITIONS})(?:\.w)? pc,)"),
    POWERPC: re.compile(r"(?:bclr|bcctr)l? (?!20,)|b(?:lt|le|gt|ge|eq|ne|so|ns|dn?z[tf]?|t|f)(?:lr|ctr)l?[-+]?\b"),
    SPARC: re.compile(r"(?!)"),
}
TARGET = re.compile(r"(?<!#)0x([0-9a-f]+)(?= <|$)")
JUMP = re.compile(r"(?:b(?:\.[nw])?|ba(?:,pt)?) ")
# Instructions within which a way has a line of the source.
NEAR = 128

# leave: the address that the counter names; fall, target: where it goes on (target None: anywhere else).
Branch = collections.namedtuple("Branch", "address leave fall target text")


def instructions(elf):
    """All instructions of a program as (address, text)."""
    code = []
    processor = [f"--mcpu={os.environ['ELUNAR_CPU']}"] if os.environ.get("ELUNAR_CPU") else []
    for line in tool("llvm-objdump", "-d", "--no-show-raw-insn", *processor, elf.path).splitlines():
        at, separator, text = line.partition(":")
        if separator and re.fullmatch(r"\s*[0-9a-f]+", at) and text.strip():
            code.append((int(at, 16), re.sub(r"\s+", " ", text.strip())))
    return code


def branches(elf, code):
    """All conditional branches among the instructions of a program."""
    machine = elf.number(18, 2)
    if machine not in DIRECT:
        sys.exit(f"ERROR: {elf.path}: expected a processor whose branches are known ({', '.join(map(str, DIRECT))}), found ELF machine {machine}")
    found = []
    for (address, text), following in zip(code, code[1:] + [(None, "")]):
        name, _, operands = text.partition(" ")
        goal = TARGET.search(operands)
        if DIRECT[machine].match(name) and goal:
            target = int(goal[1], 16)
        elif INDIRECT[machine].match(text):
            target = None
        else:
            continue
        if machine == SPARC:
            # The instruction behind it is executed before the way is left; an annulled one only on the way to the target.
            annulled = ",a" in name
            leave = address if annulled else address + 4
            found.append(Branch(address, leave, address + 8, address + 4 if annulled else target, text))
        else:
            found.append(Branch(address, address, following[0], target, text))
    delayed = {branch.leave for branch in found if branch.leave != branch.address}
    for branch in found:
        if branch.target in delayed or branch.fall == branch.target:
            sys.exit(f"ERROR: {elf.path}: 0x{branch.address:x} {branch.text}: expected two outcomes that can be told apart, found one")
    return found


def edges(paths):
    """{last instruction of a block: addresses of the next blocks}, of all runs."""
    left = collections.defaultdict(set)
    for path in paths:
        with open(path, encoding="ascii") as file:
            for line in file:
                place, *successors = (int(word, 16) for word in line.split())
                left[place].update(successors)
    if not left:
        sys.exit(f"ERROR: {' '.join(paths)}: expected places that were left, found none")
    return left


def frames(path, addresses):
    """Per address the functions around it as (name, file, line, column), the innermost first."""
    text = "\n".join(f"0x{address:x}" for address in addresses)
    blocks = tool("llvm-symbolizer", f"--obj={path}", "--inlines", text=text).strip().split("\n\n")
    found = {}
    for address, block in zip(addresses, blocks, strict=True):
        lines = block.splitlines()
        places = [place.rsplit(":", 2) for place in lines[1::2]]
        found[address] = [(name, file, int(line), int(column)) for name, (file, line, column) in zip(lines[::2], places)]
    return found


def ways(path, code, begins):
    """Per address where a way begins, the first place of our source that it comes to."""
    index, at = {address: i for i, (address, _) in enumerate(code)}, {}
    for begin in filter(None, begins):
        at[begin], i = [], index[begin]
        while i is not None and len(at[begin]) < NEAR:
            address, text = code[i]
            at[begin].append(address)
            goal = TARGET.search(text)
            i = index.get(int(goal[1], 16)) if JUMP.match(text) and goal else i + 1
    around = frames(path, sorted({address for steps in at.values() for address in steps}))
    place = lambda address: next(((own(file), line, column) for _, file, line, column in around[address] if own(file) and line), None)
    return {begin: next(filter(None, map(place, steps)), None) for begin, steps in at.items()}


def own(file):
    """The file's name within our source, `libm`, or nothing."""
    path = pathlib.Path(file)
    if path.is_relative_to(ROOT):
        name = path.relative_to(ROOT).as_posix()
        return name if name.startswith(OURS) else ""
    return LIBM if re.search(r"/libm-[\d.]+/src/", file) else ""


class Arguments:
    """Why a branch need not show both outcomes on a board."""

    def __init__(self, board):
        self._lines = {}
        # A reason that speaks of boards holds on the host alone.
        self.unreached = self._read(ROOT / "tests/unreached.csv", lambda row: "boards" not in row["reason"])
        self.on_boards = self._read(HERE / "argued.csv", lambda row: board in row["boards"].split())
        self.unused = {(file, code) for file, codes in self.on_boards.items() for code in codes}
        self.missed = collections.defaultdict(list)
        with open(ROOT / "tests/missed.csv", newline="", encoding="utf-8") as file:
            for row in csv.DictReader(file):
                self.missed[row["file"]].append((row["code"], int(row["occurrence"])))

    def _read(self, path, holds):
        """{file: codes} of a table's rows that hold; a code that is not in its file is an error."""
        found = collections.defaultdict(list)
        with open(path, newline="", encoding="utf-8") as file:
            for row in filter(holds, csv.DictReader(file)):
                if not any(row["code"] in line for line in self._source(row["file"])):
                    sys.exit(f"ERROR: {path.relative_to(ROOT)}: {row['file']}: expected the code {row['code']!r}, found none")
                found[row["file"]].append(row["code"])
        return found

    def _source(self, name):
        if name not in self._lines:
            path = ROOT / name
            self._lines[name] = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        return self._lines[name]

    def text(self, name, number):
        """A line of the source, without its indent; nothing where there is none."""
        lines = self._source(name)
        return lines[number - 1].strip() if 0 < number <= len(lines) else ""

    def of(self, name, number):
        """Which argument holds for a line."""
        text = self.text(name, number)
        if any(code in text for code in self.unreached[name]):
            return "unreached"
        if name == LIBM:
            return LIBM
        occurrence = sum(line.strip() == text for line in self._source(name)[:number])
        # A file that was measured has a row for itself.
        is_missed = (WHOLE, 1) not in self.missed[name] or (text, occurrence) in self.missed[name]
        if text and not is_missed:
            return "host"
        rows = {(name, code) for code in self.on_boards[name] if code in text}
        self.unused -= rows
        return "on boards" if rows else OPEN


def judge(board, path, runs):
    """[(branch, function, file, line, outcomes, argument)] of the library's branches."""
    program, left, arguments = Program(path), edges(runs), Arguments(board)
    code = instructions(program.elf)
    found = [branch for branch in branches(program.elf, code) if program.function_at(branch.address)]
    around = frames(path, [branch.address for branch in found])
    judged, ours = [], {program.function_at(address) for address, inside in around.items() if own(inside[-1][1])}
    for branch in found:
        mine = [(own(file), line, column) for _, file, line, column in around[branch.address] if own(file)]
        place = next((frame for frame in mine if frame[1]), None)
        if not mine or not (place or own(around[branch.address][-1][1])):
            continue
        seen = left.get(branch.leave, set())
        took = branch.target in seen if branch.target is not None else bool(seen - {branch.fall})
        outcomes = OUTCOMES[(branch.fall in seen) + took]
        # A trap may come between; any other way is an error of the reading.
        if branch.target is not None and (other := [s for s in seen - {branch.fall, branch.target} if program.function_at(s) in ours]):
            sys.exit(f"ERROR: {path}: 0x{branch.address:x} {branch.text}: expected 0x{branch.fall:x} or 0x{branch.target:x}, found 0x{other[0]:x}")
        missed = [way for way, went in ((branch.fall, branch.fall in seen), (branch.target, took)) if not went]
        judged.append((branch, program.function_at(branch.address).name, place or mine[0], outcomes, missed))
    if not judged:
        sys.exit(f"ERROR: {path}: expected branches of the library, found none")
    whole = {place for *_, place, outcomes, _ in judged if outcomes == "both" and place[1]}
    # The compiler gives line 0 to what it merged from several lines, or made between them: what its missed ways lead to counts.
    leads = ways(path, code, [way for *_, place, _, missed in judged if not place[1] for way in missed])

    def argued(place, outcomes, missed):
        if outcomes == "both":
            return place, ""
        if place in whole:
            return place, "copy"
        if place[1]:
            return place, arguments.of(*place[:2])
        found = [(lead, arguments.of(*lead[:2])) for lead in (leads.get(way) or place for way in missed)]
        return next((one for one in found if one[1] == OPEN), found[0])

    rows = [(branch, function, outcomes, *argued(place, outcomes, missed)) for branch, function, place, outcomes, missed in judged]
    return [(branch, function, *place[:2], outcomes, argument) for branch, function, outcomes, place, argument in rows], arguments


def report(judged, arguments, missed):
    """Prints a line per function, and with `missed` each branch that is not argued."""
    rows = collections.defaultdict(collections.Counter)
    for _, function, _, _, outcomes, argument in judged:
        rows[function].update([outcomes, argument])
    print("branches   both    one  never  not argued  function")
    for function, count in sorted(rows.items(), key=lambda row: -row[1][OPEN]):
        print(f"{sum(count[o] for o in OUTCOMES):8} {count['both']:6} {count['one']:6} {count['never']:6} {count[OPEN]:11}  {function}")
    if missed:
        for branch, function, file, line, outcomes, argument in sorted(judged, key=lambda one: one[2:4]):
            if argument == OPEN:
                print(f"{file}:{line}: {outcomes}: 0x{branch.address:x} {branch.text.split(' <')[0]} in {function}: {arguments.text(file, line)}")


def main(words):
    """See the top."""
    board, path, *runs = [word for word in words if not word.startswith("--")]
    judged, arguments = judge(board, path, runs)
    report(judged, arguments, "--missed" in words)
    count = collections.Counter(one[4] for one in judged) + collections.Counter(one[5] for one in judged)
    row = {"board": board, "branches": len(judged)} | {column: count[column] for column in COLUMNS[2:]}
    print(f"{board}: " + ", ".join(f"{row[column]} {column}" for column in COLUMNS[1:]))
    recorded = {}
    if TABLE.exists():
        with open(TABLE, newline="", encoding="utf-8") as file:
            recorded = {one["board"]: one for one in csv.DictReader(file)}
    if "--record" in words:
        recorded[board] = row
        with open(TABLE, "w", newline="", encoding="utf-8") as file:
            out = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            out.writeheader()
            out.writerows(recorded[one] for one in sorted(recorded))
    for file, code in sorted(arguments.unused):
        sys.exit(f"ERROR: argued.csv: {file}: expected a branch on {board} that {code!r} argues, found none")
    limit = int(recorded[board][OPEN]) if board in recorded else 0
    if row[OPEN] > limit:
        sys.exit(f"ERROR: {board}: expected at most {limit} branches that are not argued, found {row[OPEN]} (outcomes.sh --missed {board})")


if __name__ == "__main__":
    main(sys.argv[1:])
