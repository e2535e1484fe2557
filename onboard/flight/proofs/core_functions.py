#!/usr/bin/env python3
"""Functions of Rust's `core` in the flight archive, called or inlined, beside those that Ferrocene's compiler certifies.

    core_functions.py                          builds the archive for a Cortex-M7, and compares what is in it with core.csv
    core_functions.py --write                  writes core.csv anew; what it says of known functions stays
    core_functions.py --write --certified FILE takes what is certified from FILE: ferrocene/doc/symbol-report.csv of Ferrocene's sources,
                                               one function a line

Names are those of definitions: a generic function counts once, a closure for the function that it stands in. The archive is the released one, but
with debug information, which says what was inlined; what a constant was computed with is not in it."""
import argparse
import csv
import json
import os
import re
import shutil
import subprocess
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
TABLE = os.path.join(HERE, "core.csv")
TARGET = "thumbv7em-none-eabihf"
HEAD = ["function", "certified"]
ORIGIN = re.compile(r'DW_AT_(?:abstract_origin|linkage_name|specification)\s+\((?:0x[0-9a-f]+ )?"(_(?:R|ZN)[^"]+)"\)')
# Signs that older symbols spell.
SPELT = {"LT": "<", "GT": ">", "RF": "&", "BP": "*", "LP": "(", "RP": ")", "C": ",", "SP": "@"}
# Crates of which a function is not one of `core`, though it may implement a trait of it.
OTHERS = re.compile(r"\b(elunar\w*|libm|compiler_builtins|__rustc)\b")
PARAMETER = re.compile(r"(?<![\w:])(?:[A-Z]\w?|Idx|_)(?![\w:])")


def path_of(name):
    """Where a tool of LLVM is, the newest one; None if there is none."""
    return next(filter(None, (shutil.which(one) for one in [f"{name}-{version}" for version in range(40, 13, -1)] + [name])), None)


def tool(name, *arguments, text=None):
    """What a tool of LLVM prints."""
    return subprocess.run([path_of(name), *arguments], input=text, capture_output=True, text=True, check=True).stdout


def archive():
    """Builds the archive; returns its path."""
    folder = os.path.join(os.environ.get("CARGO_TARGET_DIR", os.path.join(HERE, "../../../target")), "flight-debug")
    command = ["cargo", "build", "--quiet", "--locked", "--release", "--config", "profile.release.debug=\"limited\"", "--manifest-path"]
    subprocess.run([*command, os.path.join(HERE, "../Cargo.toml"), "--target-dir", folder, "--target", TARGET], check=True)
    return os.path.join(folder, TARGET, "release", "libelunar.a")


def spelt_out(symbol):
    """The path of a symbol in the older scheme: lengths and parts, a hash at the end."""
    parts, at = [], len("_ZN")
    while symbol[at] != "E":
        digits = re.match(r"\d+", symbol[at:]).group()
        at += len(digits)
        parts.append(symbol[at : at + int(digits)])
        at += int(digits)
    parts = [part.removeprefix("_") if part.startswith("_$") else part for part in parts[:-1]]
    text = "::".join(parts).replace("..", "::")
    sign = lambda code: SPELT.get(code) or chr(int(code[1:], 16))
    return re.sub(r"\$([A-Z]+|u[0-9a-f]+)\$", lambda code: sign(code.group(1)), text)


def definition(name):
    """The name of the function's definition: without its closures and without the types that it was made for."""
    name = name.partition("::{")[0]
    depth = 0
    for at in range(len(name) - 1, 0, -1):
        depth += {">": 1, "<": -1}.get(name[at], 0) if name[at - 1 : at + 1] != "->" else 0
        if depth == 0:
            # Types behind the name, not those of an implementation.
            return name[: at - 2] if name[at] == "<" and name[at - 2 : at] == "::" and not name[at:].startswith("<impl ") else name
    return name


def found_in(path):
    """The functions of `core` in an archive, but for those in the compiler's own functions."""
    objects = re.split(r"^\S+\((\S+)\):\s+file format .*$", tool("llvm-dwarfdump", "--debug-info", path), flags=re.MULTILINE)[1:]
    ours = [text for name, text in zip(objects[::2], objects[1::2]) if not name.startswith("compiler_builtins")]
    symbols = {symbol for text in ours for symbol in ORIGIN.findall(text)}
    newer = sorted(s for s in symbols if s.startswith("_R"))
    names = tool("llvm-cxxfilt", text="\n".join(newer)).splitlines() + [spelt_out(s) for s in symbols if s.startswith("_Z")]
    names = {definition(name) for name in names}
    return {name for name in names if not OTHERS.search(name) and re.search(r"^<|^core::", name)}


def normal(name):
    """A name without what the schemes and versions write in different ways: lifetimes, spaces, names of parameters, the module of an
    implementation, a right side that is of the left one's type, the type without values, the type behind a pointer."""
    name = re.sub(r"'\w+(?:, ?| )?", "", name).replace("<>", "").replace("core::convert::Infallible", "!").replace(", ", ",")
    name = re.sub(r"^[\w:]+::<impl (.+) for (.+)>::([\w:]+)$", r"<\2 as \1>::\3", name)
    name = re.sub(r"^[\w:]+::<impl (.+)>::([\w:]+)$", r"<\1>::\2", name)
    name = re.sub(r"^<(&\w+) as (core::ops::(?:arith|bit)::(?!Neg|Not)\w+)>", r"<\1 as \2<\1>>", name)
    name = re.sub(r"^<\*(const|mut) \w+>", r"<*\1 T>", name)
    name = re.sub(r"^<(core::[^ ]+)>::(\w+)$", r"\1::\2", name)
    return PARAMETER.sub("?", re.sub(r"::<(?!impl )", "<", name))


def main():
    """See the top."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true")
    parser.add_argument("--certified", metavar="FILE")
    arguments = parser.parse_args()
    if not path_of("llvm-dwarfdump") or not path_of("llvm-cxxfilt"):
        print("SKIPPED: functions of core: llvm-dwarfdump is not here (Debian package llvm)")
        return
    functions = found_in(archive())
    known = {}
    if os.path.exists(TABLE):
        with open(TABLE, newline="", encoding="utf-8") as file:
            known = {row["function"]: row["certified"] for row in csv.DictReader(file)}
    if arguments.certified:
        with open(arguments.certified, encoding="utf-8") as file:
            certified = {normal(line.strip()) for line in file}
        known = {name: "yes" if normal(name) in certified else "no" for name in functions}
    if arguments.write:
        with open(TABLE, "w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([HEAD] + [[name, known.get(name, "not compared")] for name in sorted(functions)])
    elif more := sorted(functions ^ known.keys()):
        words = "\n".join(f"  {'new' if name in functions else 'gone'}: {name}" for name in more)
        sys.exit(f"ERROR: expected the functions of core.csv, found others; compare them with the certified ones (--write):\n{words}")
    counts = {how: sum(known.get(name, "not compared") == how for name in functions) for how in ("yes", "no", "not compared")}
    print(f"{len(functions)} functions of core in the archive: {json.dumps(counts)} certified")


if __name__ == "__main__":
    main()
