"""Writes shapes/case.json: names, shapes and number of parameters of the paper's network and of its two ablations, from PyTorch modules.

    python3 tests/golden/generate/shapes.py tests/golden/shapes/case.json

Needs torch, torchvision and timm; nothing is allocated (PyTorch's device `meta`).
"""
import json
import sys

import torch

import float_net
import modules

PAPER = {
    "embed": 192,
    "depths": [2, 2, 18, 2],
    "heads": [6, 12, 24, 48],
    "window": 7,
    "stem": 64,
    "dtm": [32, 64, 128, 256, 512],
    "decoder": [768, 384, 192, 96, 48],
}
CASES = {"paper": {}, "upb": {"decoder_kind": "upb"}, "resnet": {"image_encoder": "resnet"}}


def main(path):
    found = {}
    for name, switches in CASES.items():
        with torch.device("meta"):
            network = modules.Network(PAPER | switches, (256, 320))
        parameters = sum(p.numel() for p in network.parameters())
        found[name] = {"parameters": parameters, "shapes": {n: list(t.shape) for n, t in modules.state(network).items()}}
        print(name, parameters, len(found[name]["shapes"]), "tensors")
    assert found["paper"]["parameters"] == 321_282_245
    # The functions of the other golden files take the same tensors.
    assert found["paper"]["shapes"] == {n: list(s) for n, s in float_net.parameters(PAPER).items()}
    with open(path, "w") as file:
        rows = lambda shapes: ",\n".join(f"    {json.dumps(n)}: {json.dumps(s)}" for n, s in sorted(shapes.items()))
        case = lambda c: f'{{\n  "parameters": {c["parameters"]},\n  "shapes": {{\n{rows(c["shapes"])}\n  }}\n}}'
        file.write("{\n" + ",\n".join(f'"{name}": {case(c)}' for name, c in found.items()) + "\n}\n")


if __name__ == "__main__":
    main(sys.argv[1])
