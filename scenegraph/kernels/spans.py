"""Runs of texels in the rows of a map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def span_maximum(
    row: NDArray[np.int64],
    first: NDArray[np.int64],
    end: NDArray[np.int64],
    value: NDArray[np.uint16],
    /,
    *,
    size: tuple[int, int],
) -> NDArray[np.uint16]:
    """Highest value of the spans over each texel, 0 where there is none.

    A sparse table run backwards: a span of length l is the union of two runs of the largest power of two within l, and
    runs are handed down from each power to the next smaller. The cost is two writes per span and two passes over the
    map per power, however often spans overlap.

    Parameters
    ----------
    row, first, end : (k,) int64
        Texels [first, end) of a row; not empty.
    value : (k,) uint16
    size : width, height of the map

    Returns
    -------
    (height, width) uint16
        Row 0 is the lowest.
    """
    width, height = size
    total = width * height
    power = span_power(end - first, width)
    levels = int(power.max(initial=0)) + 1
    runs = np.zeros((levels, total), np.uint16)
    base = power * total + row * width
    flat = runs.reshape(-1)
    np.maximum.at(flat, base + first, value)
    np.maximum.at(flat, base + end - (1 << power), value)
    for k in range(levels - 1, 0, -1):
        shorter, longer, half = runs[k - 1], runs[k], 1 << (k - 1)
        np.maximum(shorter, longer, out=shorter)
        np.maximum(shorter[half:], longer[:-half], out=shorter[half:])
    painted: NDArray[np.uint16] = runs[0].reshape(height, width)
    return painted


def span_power(length: NDArray[np.int64], limit: int, /) -> NDArray[np.int64]:
    """⌊log₂ length⌋; exact, unlike a rounded logarithm.

    Parameters
    ----------
    length : (k,) int
        From 1 to `limit`.
    limit : int

    Returns
    -------
    (k,) int64
    """
    table = np.frexp(np.arange(limit + 1, dtype=np.float64))[1].astype(np.int64) - 1
    return np.asarray(table[length])
