"""The network as PyTorch modules, with the paper's ablations; parameters carry the interchange names.

Swin and the residual blocks are other people's code: timm's `SwinTransformer` and torchvision's `BasicBlock`. The rest is written from the
paper: Fig. 5 (coarse branch), Eq. 3 (fusion), Fig. 6 (decoder), and the up-projection of Hu et al. (2019), by which the ablation replaces
the decoder's blocks. Needs torch, torchvision and timm.
"""
import torch
import torch.nn as nn
import torch.nn.functional as F
from timm.models.swin_transformer import SwinTransformer
from torchvision.models.resnet import BasicBlock

RESNET_BLOCKS = 2  # per stage, as in ResNet-18


class ConvBn(nn.Module):
    def __init__(self, inputs, outputs, kernel, stride=1):
        super().__init__()
        self.conv = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
        self.bn = nn.BatchNorm2d(outputs)

    def forward(self, x):
        return self.bn(self.conv(x))


class ResNet(nn.Module):
    """E1 to E2..E5: four stages of basic blocks, the first of each with stride 2 and a 1x1 shortcut."""

    def __init__(self, config):
        super().__init__()
        widths = [config["stem"], *(config["embed"] << i for i in range(4))]
        self.stages = nn.ModuleList(self.stage(*pair) for pair in zip(widths, widths[1:]))

    @staticmethod
    def stage(inputs, outputs):
        shortcut = nn.Sequential(nn.Conv2d(inputs, outputs, 1, 2, bias=False), nn.BatchNorm2d(outputs))
        first = BasicBlock(inputs, outputs, 2, shortcut)
        return nn.Sequential(first, *(BasicBlock(outputs, outputs) for _ in range(RESNET_BLOCKS - 1)))

    def forward(self, x):
        maps = []
        for stage in self.stages:
            x = stage(x)
            maps.append(x)
        return maps


class DecoderBlock(nn.Module):
    """Fig. 6. As up-projection (`upb`) both paths see skip and previous output; else the shortcut sees the previous output alone."""

    def __init__(self, previous, skip, outputs, upb):
        super().__init__()
        self.upb = upb
        self.main = nn.ModuleList([ConvBn(skip + previous, outputs, 5), ConvBn(outputs, outputs, 3)])
        self.shortcut = ConvBn(skip + previous if upb else previous, outputs, 5)

    def forward(self, previous, skip):
        both = previous if skip is None else torch.cat([skip, previous], 1)
        size = [2 * side for side in previous.shape[2:]]
        double = lambda x: F.interpolate(x, size=size, mode="bilinear", align_corners=False)
        main = self.main[1](F.relu(self.main[0](double(both))))
        return F.relu(main + self.shortcut(double(both if self.upb else previous)))


class ImageEncoder(nn.Module):
    def __init__(self, config, tile):
        super().__init__()
        self.stem = ConvBn(1, config["stem"], 7, 2)
        if config.get("image_encoder") == "resnet":
            self.resnet = ResNet(config)
        else:
            self.swin = swin(config, tile, 1)
            for i in range(4):  # on the four outputs; classification has one norm after the last stage instead
                self.swin.add_module(f"norm{i}", nn.LayerNorm(config["embed"] << i))
            del self.swin.norm, self.swin.head

    def forward(self, image):
        first = F.relu(self.stem(image))
        return [first, *self.resnet(first)]


class Network(nn.Module):
    """Runs with the ResNet encoder; with Swin it is a list of names and shapes."""

    def __init__(self, config, tile):
        super().__init__()
        self.residual = config.get("head") == "residual"
        self.image_encoder = ImageEncoder(config, tile)
        widths = [1, *config["dtm"]]
        self.dtm_encoder = nn.ModuleList(ConvBn(*pair, k, 2) for *pair, k in zip(widths, widths[1:], (11, 9, 7, 5, 3)))
        deep = 8 * config["embed"]
        self.fusion = ConvBn(deep + widths[-1], deep, 3)
        skips = [0, deep // 2, deep // 4, deep // 8, config["stem"]]
        before = [deep, *config["decoder"]]
        upb = config.get("decoder_kind") == "upb"
        self.decoder = nn.ModuleList(DecoderBlock(b, s, o, upb) for b, s, o in zip(before, skips, config["decoder"]))
        self.head = nn.Conv2d(config["decoder"][-1], 1, 3, padding=1)

    def forward(self, image, coarse):
        """The normalised DTM, and the feature maps by name."""
        encoded = self.image_encoder(image)
        surface = coarse
        for unit in self.dtm_encoder:
            surface = F.relu(unit(surface))
        x = self.fusion(torch.cat([encoded[4], surface], 1))
        maps = {f"e{i + 1}": e for i, e in enumerate(encoded)} | {"s5": surface, "fused": x}
        for u, block in enumerate(self.decoder):
            x = block(x, encoded[4 - u] if u else None)
            maps[f"d{u + 1}"] = x
        z = self.head(x)
        return z + coarse if self.residual else F.relu(z), maps


def swin(config, tile, channels):
    """timm's transformer, with a classifier of three classes; windows keep their size however small a map is."""
    return SwinTransformer(
        img_size=tile, in_chans=channels, num_classes=3, embed_dim=config["embed"], depths=config["depths"],
        num_heads=config["heads"], window_size=config["window"], always_partition=True, drop_path_rate=0.0,
    )


def interchange(name):
    """The project's name of a parameter of [`Network`]; None for PyTorch's counters of batches."""
    if name.endswith("num_batches_tracked"):
        return None
    if ".resnet." in name:
        for theirs, ours in (
            (".downsample.0.", ".shortcut.conv."), (".downsample.1.", ".shortcut.bn."),
            (".conv1.", ".conv1.conv."), (".bn1.", ".conv1.bn."), (".conv2.", ".conv2.conv."), (".bn2.", ".conv2.bn."),
        ):
            name = name.replace(theirs, ours)
    return name


def state(network):
    """Parameters and batch statistics by interchange name."""
    return {interchange(name): value for name, value in network.state_dict().items() if interchange(name)}


def randomise(module, random):
    """Weights that keep every map of order one, with batch statistics and biases far from their neutral values."""
    for name, value in module.state_dict().items():
        kind = name.rsplit(".", 1)[-1]
        if kind == "num_batches_tracked":
            continue
        if kind == "running_var":
            new = random.uniform(0.5, 1.5, value.shape)
        elif kind in ("running_mean", "bias", "relative_position_bias_table"):
            new = random.normal(0, 0.2, value.shape)
        elif value.dim() == 1:  # scale of a batch or layer norm
            new = random.normal(1, 0.2, value.shape)
        else:
            new = random.normal(0, 1.2 / value[0].numel() ** 0.5, value.shape)
        value.copy_(torch.from_numpy(new))
