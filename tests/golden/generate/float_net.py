"""The float network as plain functions of named weights (inference only). Images are [1, C, H, W], tokens [H, W, C].

Names follow timm for the Swin part. What the paper leaves open is decided as in the project's documentation: zero padding to
whole windows after the first layer norm, shift of half a window in odd blocks (none along an axis that one window spans),
-100 between tokens that were not neighbours before the shift, bilinear doubling without aligned corners.
"""
import torch
import torch.nn.functional as F

DTM_KERNELS = (11, 9, 7, 5, 3)
EPS = 1e-5


def parameters(config):
    """Shape of every weight by name, in file order."""
    shapes = {}

    def conv_bn(name, inputs, outputs, kernel):
        shapes[f"{name}.conv.weight"] = (outputs, inputs, kernel, kernel)
        for part in ("weight", "bias", "running_mean", "running_var"):
            shapes[f"{name}.bn.{part}"] = (outputs,)

    def affine(name, outputs, *inputs):
        shapes[f"{name}.weight"] = (outputs, *inputs)
        shapes[f"{name}.bias"] = (outputs,)

    width = config["embed"]
    conv_bn("image_encoder.stem", 1, config["stem"], 7)
    affine("image_encoder.swin.patch_embed.proj", width, 1, 4, 4)
    affine("image_encoder.swin.patch_embed.norm", width)
    for i, (depth, heads) in enumerate(zip(config["depths"], config["heads"])):
        stage, dim = f"image_encoder.swin.layers.{i}", width << i
        if i:
            affine(f"{stage}.downsample.norm", 2 * dim)
            shapes[f"{stage}.downsample.reduction.weight"] = (dim, 2 * dim)
        for j in range(depth):
            block = f"{stage}.blocks.{j}"
            affine(f"{block}.norm1", dim)
            affine(f"{block}.attn.qkv", 3 * dim, dim)
            affine(f"{block}.attn.proj", dim, dim)
            shapes[f"{block}.attn.relative_position_bias_table"] = ((2 * config["window"] - 1) ** 2, heads)
            affine(f"{block}.norm2", dim)
            affine(f"{block}.mlp.fc1", 4 * dim, dim)
            affine(f"{block}.mlp.fc2", dim, 4 * dim)
        affine(f"image_encoder.swin.norm{i}", dim)
    for i, kernel in enumerate(DTM_KERNELS):
        conv_bn(f"dtm_encoder.{i}", config["dtm"][i - 1] if i else 1, config["dtm"][i], kernel)
    deep = 8 * width
    conv_bn("fusion", deep + config["dtm"][4], deep, 3)
    skips = (0, 4 * width, 2 * width, width, config["stem"])
    for u, (skip, out) in enumerate(zip(skips, config["decoder"])):
        before = config["decoder"][u - 1] if u else deep
        conv_bn(f"decoder.{u}.main.0", skip + before, out, 5)
        conv_bn(f"decoder.{u}.main.1", out, out, 3)
        conv_bn(f"decoder.{u}.shortcut", before, out, 5)
    affine("head", 1, config["decoder"][4], 3, 3)
    return shapes


