"""Summed-area tables and pyramids of a map.

Everything is counted in integers. A pyramid of averages loses one uncovered texel among many to rounding (Kristmann
2022, section 3.3): in single precision after 12 levels, in eight bits after 5. Here "all of them" is exact at any size.

Row 0 of a map is the lowest.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T", bound=np.generic)


def map_sums(values: NDArray[np.bool_] | NDArray[np.unsignedinteger], /) -> NDArray[np.signedinteger]:
    """Summed-area table of small integers or booleans (Crow 1984).

    Parameters
    ----------
    values : (h, w) bool or unsigned integer

    Returns
    -------
    (h + 1, w + 1) int32, or int64 where the total could exceed int32
        Entry [y, x] is the sum over [0, y) × [0, x).
    """
    height, width = values.shape
    # booleans have one bit, whatever they take in memory
    bits = 1 if values.dtype == bool else 8 * values.dtype.itemsize
    kind: type[np.signedinteger] = np.int32 if height * width * ((1 << bits) - 1) < 2**31 else np.int64
    sums: NDArray[np.signedinteger] = np.zeros((height + 1, width + 1), kind)
    inner = sums[1:, 1:]
    np.cumsum(values, axis=1, dtype=kind, out=inner)
    # down the columns row by row: cumsum along the first axis strides through memory
    for y in range(1, height):
        inner[y] += inner[y - 1]
    return sums


def map_count_pyramid(covered: NDArray[np.bool_], /) -> list[NDArray[np.signedinteger]]:
    """Covered texels under each cell: level 0 is the map, cells of level k hold 2^k × 2^k texels, the last is one cell.

    Sizes are rounded up, and cells at the upper and right border of an odd-sized map hold fewer texels; see
    `map_cell_texels`.
    """
    return _pyramid(covered.astype(np.int32 if covered.size < 2**31 else np.int64), np.add)


def map_minimum_pyramid(values: NDArray[np.uint16], /) -> list[NDArray[np.uint16]]:
    """Least value under each cell, in the cells of `map_count_pyramid`."""
    return _pyramid(values, np.minimum)


def map_maximum_pyramid(values: NDArray[np.uint16], /) -> list[NDArray[np.uint16]]:
    """Greatest value under each cell, in the cells of `map_count_pyramid`."""
    return _pyramid(values, np.maximum)


def _pyramid(level: NDArray[T], combine: np.ufunc) -> list[NDArray[T]]:
    levels = [level]
    while levels[-1].size > 1:
        levels.append(_reduced(levels[-1], combine))
    return levels


def _reduced(level: NDArray[T], combine: np.ufunc) -> NDArray[T]:
    for axis in (0, 1):
        if level.shape[axis] > 1:
            odd = level.shape[axis] & 1
            cut = [slice(None)] * 2
            cut[axis] = slice(0, level.shape[axis] - odd, 2)
            other = list(cut)
            other[axis] = slice(1, None, 2)
            pairs = combine(level[tuple(cut)], level[tuple(other)])
            tail = [slice(None)] * 2
            tail[axis] = slice(level.shape[axis] - odd, None)
            level = np.concatenate([pairs, level[tuple(tail)]], axis=axis)
    return level


def map_cell_texels(size: tuple[int, int], level: int, /) -> NDArray[np.signedinteger]:
    """(rows, columns) number of texels under each cell of a pyramid level of a map of `size` width, height."""
    kind: type[np.signedinteger] = np.int32 if size[0] * size[1] < 2**31 else np.int64
    across, up = (np.minimum(1 << level, n - np.arange(0, n, 1 << level)) for n in size)
    return np.multiply(up[:, None], across, dtype=kind, casting="same_kind")
