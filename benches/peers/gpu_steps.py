#!/usr/bin/env python3
"""Training steps of PyTorch on a GPU: network, weights, loss, optimiser and batch size as in our recipes, on one batch.

    python3 benches/peers/gpu_steps.py nano=nano.safetensors paper=paper.safetensors

One line of JSON for each network, precision and memory layout. `benches/gpu.sh` puts them beside ours (`host-train train-speed`).
"""
import argparse
import json
import sys
import time

import torch

import network
import train_steps

# Batch, rows and columns of the presets' recipes (`Recipe::preset`).
SIZES = {"nano": (8, 128, 160), "tiny": (8, 128, 160), "small": (4, 256, 320), "paper": (4, 256, 320)}
LAYOUTS = {"channels first": torch.contiguous_format, "channels last": torch.channels_last}
# Name, whether products are TF32, whether they are bfloat16.
PRECISIONS = [("f32", False, False), ("tf32", True, False), ("bf16", True, True)]
UNTIMED = 3


def measure(path, size, layout, tf32, half, a):
    """Steps per second, the first losses and the largest memory of a training."""
    torch.backends.cuda.matmul.allow_tf32 = torch.backends.cudnn.allow_tf32 = tf32
    torch.backends.cudnn.benchmark = True
    batch, rows, cols = size
    net, config = network.trainable(path, rows, cols)
    net = net.to(a.device, memory_format=LAYOUTS[layout])
    maps = train_steps.batch(batch, (rows, cols), config)
    image, coarse, truth = (torch.from_numpy(m).to(a.device).contiguous(memory_format=LAYOUTS[layout]) for m in maps)
    parameters = list(net.parameters())
    optimiser = train_steps.adam(parameters)
    gpu = a.device.startswith("cuda")

    def step():
        optimiser.zero_grad(set_to_none=True)
        with torch.autocast(a.device.split(":")[0], dtype=torch.bfloat16, enabled=half):
            prediction = net(image, coarse)
        value = train_steps.loss(truth, prediction.float())
        value.backward()
        train_steps.clip(parameters)
        optimiser.step()
        # Our trainer reads the loss of every step, too.
        return value.item()

    losses = [step() for _ in range(UNTIMED)]
    if gpu:
        torch.cuda.synchronize()
        torch.cuda.reset_peak_memory_stats()
    start, done = time.perf_counter(), 0
    while time.perf_counter() - start < a.seconds:
        step()
        done += 1
    if gpu:
        torch.cuda.synchronize()
    rate = done / (time.perf_counter() - start)
    memory = torch.cuda.max_memory_allocated() / 2**20 if gpu else 0
    return {"steps_per_s": rate, "first_losses": losses, "memory_mib": round(memory)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("networks", nargs="+", metavar="PRESET=WEIGHTS")
    parser.add_argument("--device", default="cuda", help="(default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=3.0, help="timed, of each (default: %(default)s)")
    a = parser.parse_args()
    if a.device.startswith("cuda") and not torch.cuda.is_available():
        raise SystemExit("ERROR: gpu_steps.py: expected a CUDA device, found none")
    for one in a.networks:
        preset, _, path = one.partition("=")
        if preset not in SIZES or not path:
            raise SystemExit(f"ERROR: {one}: expected one of {', '.join(SIZES)}, then = and a weight file")
        for precision, tf32, half in PRECISIONS:
            for layout in LAYOUTS:
                about = {"trainer": f"PyTorch {torch.__version__}, {layout}", "preset": preset, "precision": precision}
                about |= {"batch": SIZES[preset][0], "crop": SIZES[preset][1:]}
                try:
                    about |= measure(path, SIZES[preset], layout, tf32, half, a)
                except torch.OutOfMemoryError as error:
                    about["error"] = str(error).split(".")[0]
                    torch.cuda.empty_cache()
                print(json.dumps(about), flush=True)


if __name__ == "__main__":
    sys.exit(main())
