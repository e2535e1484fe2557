"""Writes published/{timm,original}.safetensors: a small RGB Swin checkpoint in both published namings, an image and timm's feature maps.

    python3 tests/golden/generate/published.py tests/golden/published

Needs numpy, torch, torchvision, timm and safetensors. timm's own conversion of the original naming must give timm's naming back.
"""
import json
import os
import sys
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from safetensors.torch import save_file
from timm.models.swin_transformer import checkpoint_filter_fn

import modules

CONFIG = {"embed": 4, "depths": [2, 1, 2, 1], "heads": [1, 2, 2, 4], "window": 4}
TILE = (128, 128)  # every map is whole windows
SEED = 22


def original(state):
    """The naming of the Swin authors' repository: merging ends a stage, the classifier is bare, index buffers are stored."""
    renamed = {}
    for name, value in state.items():
        parts = name.split(".")
        if parts[0] == "layers" and parts[2] == "downsample":
            parts[1] = str(int(parts[1]) - 1)
        if parts[0] == "head":
            parts.remove("fc")
        renamed[".".join(parts)] = value
    side = CONFIG["window"] ** 2
    for stage, depth in enumerate(CONFIG["depths"]):
        for block in range(depth):
            renamed[f"layers.{stage}.blocks.{block}.attn.relative_position_index"] = torch.zeros(side, side, dtype=torch.int64)
    renamed["layers.0.blocks.1.attn_mask"] = torch.zeros(64, side, side)
    return renamed


@torch.no_grad()
def main(folder):
    random = np.random.default_rng(SEED)
    swin = modules.swin(CONFIG, TILE, 3).eval()
    modules.randomise(swin, random)
    image = torch.from_numpy(random.uniform(0, 1, (1, 1, *TILE)).astype(np.float32))
    maps = swin.forward_intermediates(image.expand(1, 3, *TILE), intermediates_only=True)  # grey as RGB
    # A classification checkpoint has no norms for the four outputs; fresh ones only bring mean 0 and variance 1.
    normed = {f"trace.e{i + 2}": F.layer_norm(m.permute(0, 2, 3, 1), m.shape[1:2]).permute(0, 3, 1, 2) for i, m in enumerate(maps)}
    timm = swin.state_dict()
    theirs = original(timm)
    back = checkpoint_filter_fn(theirs, swin)
    assert back.keys() == timm.keys() and all(torch.equal(back[name], timm[name]) for name in timm)
    assert theirs.keys() != timm.keys()
    files = {"timm": timm, "original": theirs, "maps": {"input.image": image} | normed}
    for name, tensors in files.items():
        path = Path(folder) / f"{name}.safetensors"
        metadata = {"config": json.dumps(CONFIG)} if name == "maps" else {"format": "pt"}
        save_file({key: value.contiguous() for key, value in tensors.items()}, path, metadata=metadata)
        os.chmod(path, 0o644)  # save_file makes it private
        print(path, len(tensors), "tensors", path.stat().st_size, "bytes")


if __name__ == "__main__":
    main(sys.argv[1])
