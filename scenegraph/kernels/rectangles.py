"""Questions about rectangles of a map: how much of it is covered, and what is the least value in it.

Rectangles are (4, k) int64: x0, y0, x1, y1 in texels, half open, on the map. Row 0 of a map is the lowest.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from .spans import span_power

#: Up to so many rectangles with wide windows are looked at one by one, on a small map.
RARE = 4

Rects = NDArray[np.int64]
T = TypeVar("T", bound=np.generic)


def rect_texels(rects: NDArray[np.float64], /, *, size: tuple[int, int]) -> Rects:
    """Texels that rectangles touch.

    Parameters
    ----------
    rects : (4, k) float64
        x0, y0, x1, y1 in texels. NaN gives the whole map.
    size : width, height

    Returns
    -------
    (4, k) int64
        Empty (x1 ≤ x0 or y1 ≤ y0) where the rectangle has no point in the map's interior.
    """
    limit = np.array(size, np.float64)[:, None]
    # fmax and fmin return the number where the other is NaN
    low = np.fmin(np.fmax(rects[:2], 0.0), limit)
    high = np.fmax(np.fmin(rects[2:], limit), 0.0)
    np.floor(low, out=low)
    np.ceil(high, out=high)
    thin = low == high
    if thin.any():
        # a rectangle without width still touches the texel it lies in
        high += thin & (rects[:2] >= 0) & (rects[2:] < limit)
    return np.concatenate([low, high]).astype(np.int64)


def rect_area(rects: Rects, /) -> NDArray[np.int64]:
    """(k,) number of texels; 0 for empty rectangles."""
    return np.asarray(np.maximum(rects[2] - rects[0], 0) * np.maximum(rects[3] - rects[1], 0))


def rect_sums(sums: NDArray[np.signedinteger], rects: Rects, /) -> NDArray[np.int64]:
    """(k,) sum over each rectangle: four reads of a summed-area table."""
    flat, stride = sums.reshape(-1), sums.shape[1]
    x0, y0, x1, y1 = rects
    low, high = y0 * stride, y1 * stride
    total: NDArray[np.int64] = flat.take(high + x1).astype(np.int64)
    total -= flat.take(high + x0)
    total -= flat.take(low + x1)
    total += flat.take(low + x0)
    return total


def rect_minimum(values: NDArray[np.uint16], rects: Rects, /) -> NDArray[np.uint16]:
    """Least value of a map over each rectangle: four reads of a table of minima over windows of 2^i × 2^j texels.

    Tables are made for the window sizes that occur, smaller ones from larger ones' halves, and each is used while it is
    in the cache.

    Parameters
    ----------
    values : (h, w) uint16
    rects : (4, k) int64
        Not empty.

    Returns
    -------
    (k,) uint16
    """
    if not rects.shape[1]:
        return np.zeros(0, np.uint16)
    height, width = values.shape
    x0, y0, x1, y1 = rects
    px, py = span_power(x1 - x0, width), span_power(y1 - y0, height)
    window = (py << 8 | px).astype(np.uint16)
    order = np.argsort(window, kind="stable")
    window = window[order]
    starts = np.flatnonzero(np.diff(window, prepend=-1))
    groups = list(zip(starts.tolist(), [*starts[1:].tolist(), len(order)], strict=True))
    found = np.empty(len(order), np.uint16)
    rare = _rare(window, groups, most=RARE + values.size // 32_768)
    for (a, b), alone in zip(groups, rare, strict=True):
        if alone:
            for i, k in zip(range(a, b), order[a:b].tolist(), strict=True):
                found[i] = values[y0[k] : y1[k], x0[k] : x1[k]].min()
    rare_ones = np.repeat(rare, np.diff(np.append(starts, len(order))))
    # tables of those rows only that are asked for
    low = int(y0[order][~rare_ones].min(initial=height))
    tall = values[low : int(y1[order][~rare_ones].max(initial=low))].reshape(-1)
    corner = ((y0 - low) * width + x0)[order]
    right = (x1 - x0)[order] - (1 << px[order])
    up = ((y1 - y0)[order] - (1 << py[order])) * width
    wide, at_y, at_x = tall, 0, 0
    spare = [np.empty_like(tall) for _ in range(4)]
    for (a, b), alone in zip(groups, rare, strict=True):
        if alone:
            continue
        want_y, want_x = divmod(int(window[a]), 256)
        if at_y < want_y:
            while at_y < want_y:
                tall = _halved(tall, width << at_y, spare[2 + (at_y & 1)])
                at_y += 1
            wide, at_x = tall, 0
        while at_x < want_x:
            wide = _halved(wide, 1 << at_x, spare[at_x & 1])
            at_x += 1
        part = slice(a, b)
        place, dx = corner[part], right[part]
        least = np.minimum(wide.take(place), wide.take(place + dx))
        place = place + up[part]
        np.minimum(least, wide.take(place), out=least)
        found[part] = np.minimum(least, wide.take(place + dx))
    out = np.empty_like(found)
    out[order] = found
    return out


def _rare(window: NDArray[np.uint16], groups: list[tuple[int, int]], *, most: int) -> list[bool]:
    """Groups of the widest windows of each height that hold so few rectangles that a table would take longer."""
    rare = [False] * len(groups)
    height, total = -1, 0
    for g in range(len(groups) - 1, -1, -1):
        a, b = groups[g]
        if window[a] >> 8 != height:
            height, total = int(window[a]) >> 8, 0
        total += b - a
        rare[g] = total <= most
    return rare


def _halved(table: NDArray[np.uint16], step: int, out: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Minima over windows twice as large; the last `step` entries reach beyond the map and are never asked."""
    np.minimum(table[:-step], table[step:], out=out[:-step])
    return out


