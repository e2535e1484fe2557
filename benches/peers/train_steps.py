#!/usr/bin/env python3
"""Training steps of our trainer and of PyTorch, in turns, on the same threads: same network, weights, batch, loss, optimiser.

    python3 benches/peers/train_steps.py nano
    python3 benches/peers/train_steps.py nano --batch 8 --size 128 160 --json

What is compared, and what is not: README.md.
"""
import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F

import files
import network
import record
import tiles

# The recipe of `tiny` and `nano` with a constant learning rate, as `train_server.rs` has it.
LEARNING_RATE, WEIGHT_DECAY, ADAM_EPSILON, CLIP_NORM = 1e-3, 1e-4, 1e-8, 1.0
TERM_WEIGHTS = (0.1, 4.0, 4.0)
FIRST_LOSSES = 3  # compared between all
LOSS_TOLERANCE = 1e-2  # relative; the first is held to a hundredth of it


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("network", metavar="NETWORK", help="nano, tiny, small, paper or a .safetensors file")
    parser.add_argument("--batch", type=int, default=4, help="tiles of a step (default: %(default)s)")
    parser.add_argument("--size", type=int, nargs=2, default=[256, 320], metavar=("ROWS", "COLS"), help="(default: 256 320)")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="of every side (default: all, %(default)s)")
    parser.add_argument("--rounds", type=int, default=5, help="turns of each (default: %(default)s)")
    parser.add_argument("--steps", type=int, default=3, help="steps of a turn (default: %(default)s)")
    parser.add_argument("--binaries", type=Path, help="folder of built programs, such as target/release (default: build)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--record", type=Path, metavar="FOLDER", help="also write FOLDER/<date>-training/")
    a = parser.parse_args()
    for name, n in [("--batch", a.batch), ("--threads", a.threads), ("--rounds", a.rounds), ("--steps", a.steps)]:
        if n < 1:
            parser.error(f"{name}: expected at least 1, found {n}")
    for n in a.size:
        if n % 32 or not 32 <= n <= min(tiles.ROWS, tiles.COLS) * 2:
            parser.error(f"--size: expected multiples of 32, found {n}")
    if a.size[0] > tiles.ROWS or a.size[1] > tiles.COLS:
        parser.error(f"--size: expected at most {tiles.ROWS} {tiles.COLS}, found {a.size[0]} {a.size[1]}")
    return a


def sobel(z):
    """d/dx and d/dy per pixel, replicated border."""
    x = torch.tensor([[-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-1.0, 0.0, 1.0]], device=z.device) / 8
    d = F.conv2d(F.pad(z, (1, 1, 1, 1), mode="replicate"), torch.stack([x, x.T])[:, None])
    return d[:, :1], d[:, 1:]


def loss(truth, prediction):
    """The hybrid loss (Eq. 5) with the plain elevation term."""
    (tx, ty), (px, py) = sobel(truth), sobel(prediction)
    cosine = (tx * px + ty * py + 1) / ((tx**2 + ty**2 + 1).sqrt() * (px**2 + py**2 + 1).sqrt())
    terms = (truth - prediction).abs().mean(), (tx - px).abs().mean() + (ty - py).abs().mean(), (1 - cosine).mean()
    return sum(weight * term for weight, term in zip(TERM_WEIGHTS, terms))


def clip(parameters):
    """Each parameter's gradient gets a norm of at most one."""
    gradients = [p.grad for p in parameters]
    norms = torch._foreach_norm(gradients)
    torch._foreach_mul_(gradients, [torch.clamp(CLIP_NORM / (norm + 1e-38), max=1.0) for norm in norms])


def adam(parameters):
    """The optimiser of the recipe."""
    return torch.optim.AdamW(parameters, lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY, eps=ADAM_EPSILON, fused=True)


class PyTorch:
    """A trainer in this process."""

    def __init__(self, weights, batch, layout):
        self.label = f"PyTorch, {layout}"
        form = {"channels first": torch.contiguous_format, "channels last": torch.channels_last}[layout]
        self.network = network.trainable(weights, *batch[0].shape[2:])[0].to(memory_format=form)
        self.batch = [torch.from_numpy(map).contiguous(memory_format=form) for map in batch]
        self.parameters = list(self.network.parameters())
        self.optimiser = adam(self.parameters)

    def run(self, steps):
        """Seconds, processor seconds and losses of some steps."""
        losses, start, busy = [], time.perf_counter(), time.process_time()
        image, coarse, truth = self.batch
        for _ in range(steps):
            self.optimiser.zero_grad(set_to_none=True)
            value = loss(truth, self.network(image, coarse))
            value.backward()
            clip(self.parameters)
            self.optimiser.step()
            losses.append(value.item())
        return time.perf_counter() - start, time.process_time() - busy, losses

    def close(self):
        pass


