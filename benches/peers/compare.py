#!/usr/bin/env python3
"""One tile through our int8 runner and other runtimes, in turns, with the same number of threads.

    python3 benches/peers/compare.py nano tiny small paper
    python3 benches/peers/compare.py host-train/models/nano.safetensors --json

What is compared, and what is not: README.md.
"""
import argparse
import json
import os
import sys
import time
from pathlib import Path

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode

import files
import other_runtimes
import record
import runtimes

LEAST_ROUNDS = 5  # of a network that does not get through all rounds in its time
# Runtimes in float against PyTorch, share of the output's largest value. MNN convolves by Winograd's method, which rounds more.
FLOAT_TOLERANCE = {"onnxruntime_float": 1e-5, "openvino_float": 1e-5, "litert_float": 1e-5, "tract_float": 1e-5, "mnn_float": 1e-4}
INT8_TOLERANCE = 0.5  # rms error of an int8 output, share of the float one's deviation; a flat output would reach 1


# The runtimes beside ours and PyTorch: from a network and a number of threads.
PEERS = {
    "onnxruntime_int8": lambda net, n: runtimes.OnnxRuntime(net.int8_onnx, "ONNX Runtime int8", n),
    "onnxruntime_float": lambda net, n: runtimes.OnnxRuntime(net.float_onnx, "ONNX Runtime float", n),
    "openvino_int8": lambda net, n: other_runtimes.OpenVino(net.openvino_int8(), "OpenVINO int8 (NNCF)", n),
    "openvino_bf16": lambda net, n: other_runtimes.OpenVino(net.float_onnx, "OpenVINO bf16", n, "bf16"),
    "openvino_float": lambda net, n: other_runtimes.OpenVino(net.float_onnx, "OpenVINO float", n),
    "litert_static": lambda net, n: other_runtimes.LiteRt(net.litert("static"), "LiteRT int8", n),
    "litert_dynamic": lambda net, n: other_runtimes.LiteRt(net.litert("dynamic"), "LiteRT int8, ranges by tile", n),
    "litert_float": lambda net, n: other_runtimes.LiteRt(net.litert("float"), "LiteRT float", n),
    "mnn_int8": lambda net, n: other_runtimes.Mnn(net.mnn(8), "MNN int8 weights", n, memory="low", precision="low"),
    "mnn_float": lambda net, n: other_runtimes.Mnn(net.mnn(), "MNN float", n, precision="high"),
    "tract_float": lambda net, n: other_runtimes.Tract(net.float_onnx, "tract float"),
}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("networks", nargs="+", metavar="NETWORK", help="nano, tiny, small, paper or a .safetensors file")
    parser.add_argument("--rounds", type=int, default=15, help="tiles timed of each runtime (default: %(default)s)")
    parser.add_argument("--minutes", type=float, default=10, help="stop a slow network earlier (default: %(default)s)")
    parser.add_argument("--head", choices=["relu", "residual"], default="relu", help="of presets (default: %(default)s)")
    parser.add_argument("--precision", choices=["int8", "mixed", "int16"], default="mixed", help="ours (default: %(default)s)")
    parser.add_argument("--kernel", help="ours (default: the fastest)")
    parser.add_argument("--threads", type=int, default=1, help="of each runtime (default: %(default)s)")
    parser.add_argument("--without", nargs="*", default=[], choices=sorted(PEERS), metavar="RUNTIME", help="leave out some of: %(choices)s")
    parser.add_argument("--binaries", type=Path, help="folder of built programs, such as target/release (default: build)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--record", type=Path, metavar="FOLDER", help="also write FOLDER/<date>-peers/, or -peers-N-threads/")
    a = parser.parse_args()
    if a.rounds < 1:
        parser.error(f"--rounds: expected at least 1, found {a.rounds}")
    return a


def gmacs(module, tile):
    """Multiply-accumulates as PyTorch runs it: each 5x5 on the doubled map, attention on padded windows."""
    with FlopCounterMode(display=False) as counter, torch.inference_mode():
        module(*(torch.from_numpy(array) for array in tile))
    return counter.get_total_flops() / 2e9


