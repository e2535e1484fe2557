"""The network in PyTorch: what the peers run, and train. Weights come from `.safetensors` files as `host-train` writes them.

    python3 benches/peers/network.py tests/golden/mini/case.safetensors

compares every map of a golden case with the stored one. What any deployment folds is folded by `load`: batch norms into
convolutions, 1/sqrt(depth) into the query weights, position bias and shift mask into one table per block. `trainable` folds
nothing.
"""
import json
import sys
from functools import partial

import torch
import torch.nn.functional as F
from safetensors import safe_open
from torch import nn

DTM_KERNELS = (11, 9, 7, 5, 3)
EPSILON = 1e-5  # of batch and layer norms
APART = -100.0  # added between tokens that were not neighbours before the shift
FIXED = {"image_encoder": "swin", "decoder_kind": "residual", "use_coarse": True}
PAYLOAD = ("input.", "trace.", "output", "truth")


def image_maps(config):
    """Brightness, or the four maps of a guide: slope east and south, relief, uncertainty."""
    return 4 if config.get("illumination") in ("given", "weighed") else 1


def conv(inputs, outputs, kernel, stride=1):
    return nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2)


class ConvBn(nn.Module):
    """A convolution that still has its batch norm behind it."""

    def __init__(self, inputs, outputs, kernel, stride=1, momentum=0.1):
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
        self.bn = nn.BatchNorm2d(outputs, EPSILON, momentum)

    def forward(self, x):
        return self.bn(self.conv(x))


def double(x):
    return F.interpolate(x, scale_factor=2.0, mode="bilinear", align_corners=False)


def region(length, window, shift):
    """Which stretch of an axis each token is in after the shift: before the last window, its start, its wrapped end."""
    at = torch.arange(length)
    return (at >= length - window).long() + ((at >= length - shift).long() if shift else 0)