class Ours:
    """Our trainer in a process of its own (`train_server.rs`), which measures itself."""

    label = "ours, flex"

    def __init__(self, server, weights, batch, threads):
        size = [str(n) for n in (batch[0].shape[0], *batch[0].shape[2:])]
        environment = os.environ | {"RAYON_NUM_THREADS": str(threads)}
        self.process = subprocess.Popen(
            [server, weights, *size], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
        )
        for map in batch:
            self.process.stdin.write(map.tobytes())

    def busy(self):
        """Processor seconds so far."""
        fields = Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def run(self, steps):
        busy = self.busy()
        self.process.stdin.write(f"{steps}\n".encode())
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit("ERROR: train_server: expected an answer, found none")
        answer = json.loads(line)
        return answer["seconds"], self.busy() - busy, answer["losses"]

    def close(self):
        self.process.stdin.close()
        self.process.wait()
        self.process.stdout.close()


def batch(count, size, config):
    """Images, coarse DTMs and truths, f32 [count, 1, rows, cols]. The truth is made of the coarse DTM and the image: any will do."""
    rows, cols = size
    made = [tiles.tile(seed, config) for seed in range(count)]
    image, coarse = (np.concatenate([tile[i] for tile in made])[:, :, :rows, :cols] for i in range(2))
    truth = coarse + (image - image.mean())[:, :1]
    return [np.ascontiguousarray(map, dtype=np.float32) for map in (image, coarse, truth)]


def check(losses):
    """Ends the program where the first losses say that not the same is trained."""
    expected = losses["channels_first"]
    for key, found in losses.items():
        for i, (x, y) in enumerate(zip(found[:FIRST_LOSSES], expected)):
            tolerance = LOSS_TOLERANCE * (0.01 if i == 0 else 1)
            if not abs(x - y) <= tolerance * abs(y):
                raise SystemExit(f"ERROR: {key}: step {i + 1}: expected a loss of {y:.6g} within {tolerance:.0e}, found {x:.6g}")


def measure(a, weights, server, config):
    """Seconds a step of everyone, in turns."""
    maps = batch(a.batch, a.size, config)
    torch.set_num_threads(a.threads)
    peers = {"ours": Ours(server, weights, maps, a.threads)}
    try:
        for layout in ("channels first", "channels last"):
            peers[layout.replace(" ", "_")] = PyTorch(weights, maps, layout)
        losses = {key: peer.run(FIRST_LOSSES)[2] for key, peer in peers.items()}
        check(losses)
        times, busy = {key: [] for key in peers}, {key: 0.0 for key in peers}
        for turn in range(a.rounds):
            for key in np.roll(list(peers), turn):
                seconds, processor, _ = peers[key].run(a.steps)
                busy[key] += processor / (a.rounds * a.steps)
                times[key].append(seconds / a.steps)
                files.say(f"round {turn + 1}: {peers[key].label}: {1 / times[key][-1]:.2f} steps/s")
    finally:
        for peer in peers.values():
            peer.close()
    rates = {key: 1 / statistics.median(seconds) for key, seconds in times.items()}
    fastest = {key: 1 / min(seconds) for key, seconds in times.items()}
    return {
        key: {
            "label": peers[key].label,
            "steps_per_s": rates[key],
            "fastest_steps_per_s": fastest[key],
            "ours_over_it": rates["ours"] / rates[key],
            "ours_over_it_of_fastest": fastest["ours"] / fastest[key],
            "processor_s_per_step": busy[key],
            "first_losses": losses[key],
        }
        for key in peers
    }


def lines(report):
    """What the table is about."""
    rows, cols = report["size"]
    return [
        f"Training steps in several frameworks, {report['date']}",
        *record.origin(report),
        f"{report['network']}, {report['threads']} threads each, batch {report['batch']} of {rows} x {cols}, float: forward, loss, "
        f"backward, clipping, AdamW. {report['rounds']} turns of {report['steps']} steps each, in turns; medians. The first losses "
        "of all agree.",
    ]


def rows(report):
    """Head and rows: a framework each."""
    made = [["trainer", "steps/s", "fastest", "ours / it", "fastest ours / it", "processor s/step"]]
    keys = ("steps_per_s", "fastest_steps_per_s", "ours_over_it", "ours_over_it_of_fastest", "processor_s_per_step")
    for one in report["trainers"].values():
        made.append([one["label"], *(f"{one[key]:.2f}" for key in keys)])
    return made


def main():
    a = arguments()
    host_train, server = files.programs(a.binaries, "train_server")
    load = os.getloadavg()[0]
    weights = files.weights(a.network, "residual", host_train)
    _, config = network.read(weights)
    trainers = measure(a, weights, server, config)
    report = record.circumstances(a, load) | {"network": Path(a.network).stem, "trainers": trainers}
    report |= {"batch": a.batch, "size": a.size, "threads": a.threads, "rounds": a.rounds, "steps": a.steps}
    print(json.dumps(report, indent=1) if a.json else record.text(lines(report), rows(report)))
    if a.record:
        files.say(f"wrote {record.write(a.record / (report['date'] + '-training'), 'steps', lines(report), rows(report))}")


if __name__ == "__main__":
    main()