def take_turns(peers, tile, rounds, seconds):
    """Seconds of every tile by runtime. Each turn runs the tile twice and times the second: the first warms the caches."""
    times, deadline = {key: [] for key in peers}, time.monotonic() + seconds
    for turn in range(rounds):
        if turn >= LEAST_ROUNDS and time.monotonic() > deadline:
            break
        for key in np.roll(list(peers), turn):
            peers[key].run(*tile)
            times[key].append(peers[key].run(*tile)[0])
    return times


def error(key, found, expected):
    """Difference from PyTorch's output; ends the program where it cannot be called the same network."""
    difference = found - expected
    rms, largest = float(np.sqrt(np.mean(difference.astype(np.float64) ** 2))), float(np.abs(difference).max())
    if key in FLOAT_TOLERANCE:
        name, value, limit = "largest error", largest, FLOAT_TOLERANCE[key] * float(np.abs(expected).max())
    else:
        name, value, limit = "rms error", rms, INT8_TOLERANCE * float(expected.std())
    if not value <= limit:
        raise SystemExit(f"ERROR: {key}: expected an output with {name} of at most {limit:.2g}, found {value:.2g}")
    return {"rms_error": rms, "max_error": largest}


def measure(net, peers, failed, a):
    """The report on one network."""
    outputs = {key: peer.run(*net.tile)[1] for key, peer in peers.items()}
    expected = outputs["pytorch_float"]
    errors = {key: error(key, outputs[key], expected) for key in peers if key != "pytorch_float"}
    files.say(f"{net.name}: {a.rounds} rounds")
    times = take_turns(peers, net.tile, a.rounds, a.minutes * 60)
    report = {"network": net.name, "weights": net.weights.name, "precision": a.precision}
    report |= {"rounds": len(times["ours"]), "rounds_wanted": a.rounds, "gmac": gmacs(net.module, net.tile)}
    report |= {"output_mean": float(expected.mean()), "output_deviation": float(expected.std())}
    report |= {"failed": failed, "ours": peers["ours"].facts, "runtimes": {}, "ratios": {}, "ratios_of_fastest": {}}
    for key, peer in peers.items():
        low, median, high = (1e3 * float(q) for q in np.quantile(times[key], [0.25, 0.5, 0.75]))
        measured = {"label": peer.label, "median_ms": median, "quartiles_ms": [low, high], "min_ms": 1e3 * min(times[key])}
        report["runtimes"][key] = measured | errors.get(key, {})
        ours = report["runtimes"]["ours"]
        report["ratios"][key] = median / ours["median_ms"]
        report["ratios_of_fastest"][key] = measured["min_ms"] / ours["min_ms"]
    return report


def compare(name, a, host_train, server):
    """As `measure`, from files made if need be, with runtimes opened and closed."""
    net = files.Network(name, a.head, a.precision, host_train)
    peers, failed = {"ours": runtimes.Ours(server, net.model, a.threads, a.kernel)}, {}
    try:
        for key in (key for key in PEERS if key not in a.without):
            try:
                peers[key] = PEERS[key](net, a.threads)
                peers[key].run(*net.tile)
            except Exception as reason:  # whatever another program does not do; the report says so
                peers.pop(key, None)
                failed[key] = " ".join(str(reason).split())[:200]
                files.say(f"FAILED: {net.name}: {key}: {failed[key]}")
        peers["pytorch_float"] = runtimes.PyTorch(net.module, net.tile, a.threads)
        return measure(net, peers, failed, a)
    finally:
        peers["ours"].close()


def main():
    a = arguments()
    host_train, server = files.programs(a.binaries)
    load = os.getloadavg()[0]
    networks = [compare(name, a, host_train, server) for name in a.networks]
    report = record.circumstances(a, load) | {"networks": networks}
    lines, rows = record.tile_lines(report), record.tile_rows(report)
    print(json.dumps(report, indent=1) if a.json else record.text(lines, rows))
    if a.record:
        threads = f"-{a.threads}-threads" if a.threads > 1 else ""
        files.say(f"wrote {record.write(a.record / (report['date'] + '-peers' + threads), 'tiles', lines, rows)}")


if __name__ == "__main__":
    main()
