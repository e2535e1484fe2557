"""Writes ablations/case.safetensors: the paper's ablations and the residual head, with random weights, and everything computed from one tile.

    python3 tests/golden/generate/ablations.py tests/golden/ablations/case.safetensors

Needs numpy, torch, torchvision, timm and safetensors. Layout of the file: see ../README.md.
"""
import sys

import numpy as np
import torch

import mini
import modules

CONFIG = {
    "embed": 4,
    "depths": [1, 1, 1, 1],  # of Swin, which is not there
    "heads": [1, 1, 1, 1],
    "window": 4,
    "stem": 5,
    "dtm": [3, 4, 4, 6, 8],
    "decoder": [12, 8, 6, 6, 6],
    "head": "residual",
    "image_encoder": "resnet",
    "decoder_kind": "upb",
}
SEED = 33
CORRECTION = 4.0  # deviation of what the residual head adds, in units of [0, 50]


@torch.no_grad()
def main(path):
    random = np.random.default_rng(SEED)
    network = modules.Network(CONFIG, (mini.ROWS, mini.COLS)).eval()
    modules.randomise(network, random)
    image, coarse = mini.inputs(random)
    output, _ = network(image, coarse)
    network.head.weight *= CORRECTION / (output - coarse).std()
    output, maps = network(image, coarse)
    mini.save(path, CONFIG, modules.state(network), (image, coarse), output, maps, random)
    print("deviations of the maps:", {name: round(float(value.std()), 2) for name, value in maps.items()})


if __name__ == "__main__":
    main(sys.argv[1])
