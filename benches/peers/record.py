"""A comparison as a table, with the circumstances under which it was made."""
import csv
import os
import platform
import shlex
import subprocess
import sys
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGES = ("torch", "onnxruntime", "openvino", "nncf", "ai-edge-litert", "MNN", "tract", "onnx", "numpy")


def output(*command):
    return subprocess.run(command, cwd=HERE, capture_output=True, text=True, check=True).stdout.strip()


def processor():
    """Its name with family and model, which tell processors of one name apart, and whether it has the instructions that both int8 runtimes want."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    about = dict(line.split("\t: ", 1) for line in reversed(lines) if "\t: " in line)
    about = {key.strip(): value for key, value in about.items()}
    name = about.get("model name", platform.machine())
    if "cpu family" in about:
        name += f" (family {about['cpu family']}, model {about['model']})"
    flags = about.get("flags", "").split()
    for flag, instructions in (("amx_int8", "AMX"), ("avx512_vnni", "AVX-512 VNNI"), ("avx_vnni", "AVX-VNNI")):
        if flag in flags:
            return f"{name}, {instructions}"
    return name


def held():
    """A variable of the environment that holds OpenVINO to older instructions, as a command line says it."""
    limit = os.environ.get("ONEDNN_MAX_CPU_ISA")
    return f"ONEDNN_MAX_CPU_ISA={limit} " if limit else ""


def circumstances(a, load):
    """Where, when and of what a comparison was made; `load` is the one at its beginning."""
    commit = output("git", "rev-parse", "--short", "HEAD")
    if output("git", "status", "--porcelain", "--untracked-files=no"):
        commit += " with changes"
    return {
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d"),
        "processor": processor(),
        "cores": os.cpu_count(),
        "load": [load, os.getloadavg()[0]],
        "commit": commit,
        "threads": getattr(a, "threads", 1),
        "binaries": str(a.binaries) if a.binaries else None,
        "versions": {"python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "command": held() + shlex.join(["python3", f"benches/peers/{Path(sys.argv[0]).name}", *sys.argv[1:]]),
    }


def origin(report):
    """Machine, load, commit, versions and command, one line each."""
    versions = ", ".join(f"{name} {number}" for name, number in report["versions"].items())
    before, after = report["load"]
    binaries = f", binaries of {report['binaries']}" if report["binaries"] else ""
    return [
        f"{report['processor']} ({report['cores']} cores), load {before:.1f} before and {after:.1f} after",
        f"Commit {report['commit']}{binaries}; {versions}",
        f"Command: {report['command']}",
    ]


def tile_lines(report):
    """What the table of tiles is about."""
    lines = [f"One tile of 256 x 320 in several runtimes, {report['date']}", *origin(report)]
    threads = "One thread" if report["threads"] == 1 else f"{report['threads']} threads (ours: as many tiles at once, time over their number)"
    lines += [f"{threads} each, in turns. ms, quartiles and fastest in milliseconds. GMAC/s counts the same products for all."]
    lines += ["Errors: differences from PyTorch's output, whose range is NR = 50."]
    for network in report["networks"]:
        ours, rounds = network["ours"], str(network["rounds"])
        if network["rounds"] < network["rounds_wanted"]:
            rounds += f" of {network['rounds_wanted']} (out of time)"
        output = f"{network['output_mean']:.1f} ± {network['output_deviation']:.1f}"
        lines.append(
            f"{network['network']}: {network['weights']}, {network['gmac']:.2f} GMAC as PyTorch runs it, output {output}, {rounds} "
            f"rounds; ours: {network['precision']}, {ours['macs'] / 1e9:.2f} GMAC, arena {ours['arena_bytes']:,} bytes"
        )
        lines += [f"{network['network']}: {key} failed: {reason}" for key, reason in network["failed"].items()]
    return lines


def tile_rows(report):
    """Head and rows: a runtime of a network each."""
    rows = [["network", "runtime", "ms", "first quartile", "third quartile", "fastest", "GMAC/s", "/ ours", "fastest / ours"]]
    rows[0] += ["rms error", "largest error"]
    for network in report["networks"]:
        for key, one in network["runtimes"].items():
            rate = network["gmac"] / one["median_ms"] * 1e3
            times = [f"{ms:.1f}" for ms in (one["median_ms"], *one["quartiles_ms"], one["min_ms"])]
            ratios = [f"{network[of][key]:.2f}" for of in ("ratios", "ratios_of_fastest")]
            errors = [f"{one[of]:.2g}" if of in one else "" for of in ("rms_error", "max_error")]
            rows.append([network["network"], one["label"], *times, f"{rate:.0f}", *ratios, *errors])
    return rows


def text(lines, rows):
    """Both, for a screen."""
    widths = [max(len(cell) for cell in column) for column in zip(*rows)]
    table = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip() for row in rows]
    return "\n".join([*lines, "", *table])


def write(folder, name, lines, rows):
    """Writes `about.txt` and `NAME.csv` into `folder` and returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "about.txt").write_text("\n".join(lines) + "\n")
    with open(folder / f"{name}.csv", "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
    return folder
