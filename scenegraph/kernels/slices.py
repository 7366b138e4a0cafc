"""Index arithmetic for subtrees that are slices of an array."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def slice_expand(first: NDArray[np.integer], end: NDArray[np.integer], /) -> NDArray[np.int64]:
    """All indices of many slices, one after the other.

    Parameters
    ----------
    first, end : (k,) int
        Half-open slices [first, end); empty ones are allowed.

    Returns
    -------
    (sum of lengths,) int64
    """
    count: NDArray[np.int64] = np.asarray(end, np.int64) - first
    ends = np.cumsum(count)
    total = int(ends[-1]) if len(ends) else 0
    return np.asarray(np.arange(total, dtype=np.int64) + np.repeat(np.asarray(first, np.int64) - (ends - count), count))


def slice_reduce_min_max(
    values: NDArray[np.float64], first: NDArray[np.integer], end: NDArray[np.integer], /
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest value of each component over non-empty slices, ignoring NaN unless a slice has nothing else.

    Parameters
    ----------
    values : (2 c, n) float64
        c rows of lower bounds, then c rows of upper bounds.
    first, end : (k,) int

    Returns
    -------
    low, high : (c, k) float64
    """
    c = len(values) // 2
    index = slice_expand(first, end)
    starts = np.concatenate([[0], np.cumsum(np.asarray(end, np.int64) - first)[:-1]]).astype(np.int64)
    picked = values[:, index]
    return np.fmin.reduceat(picked[:c], starts, axis=1), np.fmax.reduceat(picked[c:], starts, axis=1)


def slice_morton_order(points: NDArray[np.float64], /) -> NDArray[np.int64]:
    """Stable order of points along a Morton (Z) curve; neighbors in the order are neighbors in space.

    Parameters
    ----------
    points : (3, n) float64
        NaN sorts first.

    Returns
    -------
    (n,) int64
    """
    bits = 21
    low = np.nanmin(points, axis=1, keepdims=True, initial=np.inf)
    size = np.nanmax(points, axis=1, keepdims=True, initial=-np.inf) - low
    # one scale for all axes: cells are cubes, so a flat city is not sliced by height first
    widest = float(np.max(size, initial=0.0))
    scale = (2**bits - 1) / widest if widest > 1e-290 else 0.0
    with np.errstate(invalid="ignore", over="ignore"):
        cell = np.nan_to_num((points - low) * scale, nan=0.0, posinf=0.0, neginf=0.0)
    code = np.zeros(points.shape[1], np.uint64)
    for axis in range(3):
        x = cell[axis].astype(np.uint64)
        for shift, mask in (
            (32, 0x1F00000000FFFF),
            (16, 0x1F0000FF0000FF),
            (8, 0x100F00F00F00F00F),
            (4, 0x10C30C30C30C30C3),
            (2, 0x1249249249249249),
        ):
            x = (x | (x << np.uint64(shift))) & np.uint64(mask)
        code |= x << np.uint64(axis)
    return np.argsort(code, kind="stable")


def slice_padded(first: NDArray[np.integer], end: NDArray[np.integer], /) -> NDArray[np.int64]:
    """Indices of many non-empty slices as the rows of a table, short ones padded with their last index.

    Parameters
    ----------
    first, end : (...) int
        Half-open slices [first, end).

    Returns
    -------
    (..., longest) int64
    """
    first, last = np.asarray(first, np.int64), np.asarray(end, np.int64) - 1
    longest = int((last - first).max(initial=-1)) + 1
    index = first[..., None] + np.arange(longest)
    np.minimum(index, last[..., None], out=index)
    return index


def slice_entries(values: NDArray[Any], index: NDArray[np.integer], /) -> NDArray[Any]:
    """Entries of each slice along the last axis by an index of its own, or by one for all.

    Parameters
    ----------
    values : (..., n, m)
    index : (..., k, m or 1) int
        Below n.

    Returns
    -------
    (..., k, m)
        The axes before are those of `values` and then those of `index`.
    """
    if index.shape[-1] == 1:
        # whole rows: no index per entry has to be made
        return np.asarray(values.take(index[..., 0], axis=-2))
    m = values.shape[-1]
    return np.asarray(values.reshape(*values.shape[:-2], -1).take(index * m + np.arange(m), axis=-1))