class Attention(nn.Module):
    """Attention among the tokens of each window. `tokens` is the size of the map, `shift` 0 or half a window."""

    def __init__(self, dim, heads, window, shift, tokens):
        super().__init__()
        self.heads, self.window, self.tokens = heads, window, tokens
        self.padded = [-(-n // window) * window for n in tokens]
        self.shift = [shift if n > window else 0 for n in self.padded]
        self.qkv, self.proj = nn.Linear(dim, 3 * dim), nn.Linear(dim, dim)
        self.relative_position_bias_table = nn.Parameter(torch.zeros((2 * window - 1) ** 2, heads))
        self.register_buffer("bias", None, persistent=False)
        self.register_buffer("offset", self.offsets(), persistent=False)
        self.register_buffer("mask", self.apart(), persistent=False)

    def offsets(self):
        """Row of the bias table for each pair of tokens of a window, [n, n]."""
        k = self.window
        y, x = torch.arange(k * k) // k, torch.arange(k * k) % k
        return (y[:, None] - y + k - 1) * (2 * k - 1) + x[:, None] - x + k - 1

    def apart(self):
        """What the shift adds to the scores, [windows, 1, n, n]; None without a shift."""
        k, (rows, cols), (down, right) = self.window, self.padded, self.shift
        if not (down or right):
            return None
        home = region(rows, k, down)[:, None] * 3 + region(cols, k, right)
        home = home.view(rows // k, k, cols // k, k).transpose(1, 2).reshape(-1, k * k)
        return APART * (home[:, None, :, None] != home[:, None, None, :])

    def table(self):
        """What is added to the scores, [1 or windows, heads, n, n]."""
        bias = self.relative_position_bias_table[self.offset].permute(2, 0, 1)[None]
        return bias if self.mask is None else bias + self.mask

    def settle(self):
        """Makes `bias` once the weights are there; the query weights have their scale in them then."""
        self.bias = self.table().detach().contiguous()

    def forward(self, x):
        (height, width), (rows, cols), k = self.tokens, self.padded, self.window
        batch, channels = x.shape[0], x.shape[-1]
        if self.padded != self.tokens:
            x = F.pad(x, (0, 0, 0, cols - width, 0, rows - height))
        if any(self.shift):
            x = torch.roll(x, [-s for s in self.shift], (1, 2))
        x = x.view(batch, rows // k, k, cols // k, k, channels).transpose(2, 3).reshape(-1, k * k, channels)
        q, key, v = self.qkv(x).view(-1, k * k, 3, self.heads, channels // self.heads).permute(2, 0, 3, 1, 4)
        if self.bias is None:
            scores = (q * (channels // self.heads) ** -0.5) @ key.transpose(-2, -1)
            scores = (scores.view(batch, -1, *scores.shape[1:]) + self.table()).view_as(scores)
        else:
            scores = q @ key.transpose(-2, -1) + self.bias
        x = (scores.softmax(-1) @ v).transpose(1, 2).reshape(-1, k * k, channels)
        x = self.proj(x).view(batch, rows // k, cols // k, k, k, channels).transpose(2, 3).reshape(batch, rows, cols, channels)
        if any(self.shift):
            x = torch.roll(x, self.shift, (1, 2))
        return x[:, :height, :width] if self.padded != self.tokens else x


class Mlp(nn.Module):
    def __init__(self, dim):
        super().__init__()
        self.fc1, self.fc2 = nn.Linear(dim, 4 * dim), nn.Linear(4 * dim, dim)

    def forward(self, x):
        return self.fc2(F.gelu(self.fc1(x)))


class Block(nn.Module):
    def __init__(self, dim, *attention):
        super().__init__()
        self.norm1, self.norm2 = nn.LayerNorm(dim, EPSILON), nn.LayerNorm(dim, EPSILON)
        self.attn, self.mlp = Attention(dim, *attention), Mlp(dim)

    def forward(self, x):
        x = x + self.attn(self.norm1(x))
        return x + self.mlp(self.norm2(x))


class PatchEmbed(nn.Module):
    def __init__(self, maps, dim):
        super().__init__()
        self.proj, self.norm = nn.Conv2d(maps, dim, 4, 4), nn.LayerNorm(dim, EPSILON)

    def forward(self, image):
        return self.norm(self.proj(image).permute(0, 2, 3, 1))


class PatchMerging(nn.Module):
    """2x2 tokens to one of `dim` channels, in the order x00, x10, x01, x11 (row, column)."""

    def __init__(self, dim):
        super().__init__()
        self.norm, self.reduction = nn.LayerNorm(2 * dim, EPSILON), nn.Linear(2 * dim, dim, bias=False)

    def forward(self, x):
        batch, rows, cols, channels = x.shape
        x = x.view(batch, rows // 2, 2, cols // 2, 2, channels).permute(0, 1, 3, 4, 2, 5)
        return self.reduction(self.norm(x.reshape(batch, rows // 2, cols // 2, 4 * channels)))


class Stage(nn.Module):
    def __init__(self, config, i, tokens):
        super().__init__()
        dim, window = config["embed"] << i, config["window"]
        self.downsample = PatchMerging(dim) if i else nn.Identity()
        shifts = [window // 2 if j % 2 else 0 for j in range(config["depths"][i])]
        self.blocks = nn.Sequential(*(Block(dim, config["heads"][i], window, shift, tokens) for shift in shifts))

    def forward(self, x):
        return self.blocks(self.downsample(x))


class Swin(nn.Module):
    def __init__(self, config, rows, cols):
        super().__init__()
        self.patch_embed = PatchEmbed(image_maps(config), config["embed"])
        self.layers = nn.ModuleList(Stage(config, i, [rows // (4 << i), cols // (4 << i)]) for i in range(4))
        for i in range(4):
            self.add_module(f"norm{i}", nn.LayerNorm(config["embed"] << i, EPSILON))

    def forward(self, image):
        """Four maps [1, C << i, H / (4 << i), W / (4 << i)]."""
        x, maps = self.patch_embed(image), []
        for i, stage in enumerate(self.layers):
            x = stage(x)
            maps.append(getattr(self, f"norm{i}")(x).permute(0, 3, 1, 2))
        return maps


class ImageEncoder(nn.Module):
    def __init__(self, config, rows, cols, unit):
        super().__init__()
        self.stem, self.swin = unit(image_maps(config), config["stem"], 7, 2), Swin(config, rows, cols)

    def forward(self, image):
        return [F.relu(self.stem(image)), *self.swin(image)]


class DecoderBlock(nn.Module):
    def __init__(self, previous, skip, outputs, unit):
        super().__init__()
        self.main = nn.ModuleList([unit(skip + previous, outputs, 5), unit(outputs, outputs, 3)])
        self.shortcut = unit(previous, outputs, 5)

    def forward(self, x, skip):
        """`x` and `skip` (None in the first block) [1, C, h, w] to [1, C_out, 2h, 2w]."""
        wide = double(x)
        both = wide if skip is None else torch.cat([double(skip), wide], 1)
        return F.relu(self.main[1](F.relu(self.main[0](both))) + self.shortcut(wide))


class Network(nn.Module):
    """`config` as in the weight file's metadata, for tiles of `rows` x `cols`, multiples of 32. `unit` makes convolutions."""

    def __init__(self, config, rows, cols, unit=conv):
        super().__init__()
        for switch, value in FIXED.items():
            if config.get(switch, value) != value:
                raise ValueError(f"configuration: expected {switch} = {value}, found {config[switch]}")
        deep, dtm, decoder = 8 * config["embed"], config["dtm"], config["decoder"]
        skips = [0, deep // 2, deep // 4, deep // 8, config["stem"]]
        self.image_encoder = ImageEncoder(config, rows, cols, unit)
        self.dtm_encoder = nn.ModuleList(unit(i, o, k, 2) for i, o, k in zip([1, *dtm], dtm, DTM_KERNELS))
        self.fusion = unit(deep + dtm[4], deep, 3)
        self.decoder = nn.ModuleList(DecoderBlock(p, s, o, unit) for p, s, o in zip([deep, *decoder], skips, decoder))
        self.head = conv(decoder[4], 1, 3)
        self.residual = config.get("head", "relu") == "residual"

    def maps(self, image, coarse):
        """Every map of a golden case by its name, `output` last."""
        maps = {f"e{i + 1}": e for i, e in enumerate(self.image_encoder(image))}
        surface = coarse
        for layer in self.dtm_encoder:
            surface = F.relu(layer(surface))
        x = self.fusion(torch.cat([maps["e5"], surface], 1))
        maps |= {"s5": surface, "fused": x}
        for u, block in enumerate(self.decoder):
            x = block(x, maps[f"e{5 - u}"] if u else None)
            maps[f"d{u + 1}"] = x
        z = self.head(x)
        return maps | {"output": z + coarse if self.residual else F.relu(z)}

    def forward(self, image, coarse):
        """`image` [1, maps, rows, cols] and `coarse` [1, 1, rows, cols] to the normalised DTM of the shape of `coarse`."""
        return self.maps(image, coarse)["output"]


def fold(tensors, config):
    """Batch norms into the convolutions before them, 1/sqrt(depth) into queries; other tensors as they are."""
    folded = {}
    for name, value in tensors.items():
        if name.endswith(".conv.weight"):
            unit = name.removesuffix(".conv.weight")
            mean, var, gain, bias = (
                tensors[f"{unit}.bn.{part}"].double() for part in ("running_mean", "running_var", "weight", "bias")
            )
            gain = gain / torch.sqrt(var + EPSILON)
            folded[f"{unit}.weight"] = (value.double() * gain.view(-1, 1, 1, 1)).float()
            folded[f"{unit}.bias"] = (bias - mean * gain).float()
        elif ".attn.qkv." in name:
            dim = value.shape[0] // 3
            depth = dim // config["heads"][int(name.split(".layers.")[1][0])]
            folded[name] = torch.cat([value[:dim] * depth**-0.5, value[dim:]])
        elif ".bn." not in name:
            folded[name] = value
    return folded


def read(path):
    """Weights and configuration of a file."""
    with safe_open(path, "pt") as file:
        config = json.loads((file.metadata() or {}).get("config", "null"))
        if config is None:
            raise ValueError("expected the network configuration in metadata `config`, found none")
        return {name: file.get_tensor(name) for name in file.keys() if not name.startswith(PAYLOAD)}, config


def load(path, rows, cols):
    """The network with the weights of `path`, for tiles of `rows` x `cols`, and its configuration."""
    tensors, config = read(path)
    network = Network(config, rows, cols)
    network.load_state_dict(fold(tensors, config))
    for module in network.modules():
        if isinstance(module, Attention):
            module.settle()
    return network.eval().requires_grad_(False), config


def trainable(path, rows, cols):
    """As `load`, to be trained: nothing is folded, batches are normalised by themselves."""
    tensors, config = read(path)
    network = Network(config, rows, cols, partial(ConvBn, momentum=config.get("bn_momentum", 0.1)))
    misfits = network.load_state_dict(tensors, strict=False)
    left_out = [name for name in misfits.missing_keys if not name.endswith("num_batches_tracked")]
    if left_out or misfits.unexpected_keys:
        raise ValueError(f"expected the network's weights, found {left_out} missing and {misfits.unexpected_keys} besides")
    return network.train(), config


def check(path, tolerance=2e-5):
    """Largest difference of each map of a golden case, as a share of its largest value; fails above `tolerance`."""
    with safe_open(path, "pt") as file:
        golden = {name: file.get_tensor(name) for name in file.keys() if name.startswith(PAYLOAD)}
    network, _ = load(path, *golden["output"].shape[2:])
    found = network.maps(golden["input.image"], golden["input.coarse"])
    for name, value in found.items():
        expected = golden["output" if name == "output" else f"trace.{name}"]
        share = ((value - expected).abs().max() / expected.abs().max()).item()
        print(f"{name:7} {list(value.shape)!s:18} {share:.1e}")
        if not share <= tolerance:
            raise SystemExit(f"ERROR: {path}: {name}: expected a difference of at most {tolerance:.0e}, found {share:.1e}")


if __name__ == "__main__":
    check(sys.argv[1])
