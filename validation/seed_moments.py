"""Mean and variance over renders with independent seeds, by pixel or by square tile.

Means over tiles are taken within each render and the variance between renders, so a
sampler that correlates neighbouring pixels or colour channels leaves it unbiased.
"""

from dataclasses import dataclass

import numpy as np


@dataclass
class Moments:
    """Over `count` independent renders; arrays [rows, columns, channels] of pixels or tiles."""

    count: int
    mean: np.ndarray
    variance: np.ndarray  # unbiased, of a single render

    @property
    def variance_of_mean(self):
        return self.variance / self.count


def tile_means(image, tile):
    """Means over tile x tile pixels; tiles at the right and lower border may be smaller."""
    rows = np.arange(0, image.shape[0], tile)
    columns = np.arange(0, image.shape[1], tile)
    sums = np.add.reduceat(np.add.reduceat(image, rows, axis=0), columns, axis=1)
    heights = np.diff(np.append(rows, image.shape[0]))
    widths = np.diff(np.append(columns, image.shape[1]))
    return sums / (heights[:, None] * widths[None, :])[..., None]


def moments(images, tile=1):
    """Moments over an iterable of [height, width, channels] images (Welford's recurrence)."""
    count = 0
    for image in images:
        image = np.asarray(image, dtype=np.float64)
        sample = tile_means(image, tile) if tile > 1 else image
        count += 1
        if count == 1:
            mean, squares = sample.copy(), np.zeros_like(sample)
            continue
        step = sample - mean
        mean += step / count
        squares += step * (sample - mean)
    if count < 2:
        raise ValueError("a variance needs at least two renders")
    return Moments(count, mean, squares / (count - 1))