def conv_bn(w, name, x, stride=1):
    kernel = w[f"{name}.conv.weight"]
    x = F.conv2d(x, kernel, stride=stride, padding=kernel.shape[-1] // 2)
    mean, var, scale, shift = (w[f"{name}.bn.{p}"].view(-1, 1, 1) for p in ("running_mean", "running_var", "weight", "bias"))
    return (x - mean) / torch.sqrt(var + EPS) * scale + shift


def layer_norm(w, name, x):
    scale, shift = w[f"{name}.weight"], w[f"{name}.bias"]
    return F.layer_norm(x, scale.shape, scale, shift, EPS)


def linear(w, name, x):
    return F.linear(x, w[f"{name}.weight"], w.get(f"{name}.bias"))


def relative_bias(table, k):
    """[heads, k*k, k*k]: table row of (dy + k-1) * (2k-1) + dx + k-1 for query minus key offsets (dy, dx)."""
    at = torch.arange(k * k)
    dy = at[:, None] // k - at[None, :] // k + k - 1
    dx = at[:, None] % k - at[None, :] % k + k - 1
    return table[dy * (2 * k - 1) + dx].permute(2, 0, 1)


def bands(length, k, shift):
    """Which stretch of an axis each token belongs to after the shift: before the last window, its start, its wrapped end."""
    at = torch.arange(length)
    return (at >= length - k).long() + ((at >= length - shift).long() if shift else 0)


def attention(w, name, x, k, shift, heads):
    """Shifted window attention over normalised tokens [H, W, C], one window and one head at a time."""
    height, width, channels = x.shape
    x = F.pad(x, (0, 0, 0, -width % k, 0, -height % k))
    rows, cols = x.shape[:2]
    down, right = (shift if rows > k else 0), (shift if cols > k else 0)
    moved = torch.roll(x, (-down, -right), (0, 1))
    region = bands(rows, k, down)[:, None] * 3 + bands(cols, k, right)[None, :]
    bias = relative_bias(w[f"{name}.relative_position_bias_table"], k)
    mixed = torch.zeros_like(moved)
    depth = channels // heads
    for top in range(0, rows, k):
        for left in range(0, cols, k):
            window = (slice(top, top + k), slice(left, left + k))
            qkv = linear(w, f"{name}.qkv", moved[window].reshape(k * k, channels))
            home = region[window].flatten()
            apart = -100.0 * (home[:, None] != home[None, :]) if down or right else 0.0
            out = []
            for head in range(heads):
                q, key, v = (qkv[:, c * channels + head * depth : c * channels + (head + 1) * depth] for c in range(3))
                out.append(torch.softmax(q @ key.T / depth**0.5 + bias[head] + apart, -1) @ v)
            mixed[window] = linear(w, f"{name}.proj", torch.cat(out, -1)).view(k, k, channels)
    return torch.roll(mixed, (down, right), (0, 1))[:height, :width]


def swin(config, w, image):
    """Four maps [1, C << i, H / (4 << i), W / (4 << i)]."""
    root, k, maps = "image_encoder.swin", config["window"], []
    patches = F.conv2d(image, w[f"{root}.patch_embed.proj.weight"], w[f"{root}.patch_embed.proj.bias"], stride=4)
    x = layer_norm(w, f"{root}.patch_embed.norm", patches[0].permute(1, 2, 0))
    for i, (depth, heads) in enumerate(zip(config["depths"], config["heads"])):
        stage = f"{root}.layers.{i}"
        if i:
            quarters = [x[dy::2, dx::2] for dx in (0, 1) for dy in (0, 1)]
            x = linear(w, f"{stage}.downsample.reduction", layer_norm(w, f"{stage}.downsample.norm", torch.cat(quarters, -1)))
        for j in range(depth):
            block = f"{stage}.blocks.{j}"
            shift = k // 2 if j % 2 else 0
            x = x + attention(w, f"{block}.attn", layer_norm(w, f"{block}.norm1", x), k, shift, heads)
            hidden = F.gelu(linear(w, f"{block}.mlp.fc1", layer_norm(w, f"{block}.norm2", x)))
            x = x + linear(w, f"{block}.mlp.fc2", hidden)
        maps.append(layer_norm(w, f"{root}.norm{i}", x).permute(2, 0, 1)[None])
    return maps


def double(x):
    """Bilinear, corners not aligned: each new pixel is 3/4 its nearest old one and 1/4 the next, per axis."""
    for axis in (2, 3):
        first, last = x.narrow(axis, 0, 1), x.narrow(axis, x.shape[axis] - 1, 1)
        wide = torch.cat([first, x, last], axis)
        before, after = wide.narrow(axis, 0, x.shape[axis]), wide.narrow(axis, 2, x.shape[axis])
        both = torch.stack([0.75 * x + 0.25 * before, 0.75 * x + 0.25 * after], axis + 1)
        x = both.flatten(axis, axis + 1)
    return x


def decode(w, u, x, skip):
    name = f"decoder.{u}"
    inner = x if skip is None else torch.cat([skip, x], 1)
    main = conv_bn(w, f"{name}.main.1", F.relu(conv_bn(w, f"{name}.main.0", double(inner))))
    return F.relu(main + conv_bn(w, f"{name}.shortcut", double(x)))


def head(w, x):
    return F.conv2d(x, w["head.weight"], w["head.bias"], padding=1)


def forward(config, w, image, coarse, maps):
    """The normalised DTM [1, 1, H, W]; feature maps e1..e5, s5, fused, d1..d5 are left in `maps`."""
    encoded = [F.relu(conv_bn(w, "image_encoder.stem", image, 2)), *swin(config, w, image)]
    surface = coarse
    for i in range(5):
        surface = F.relu(conv_bn(w, f"dtm_encoder.{i}", surface, 2))
    x = conv_bn(w, "fusion", torch.cat([encoded[4], surface], 1))
    maps |= {f"e{i + 1}": e for i, e in enumerate(encoded)} | {"s5": surface, "fused": x}
    for u in range(5):
        x = decode(w, u, x, encoded[4 - u] if u else None)
        maps[f"d{u + 1}"] = x
    return F.relu(head(w, x))
