#!/usr/bin/env python3
"""What a board may use, and what it does use.

    budget.py compare BUDGET ELF LOG ROWS    prints what is above the budget; nothing if all is below
    budget.py record BUDGET ELF LOG ROWS     writes the budget anew: what was measured, and a margin
    budget.py print BUDGET ELF LOG ROWS      prints what was measured
    budget.py table instructions.csv         prints what is recorded of all boards, as the table of ../../docs/budgets.md
    budget.py calls calls.csv                prints the longest call of each C function, as the table there

ELF is the linked demo, LOG what it printed, ROWS the instruction counts of ../boards/run.sh, the fastest kernel first."""
import os
import re
import sys
import tomllib

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "proofs"))
from elf import WRITABLE, Elf
from stack import bounds

MARGIN_PERCENT = 10
# A call of fewer instructions has no row of its own on the page.
SHORT_CALL = 500_000
# A rounding up of every limit, in units that people plan with.
STEP = {"flash_bytes": 1024, "ram_bytes": 1024, "stack_bytes": 64, "instructions": 1_000_000}
WHAT = {
    "flash_bytes": "code and constants of the demo: library, console and start-up code, without the model file",
    "ram_bytes": "data, arena and the runner's context, without the stack",
    "stack_bytes": "the deepest call of the library, by its frames (../../proofs/stack.py)",
    "instructions": "of one tile with the fastest kernel",
}


def measure(elf_path, log_path, rows_path):
    """The four figures."""
    elf = Elf(elf_path)
    memory = [s for s in elf.sections if s.allocated()]
    writable = sum(s.size for s in memory if s.flags & WRITABLE)
    constant = sum(s.size for s in elf.loaded())
    with open(log_path, encoding="utf-8", errors="replace") as file:
        lent = re.search(r"arena (\d+) bytes, context (\d+) bytes", file.read())
    with open(rows_path, encoding="utf-8") as file:
        instructions = int(file.readline().split(",")[4])
    return {
        "flash_bytes": constant,
        "ram_bytes": writable + int(lent[1]) + int(lent[2]),
        "stack_bytes": max(bounds(elf_path).values()),
        "instructions": instructions,
    }


def limit(name, used):
    """The limit for what was measured: the margin on it, rounded up."""
    step = STEP[name]
    return -(-used * (100 + MARGIN_PERCENT) // (100 * step)) * step


def record(path, used):
    """Writes the budget."""
    lines = [
        "# The most that this board's demo may use; ./run.sh fails above it. Written by ./run.sh --record: what was measured, plus the",
        f"# margin, rounded up to {STEP['flash_bytes']} bytes of memory, {STEP['stack_bytes']} of stack and a million instructions.",
        f"margin_percent = {MARGIN_PERCENT}",
        "",
        "[limit]",
    ]
    for name, what in WHAT.items():
        lines += [f"# {what[0].upper()}{what[1:]}.", f"{name} = {limit(name, used[name])}"]
    lines += ["", "[measured]"] + [f"{name} = {used[name]}" for name in WHAT]
    with open(path + ".new", "w", encoding="utf-8") as file:
        file.write("\n".join(lines) + "\n")
    os.replace(path + ".new", path)


def read(path):
    """The budget's tables; ends the program if it is not there or not whole."""
    try:
        with open(path, "rb") as file:
            budget = tomllib.load(file)
    except (FileNotFoundError, tomllib.TOMLDecodeError) as error:
        sys.exit(f"{path}: expected a budget, found none: {error}")
    for part in ("limit", "measured"):
        for name in WHAT:
            if name not in budget.get(part, {}):
                sys.exit(f"{path}: expected {name} in [{part}], found none")
    return budget


def compare(path, used):
    """Complaints, one line each."""
    limits = read(path)["limit"]
    return [f"{name} {used[name]}, above its budget of {limits[name]}" for name in WHAT if used[name] > limits[name]]


def table(counts_path):
    """The table of ../../docs/budgets.md: a board's fastest kernel, and what was measured."""
    boards = os.path.dirname(os.path.abspath(counts_path))
    rows = [
        "| board | kernel | flash, bytes | RAM, bytes | stack, bytes | instructions, millions | per MAC |",
        "|---|---|---|---|---|---|---|",
    ]
    seen = set()
    with open(counts_path, encoding="utf-8") as file:
        for line in file.read().splitlines()[1:]:
            board, kernel, _, _, _, per_mac = line.split(",")
            if board in seen:
                continue
            seen.add(board)
            budget = read(os.path.join(boards, board, "budget.toml"))
            cells = [f"`{board}`", f"`{kernel}`"]
            for name in WHAT:
                unit = 1_000_000 if name == "instructions" else 1
                cells.append(f"{round(budget['measured'][name] / unit):,}")
            rows.append(f"| {' | '.join(cells)} | {float(per_mac):.2f} |")
    return rows


def calls(path):
    """The longest call of each function, over all tiles: a row for each function, a column for each board; and what is short everywhere."""
    most, boards = {}, []
    with open(path, encoding="utf-8") as file:
        for line in file.read().splitlines()[1:]:
            board, function, _, _, count, _ = line.split(",")
            boards += [board] if board not in boards else []
            row = most.setdefault(function, {})
            row[board] = max(row.get(board, 0), int(count))
    rows = ["| function | " + " | ".join(f"`{board}`" for board in boards) + " |", "|---|" + "---|" * len(boards)]
    short = sorted(function for function, row in most.items() if max(row.values()) < SHORT_CALL)
    for function, row in sorted(most.items()):
        if function not in short:
            rows.append(f"| `{function}` | " + " | ".join(f"{row[board] / 1e6:.2f}" if board in row else "" for board in boards) + " |")
    return rows + ["", f"Below {SHORT_CALL / 1e6:g} on every board:", *(f"`{function}`" for function in short)]


def main(arguments):
    """See the top."""
    if len(arguments) == 2 and arguments[0] == "calls":
        print("\n".join(calls(arguments[1])))
        return
    if len(arguments) == 2 and arguments[0] == "table":
        print("\n".join(table(arguments[1])))
        return
    if len(arguments) != 5 or arguments[0] not in ("compare", "record", "print"):
        sys.exit("ERROR: expected budget.py compare|record|print BUDGET ELF LOG ROWS, or budget.py table|calls COUNTS")
    action, path, *measured = arguments
    used = measure(*measured)
    if action == "record":
        record(path, used)
    elif action == "print":
        print(f"flash {used['flash_bytes']}, RAM {used['ram_bytes']}, stack {used['stack_bytes']} bytes")
    else:
        print("\n".join(compare(path, used)), end="")


if __name__ == "__main__":
    main(sys.argv[1:])
