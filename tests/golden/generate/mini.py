"""Writes mini/case.safetensors: a narrow network with random weights, its inputs, feature maps, output, losses, metrics.

    python3 tests/golden/generate/mini.py tests/golden/mini/case.safetensors

Needs numpy, torch and safetensors. The network is written here a second time, as plain functions over a dictionary of
named weights: `float_net.py` says what the Rust code must compute, not how. Layout of the file: see ../README.md.
"""
import json
import os
import sys

import numpy as np
import torch
from safetensors.torch import save_file

import float_net
import scores

CONFIG = {
    "embed": 6,
    "depths": [2, 1, 2, 1],
    "heads": [1, 2, 2, 4],
    "window": 5,
    "stem": 4,
    "dtm": [3, 4, 4, 6, 8],
    "decoder": [16, 8, 8, 4, 4],
}
ROWS, COLS = 64, 96
SEED = 20


def random_weights(random):
    """Weights that keep every map of order one, with batch statistics and biases far from their neutral values."""
    weights = {}
    for name, shape in float_net.parameters(CONFIG).items():
        kind = name.rsplit(".", 1)[-1]
        if kind == "running_var":
            value = random.uniform(0.5, 1.5, shape)
        elif kind == "running_mean" or kind == "bias" or kind == "relative_position_bias_table":
            value = random.normal(0, 0.2, shape)
        elif len(shape) == 1:  # scale of a batch or layer norm
            value = random.normal(1, 0.2, shape)
        else:
            value = random.normal(0, 1.6 / np.sqrt(np.prod(shape[1:])), shape)
        weights[name] = torch.from_numpy(value.astype(np.float32))
    return weights


def inputs(random):
    """An image in [0, 1] and a smooth coarse DTM in [0, 50], with its lowest and highest pixel at the ends."""
    image = random.uniform(0, 1, (1, 1, ROWS, COLS))
    rows, cols = np.mgrid[0:ROWS, 0:COLS]
    coarse = np.zeros((ROWS, COLS))
    for _ in range(6):
        (a, b), phase = random.normal(0, 0.12, 2), random.uniform(0, 6)
        coarse += np.sin(a * rows + b * cols + phase)
    coarse = 50 * (coarse - coarse.min()) / np.ptp(coarse)
    as_tensor = lambda a: torch.from_numpy(a.astype(np.float32)).reshape(1, 1, ROWS, COLS)
    return as_tensor(image), as_tensor(coarse)


def spread_output(weights, image, coarse):
    """Scales the head so that the output has mean 25 and deviation 8, instead of dying in the last ReLU."""
    maps = {}
    float_net.forward(CONFIG, weights, image, coarse, maps)
    raw = float_net.head(weights, maps["d5"])
    gain = 8 / raw.std()
    weights["head.weight"] *= gain
    weights["head.bias"] = 25 + gain * (weights["head.bias"] - raw.mean())


def save(path, config, weights, inputs, output, maps, random):
    """Writes a golden case: weights, inputs, traced maps, output, a truth near the coarse DTM, loss terms and metrics."""
    image, coarse = inputs
    noise = torch.from_numpy(random.normal(0, 1, output.shape).astype(np.float32))
    truth = (coarse + noise).clamp(0, 50)
    tensors = weights | {"input.image": image, "input.coarse": coarse, "output": output, "truth": truth}
    tensors |= {f"trace.{name}": value for name, value in maps.items()}
    metadata = {
        "config": config,
        "loss_terms": scores.loss_terms(truth, output),
        "metrics": scores.metrics(truth, output),
    }
    metadata = {key: json.dumps(value) for key, value in metadata.items()}
    save_file({name: t.contiguous() for name, t in tensors.items()}, path, metadata=metadata)
    os.chmod(path, 0o644)  # save_file makes it private
    print(f"{path}: output {output.min():.2f} to {output.max():.2f}", metadata["loss_terms"], metadata["metrics"])


def main(path):
    random = np.random.default_rng(SEED)
    weights = random_weights(random)
    image, coarse = inputs(random)
    spread_output(weights, image, coarse)
    maps = {}
    output = float_net.forward(CONFIG, weights, image, coarse, maps)
    save(path, CONFIG, weights, (image, coarse), output, maps, random)


if __name__ == "__main__":
    main(sys.argv[1])
