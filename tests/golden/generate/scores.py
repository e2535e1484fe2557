"""Loss terms (Eq. 5-7) and metrics (Eq. 11-17) in numpy, double precision."""
import numpy as np

OFFSET = 1e-3


def slopes(z):
    """Sobel derivatives per pixel (divided by 8) along columns and rows, border replicated."""
    p = np.pad(z, 1, mode="edge")
    across = p[:, 2:] - p[:, :-2]
    down = p[2:] - p[:-2]
    return (across[:-2] + 2 * across[1:-1] + across[2:]) / 8, (down[:, :-2] + 2 * down[:, 1:-1] + down[:, 2:]) / 8


def plain(tensor):
    return tensor[0, 0].numpy().astype(np.float64)


def loss_terms(truth, output):
    """[mean-normalised L1, L1 of gradients, 1 - cosine of normals]."""
    t, p = plain(truth), plain(output)
    elevation = np.abs(t / (t.mean() + OFFSET) - p / (p.mean() + OFFSET)).mean()
    (tx, ty), (px, py) = slopes(t), slopes(p)
    gradient = np.abs(tx - px).mean() + np.abs(ty - py).mean()
    one = np.ones_like(tx)
    n, m = np.stack([-tx, -ty, one]), np.stack([-px, -py, one])
    cosine = (n * m).sum(0) / np.linalg.norm(n, axis=0) / np.linalg.norm(m, axis=0)
    return [float(elevation), float(gradient), float((1 - cosine).mean())]


def metrics(truth, output):
    """REL, log10 and a_j over pixels with truth above OFFSET, with the prediction raised to OFFSET for log10 and a_j."""
    t, p = plain(truth), plain(output)
    e = p - t
    keep = t > OFFSET
    high = np.maximum(p[keep], OFFSET)
    ratio = np.maximum(t[keep] / high, high / t[keep])
    found = {
        "rel": np.mean(np.abs(e[keep]) / t[keep]),
        "rmse": np.sqrt(np.mean(e**2)),
        "log10": np.mean(np.abs(np.log10(t[keep] / high))),
        "psnr": 10 * np.log10(p.max() ** 2 / np.mean(e**2)),
        "mae": np.mean(np.abs(e)),
    }
    found |= {f"a{j}": np.mean(ratio < 1.25**j) for j in (1, 2, 3)}
    found |= {f"re_{n}m": np.mean(np.abs(e) < n) for n in (2, 4, 10)}
    return {name: float(value) for name, value in found.items()}
