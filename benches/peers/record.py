"""A comparison as Markdown, with the circumstances under which it was made."""
import os
import platform
import shlex
import subprocess
import sys
from datetime import datetime, timezone
from importlib.metadata import version
from pathlib import Path

HERE = Path(__file__).resolve().parent
PACKAGES = ("torch", "onnxruntime", "onnx", "numpy")


def output(*command):
    return subprocess.run(command, cwd=HERE, capture_output=True, text=True, check=True).stdout.strip()


def processor():
    """Its name, and whether it has the instructions that both int8 runtimes want."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    about = dict(line.split("\t: ", 1) for line in reversed(lines) if "\t: " in line)
    about = {key.strip(): value for key, value in about.items()}
    name = about.get("model name", platform.machine())
    return f"{name}, AVX-512 VNNI" if "avx512_vnni" in about.get("flags", "") else name


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
        "binaries": str(a.binaries) if a.binaries else None,
        "versions": {"python": platform.python_version()} | {name: version(name) for name in PACKAGES},
        "command": shlex.join(["python3", f"benches/peers/{Path(sys.argv[0]).name}", *sys.argv[1:]]),
    }


def table(network):
    """The table of one network."""
    head = f"{network['weights']}, {network['gmac']:.2f} GMAC as PyTorch runs it, output {network['output_mean']:.1f} ± "
    head += f"{network['output_deviation']:.1f}, {network['rounds']} rounds"
    if network["rounds"] < network["rounds_wanted"]:
        head += f" (of {network['rounds_wanted']}: out of time)"
    ours = network["ours"]
    head += f"; ours: {network['precision']}, {ours['macs'] / 1e9:.2f} GMAC, arena {ours['arena_bytes']:,} bytes"
    lines = [f"## {network['network']}", "", f"{head}.", ""]
    lines += ["| | ms | quartiles | fastest | GMAC/s | / ours | fastest / ours | rms error | largest error |"]
    lines += ["|---|---|---|---|---|---|---|---|---|"]
    for key, one in network["runtimes"].items():
        low, high = one["quartiles_ms"]
        rate = network["gmac"] / one["median_ms"] * 1e3
        errors = f"{one['rms_error']:.2g} | {one['max_error']:.2g}" if "rms_error" in one else "– | –"
        times = f"{one['median_ms']:.1f} | {low:.1f}–{high:.1f} | {one['min_ms']:.1f}"
        ratios = f"{network['ratios'][key]:.2f} | {network['ratios_of_fastest'][key]:.2f}"
        lines.append(f"| {one['label']} | {times} | {rate:.0f} | {ratios} | {errors} |")
    return "\n".join(lines)


def text(report):
    """The whole record."""
    versions = ", ".join(f"{name} {number}" for name, number in report["versions"].items())
    before, after = report["load"]
    origin = f", binaries of {report['binaries']}" if report["binaries"] else ""
    parts = [
        f"# {report['date']}: one tile of 256 x 320, side by side",
        f"{report['processor']} ({report['cores']} cores, load {before:.1f} before and {after:.1f} after), commit "
        f"{report['commit']}{origin}; {versions}.",
        f"`{report['command']}`",
        "One thread each, in turns; medians. GMAC/s counts the same for all. Errors are differences from PyTorch's "
        "output, whose range is NR = 50.",
        *(table(network) for network in report["networks"]),
    ]
    return "\n\n".join(parts) + "\n"


def write(report, folder):
    """Writes the record into `folder` and returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{report['date']}-peers.md"
    path.write_text(text(report))
    return path