def rect_count_above(
    values: NDArray[np.uint16], rects: Rects, codes: NDArray[np.uint16], /, *, at_once: int = 1 << 19
) -> NDArray[np.int64]:
    """(k,) how many texels of each rectangle have a value above the rectangle's code; looks at every texel.

    Parameters
    ----------
    values : (h, w) uint16
    rects : (4, k) int64
    codes : (k,) uint16
    at_once : int
        Texels looked at together, unless one rectangle has more.
    """
    flat, width = values.reshape(-1), values.shape[1]
    across, rows = np.maximum(rects[2] - rects[0], 0), np.maximum(rects[3] - rects[1], 0)
    out = np.zeros(len(codes), np.int64)
    part = (np.cumsum(across * rows) - across * rows) // at_once
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    for a, b in zip(starts.tolist(), [*starts[1:].tolist(), len(codes)], strict=False):
        count = rows[a:b]
        rect = np.repeat(np.arange(a, b), count)
        line = np.arange(len(rect)) - np.repeat(np.cumsum(count) - count, count) + rects[1, rect]
        length = across[rect]
        begin = line * width + rects[0, rect]
        texel = np.arange(int(length.sum())) + np.repeat(begin - (np.cumsum(length) - length), length)
        owner = np.repeat(rect, length)
        above = flat.take(texel) > codes.take(owner)
        out[a:b] = np.bincount(owner[above] - a, minlength=b - a)
    return out


def rect_level(rects: Rects, /) -> NDArray[np.int64]:
    """Pyramid level at which a rectangle covers at most four cells: ⌈log₂ max(width, height)⌉.

    Eq. 3.1 of Kristmann 2022, whose sides relative to the viewport times its size in texels are these same numbers.
    """
    longest = np.maximum(np.maximum(rects[2] - rects[0], rects[3] - rects[1]), 1)
    # ceil(log2 n) = bit length of n - 1, taken from the exponent of n - 0.5: no rounded logarithm
    return np.asarray(np.frexp(longest - 0.5)[1], np.int64)


def rect_cells_pass(
    passes: Sequence[NDArray[np.bool_]],
    rects: Rects,
    /,
    *,
    descents: int,
    hopeless: Sequence[NDArray[np.bool_]] | None = None,
    least: Sequence[NDArray[np.uint16]] | None = None,
    codes: NDArray[np.uint16] | None = None,
) -> NDArray[np.bool_]:
    """Whether all of a rectangle passes, by the pyramid: at most four cells, and the cells below those that fail.

    Parameters
    ----------
    passes : list of (rows, columns) bool
        Level by level: the whole cell passes.
    rects : (4, k) int64
        Not empty.
    descents : int
        How many levels below that of eq. 3.1 a failing cell is opened; Kristmann 2022 has 2.
    hopeless : list of (rows, columns) bool, optional
        No part of the cell passes: not worth opening.
    least, codes : list of (rows, columns) uint16 and (k,) uint16, optional
        A cell passes only if its least value is above the code of the rectangle.

    Returns
    -------
    (k,) bool
        True is certain; False may mean that it would have taken more descents to tell.
    """
    out = np.ones(rects.shape[1], bool)
    level = np.minimum(rect_level(rects), len(passes) - 1)
    # four corners; of a small rectangle some are the same cell
    rect = np.repeat(np.arange(len(out)), 4)
    at = level[rect]
    corner = np.tile(np.arange(4), len(out))
    x = np.where(corner & 1, rects[2, rect] - 1, rects[0, rect]) >> at
    y = np.where(corner & 2, rects[3, rect] - 1, rects[1, rect]) >> at
    sizes = np.array([p.shape for p in passes])
    starts = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))[:-1]])
    passing = _joined(passes)
    lost_cause = None if hopeless is None else _joined(hopeless)
    lowest = None if least is None else _joined(least)
    for descent in range(descents + 1):
        cell = starts[at] + y * sizes[at, 1] + x
        good = passing[cell]
        if lowest is not None and codes is not None:
            good &= lowest[cell] > codes[rect]
        failed = np.flatnonzero(~good)
        final = (at[failed] == 0) | (descent == descents)
        if lost_cause is not None:
            final |= lost_cause[cell[failed]]
        out[rect[failed[final]]] = False
        failed = failed[out[rect[failed]]]
        if not len(failed):
            break
        child = np.tile(np.arange(4), len(failed))
        failed = np.repeat(failed, 4)
        rect, at = rect[failed], at[failed] - 1
        x, y = 2 * x[failed] + (child & 1), 2 * y[failed] + (child >> 1)
        x0, y0, x1, y1 = rects[:, rect]
        inside = ((x + 1) << at > x0) & (x << at < x1) & ((y + 1) << at > y0) & (y << at < y1)
        rect, at, x, y = rect[inside], at[inside], x[inside], y[inside]
    return out


def _joined(levels: Sequence[NDArray[T]]) -> NDArray[T]:
    return np.concatenate([level.reshape(-1) for level in levels])
