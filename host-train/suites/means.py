"""The standard deviation of a mean height, as host-train/evaluate/src/mean.rs has it: for scripts that have numpy alone."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

#: Correlation length of the errors that the image leaves, in coarse pixels.
IMAGE_CORRELATION_PX = 1.0
#: Longest side of the map on which covariances are summed, in blocks of pixels.
SIDE = 1024


def sigma_of_mean(
    sigma: NDArray[Any],
    where: NDArray[np.bool_],
    pixel_m: float,
    coarse_pixel_m: float,
    coarse_sigma_m: float,
    coarse_correlation_m: float,
) -> float:
    """Returns the standard deviation of the mean height over the pixels ``where``, metres."""
    rows, cols = (np.flatnonzero(where.any(axis)) for axis in (1, 0))
    cut = np.s_[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1]
    inside = where[cut]
    image = np.where(inside, np.sqrt(np.maximum(np.square(sigma[cut], dtype="f8") - coarse_sigma_m**2, 0)), 0)
    block = -(-max(inside.shape) // SIDE)
    down, right = np.arange(0, inside.shape[0], block), np.arange(0, inside.shape[1], block)
    shape = 2 * down.size, 2 * right.size
    apart = np.hypot(*np.ix_(np.abs(np.fft.fftfreq(shape[0], 1 / shape[0])), np.arange(shape[1] // 2 + 1)))
    apart *= block * pixel_m

    def pairs(weights: NDArray[Any], length_m: float) -> float:
        """Returns the sum over all pairs of the product of their weights and the correlation."""
        blocks = np.add.reduceat(np.add.reduceat(weights, down, 0, dtype="f8"), right, 1)
        counts = np.fft.irfft2(np.abs(np.fft.rfft2(blocks, shape)) ** 2, shape)[:, : apart.shape[1]]
        # Distances to the left are those to the right; the first and last column have no such twin.
        counts[:, 1:-1] *= 2
        return float(np.sum(counts * np.exp(-apart / length_m)))

    coarse = coarse_sigma_m**2 * pairs(inside, coarse_correlation_m)
    return float(np.sqrt(coarse + pairs(image, IMAGE_CORRELATION_PX * coarse_pixel_m)) / np.count_nonzero(inside))
