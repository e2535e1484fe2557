#!/usr/bin/env python3
"""Peak memory of every command that reads or writes rasters, over the size of the image.

    python3 benches/memory.py PROGRAM FOLDER [--sizes 512x512,2048x2048,3400x14920,10000x10000] [--model nano] [--threads 1]

PROGRAM is elunar or host-train. Sizes are samples x lines. FOLDER keeps the scenes (`strip.py`) and gets memory.csv, a row per command and size: peak of
resident memory, MiB. A command that fails has the reason in place of its memory. A row that is there already is not
measured again. Needs what strip.py needs.
"""
import argparse
import csv
import os
import subprocess
import sys
import time
from pathlib import Path


def commands(model, threads):
    """Command lines by name, in an order in which each finds the files that it reads. They run in the scene's folder."""
    light = ["--sun-azimuth", "270", "--sun-elevation", "35"]
    pair = ["--image", "strip_image.tif", "--coarse", "strip_coarse.tif", *light]
    network = ["predict", *pair, "--model", model, "--threads", threads]
    return {
        "predict": [*network, "-o", "dtm.tif"],
        "predict, light fitted": [*network[:5], *network[9:], "-o", "fitted.tif"],
        "predict --uncertainty": [*network, "-o", "sure.tif", "--uncertainty", "errors.tif"],
        "predict --report --stac --pds4": [*network, "-o", "all.tif", "--report", "all.html", "--stac", "all.json", "--pds4", "all.xml"],
        "inspect": ["inspect", "strip_image.tif"],
        "hillshade to .tif": ["hillshade", "dtm.tif", "-o", "shade.tif"],
        "hillshade to .png": ["hillshade", "dtm.tif", "-o", "shade.png"],
        "render to .tif": ["render", "dtm.tif", "-o", "render.tif", *light],
        "render to .png": ["render", "dtm.tif", "-o", "render.png", *light],
        "diff": ["diff", "dtm.tif", "strip_truth.tif"],
        "diff to .tif and .png": ["diff", "dtm.tif", "strip_truth.tif", "-o", "diff.tif", "--picture", "diff.png"],
        "evaluate": ["evaluate", "--dtm", "dtm.tif", "--truth", "strip_truth.tif", "--coarse", "strip_coarse.tif"],
        "evaluate --error-map": ["evaluate", "--dtm", "dtm.tif", "--truth", "strip_truth.tif", "--error-map", "error.png"],
        "evaluate --spectra": ["evaluate", "--dtm", "dtm.tif", "--truth", "strip_truth.tif", "--spectra", "spectra.png"],
        "evaluate --uncertainty": ["evaluate", "--dtm", "dtm.tif", "--truth", "strip_truth.tif", "--uncertainty", "errors.tif"],
        "mosaic": ["mosaic", "dtm.tif", "strip_truth.tif", "-o", "mosaic.tif"],
        "mosaic --priority-blending-length": ["mosaic", "dtm.tif", "strip_truth.tif", "-o", "priority.tif", "--priority-blending-length", "50"],
        "mosaic --t_srs": ["mosaic", "dtm.tif", "-o", "polar.tif", "--t_srs", "+proj=eqc +lat_ts=10 +lat_0=0 +lon_0=0 +R=1737400 +units=m"],
        "prepare": ["prepare", "--image", "strip_image.tif", "--dtm", "strip_truth.tif", "--coarse", "strip_coarse.tif", *light, "--out", "tiles"],
        "sfs": ["sfs", *pair, "--threads", threads, "-o", "sfs.tif"],
    }


def measure(program, words, folder, limit_s):
    """Runs a command; returns its peak of resident memory in MiB, or why there is none."""
    began = time.monotonic()
    with (folder / "said.txt").open("w+") as said:
        child = subprocess.Popen([program, *map(str, words)], cwd=folder, stdout=subprocess.DEVNULL, stderr=said)
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid:
                break
            if time.monotonic() - began > limit_s:
                child.kill()
            time.sleep(0.05)
        child.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.monotonic() - began
        said.seek(0)
        error = [line for line in said.read().splitlines() if line.startswith("ERROR:")]
    if seconds > limit_s:
        return f"not done after {limit_s:.0f} s"
    if child.returncode:
        return error[-1] if error else f"exit status {child.returncode}"
    return f"{usage.ru_maxrss / 1024:.0f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("program", type=lambda word: Path(word).resolve())
    parser.add_argument("folder", type=Path)
    parser.add_argument("--sizes", default="512x512,2048x2048,3400x14920,10000x10000")
    parser.add_argument("--model", default="nano")
    parser.add_argument("--threads", default="1")
    parser.add_argument("--limit-s", type=float, default=1500, help="longest time of a command")
    a = parser.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    table = a.folder / "memory.csv"
    rows = list(csv.DictReader(table.open())) if table.exists() else []
    for size in a.sizes.split(","):
        samples, lines = map(int, size.split("x"))
        scene = a.folder / size
        if not (scene / "strip_truth.tif").exists():
            made = Path(__file__).with_name("strip.py")
            subprocess.run([sys.executable, made, scene, "--lines", str(lines), "--samples", str(samples), "--truth"], check=True)
        for name, words in commands(a.model, a.threads).items():
            if any((row["command"], row["size"]) == (name, size) for row in rows):
                continue
            peak = measure(a.program, words, scene, a.limit_s)
            rows.append(dict(command=name, size=size, peak_mib=peak))
            print(*rows[-1].values(), sep=", ", flush=True)
            with table.open("w") as file:
                writer = csv.DictWriter(file, ["command", "size", "peak_mib"], lineterminator="\n")
                writer.writeheader()
                writer.writerows(rows)


if __name__ == "__main__":
    main()
