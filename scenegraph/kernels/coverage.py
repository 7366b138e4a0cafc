"""Scan conversion of outlines into spans of covered texels.

An outline is the closed chain of edges around what an occluder covers of the screen. A texel that no edge of it
touches lies wholly inside or wholly outside, so one look at its middle decides for all of it: spans between touched
texels are *inner conservative* without moving any edge. For a convex polygon that is the same set as moving every edge
inward by half a texel in the L1 norm, ``(|a| + |b|) / 2`` for an edge ``a·x + b·y + c``; it also holds for outlines
that are not convex or have holes. Interior edges of a mesh are not in its outline, so merging its faces before
shrinking comes for free.

All outlines are converted at once: their edges' crossings with the rows of texels become one sorted array. The cost
follows the rows that edges cross, not the texels that they enclose.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Edges flatter than this, in texels, count with their whole length in every row that they touch.
FLAT = 1e-4

#: Bits of a packed crossing that hold its turn; an outline wound more often than this is not drawn.
_TURN_BITS = 7

#: Crossings that are looked at together, about: their arrays stay in the second-level cache.
CROSSINGS_AT_ONCE = 1 << 15

Spans = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]


def edge_spans(
    ends: NDArray[np.float64],
    weight: NDArray[np.integer],
    group: NDArray[np.integer],
    /,
    *,
    size: tuple[int, int],
    slack: NDArray[np.float64] | float = 0.0,
    strict: bool = True,
) -> Spans:
    """Runs of covered texels of many outlines.

    Parameters
    ----------
    ends : (4, n) float64
        x0, y0, x1, y1 of each directed edge, in texels, y up. What is to its left is inside.
    weight : (n,) int
        How often the edge is traversed; negative for backwards.
    group : (n,) int, at least 0
        The outline each edge belongs to. Its edges must close, off the map as well.
    size : width, height of the map
    slack : float or (n,) float64
        Uncertainty of the ends, in texels: edges are made thicker by it.
    strict : bool
        Texels that lie wholly inside; otherwise those whose center does.

    Returns
    -------
    group, row, first, end : (k,) int64
        Texels [first, end) of a row are covered; ordered by group, row and first, disjoint within a group.
    """
    width, height = size
    margin = np.broadcast_to(np.asarray(slack, np.float64), weight.shape)
    # such outlines are left out: wound too often to be counted, or known to no better than half a texel
    wild = (np.abs(weight) >= 1 << (_TURN_BITS - 1)) | ~(margin < 0.5) | ~np.isfinite(ends).all(axis=0)
    if wild.any():
        kept = ~np.isin(group, group[wild])
        ends, weight, group, margin = ends[:, kept], weight[kept], group[kept], margin[kept]
    if not len(group):
        none = np.zeros(0, np.int64)
        return none, none, none, none
    if (group[1:] < group[:-1]).any():
        order = np.argsort(group, kind="stable")
        ends, weight, group, margin = ends[:, order], weight[order], group[order], margin[order]
    crossings = _band_crossings if strict else _center_crossings
    # rows in bits of their own: taking a line apart costs no division
    bits = int(height).bit_length()
    found = []
    for part in _parts(ends, group, size):
        lowest = int(group[part.start])
        touched = crossings(ends[:, part], weight[part], (group[part] - lowest) << bits, margin[part], width, height)
        line, first, end = _runs_between(*touched, width)
        found.append(((line >> bits) + lowest, line & ((1 << bits) - 1), first, end))
    if len(found) == 1:
        return found[0]
    groups, rows, firsts, stops = (np.concatenate(each) for each in zip(*found, strict=True))
    return groups, rows, firsts, stops


def _parts(ends: NDArray[np.float64], group: NDArray[np.integer], size: tuple[int, int]) -> list[slice]:
    """Edges, sorted by group, in parts of whole groups: small for the cache, and few enough lines for a packed word."""
    width, height = size
    count = np.clip(np.abs(ends[3] - ends[1]), 0, height) + 2
    first = np.flatnonzero(np.diff(group, prepend=-1))
    before = np.concatenate([[0.0], np.cumsum(np.add.reduceat(count, first))[:-1]])
    lines = 63 - (2 * int(width).bit_length() + _TURN_BITS)
    most = max((1 << lines) >> int(height).bit_length(), 2) - 1
    key = np.stack([before // CROSSINGS_AT_ONCE, (group[first] - group[0]) // most])
    starts = first[np.concatenate([[True], (np.diff(key) != 0).any(axis=0)])]
    return [slice(a, b) for a, b in zip(starts.tolist(), [*starts[1:].tolist(), len(group)], strict=True)]


def _runs_between(
    line: NDArray[np.int64],
    start: NDArray[np.int64],
    stop: NDArray[np.int64],
    turn: NDArray[np.int64],
    width: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Line, first and end of what lies between touched texels and is wound around."""
    bits, half = int(width).bit_length(), 1 << (_TURN_BITS - 1)
    # One sort of packed words moves the crossings as well: nothing has to be gathered afterwards.
    packed = line << bits
    packed |= start
    packed <<= bits
    packed |= stop
    packed <<= _TURN_BITS
    packed |= turn + half
    packed.sort()
    winding = np.cumsum((packed & (2 * half - 1)) - half)
    packed >>= _TURN_BITS
    mask = (1 << bits) - 1
    stop = packed & mask
    packed >>= bits
    line = packed >> bits
    start = packed & mask
    inside = winding > 0
    same = line[1:] == line[:-1]
    last = np.append(np.flatnonzero(~same), len(line) - 1) if len(line) else np.zeros(0, np.int64)
    if winding[last].any():
        inside = _closed_only(winding, last)
    # Touched texels may overlap: a run begins where all edges so far have ended.
    stop |= line << bits
    free = np.maximum.accumulate(stop)
    free &= mask
    same &= inside[:-1]
    same &= start[1:] > free[:-1]
    found = np.flatnonzero(same)
    return line[found], free[found], start[found + 1]


def edge_extents(
    ends: NDArray[np.float64],
    group: NDArray[np.integer],
    /,
    *,
    groups: int,
    size: tuple[int, int],
    slack: NDArray[np.float64] | float = 0.0,
) -> Spans:
    """From the first to the last texel that the edges of a group touch, row by row: no part of it lies outside.

    Parameters
    ----------
    ends : (4, n) float64
        x0, y0, x1, y1 of each edge, in texels, y up.
    group : (n,) int
    groups : int
        Number of groups.
    size : width, height of the map
    slack : float or (n,) float64
        Uncertainty of the ends, in texels, below ½.

    Returns
    -------
    group, row, first, end : (k,) int64
        Ordered by group and row; rows in which nothing is on the map are left out.
    """
    width, height = size
    margin = np.broadcast_to(np.asarray(slack, np.float64), group.shape)
    base = np.asarray(group, np.int64) * height
    line, start, stop, _ = _band_crossings(ends, np.ones(len(group), np.int64), base, margin, width, height)
    first, end = np.full(groups * height, width), np.zeros(groups * height, np.int64)
    np.minimum.at(first, line, start)
    np.maximum.at(end, line, stop)
    line = np.flatnonzero(end > first)
    return line // height, line % height, first[line], end[line]


def _closed_only(winding: NDArray[np.int64], last: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Which crossings have something covered to their right, leaving out rows in which an outline is not closed."""
    count = np.diff(last, prepend=-1)
    before = np.concatenate([[0], winding[last[:-1]]])
    return np.asarray((winding > np.repeat(before, count)) & np.repeat(winding[last] == before, count))


def _upward(
    ends: NDArray[np.float64], weight: NDArray[np.integer]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Lower and upper end, and what crossing the edge from left to right adds to the winding number."""
    x0, y0, x1, y1 = ends
    down = y1 < y0
    turn = np.where(down, weight, -np.asarray(weight, np.int64))
    return np.where(down, x1, x0), np.where(down, y1, y0), np.where(down, x0, x1), np.where(down, y0, y1), turn


def _rows(
    low: NDArray[np.float64], high: NDArray[np.float64], base: NDArray[np.integer], height: int
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Every row from low to high that is on the map: row, line = base + row; counts and starts per edge."""
    first = np.clip(low, 0, height).astype(np.int64)
    count = np.clip(high, -1, height - 1).astype(np.int64) - first + 1
    np.maximum(count, 0, out=count)
    begin = np.cumsum(count) - count
    number = np.arange(int(count.sum()))
    row = (number + np.repeat(first - begin, count)).astype(np.float64)
    number += np.repeat(base + first - begin, count)
    return row, number, count, begin


def _band_crossings(
    ends: NDArray[np.float64],
    weight: NDArray[np.integer],
    base: NDArray[np.integer],
    slack: NDArray[np.float64],
    width: int,
    height: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Line, first and end of the texels that each edge touches, and its turn where it crosses the middle of the row."""
    xl, yl, xu, yu, turn = _upward(ends, weight)
    low, high = np.floor(yl - slack), np.floor(yu + slack)
    row, line, count, begin = _rows(low, high, base, height)
    rise = yu - yl
    flat = rise < FLAT
    slope = np.where(flat, 0.0, (xu - xl) / np.where(flat, 1.0, rise))
    least, most = np.minimum(xl, xu), np.maximum(xl, xu)
    # x = at + row · slope on the row's lower border; a row reaches from 0 - slack to 1 + slack above it
    at = xl - yl * slope
    margin = slack + 8 * np.finfo(np.float64).eps * (np.abs(at) + np.abs(most) + np.abs(least) + height * np.abs(slope))
    fall, climb = np.minimum(slope, 0.0), np.maximum(slope, 0.0)
    left = np.where(flat, least, at + fall + slack * (fall - climb)) - margin
    right = np.where(flat, most, at + climb + slack * (climb - fall)) + margin
    row *= np.repeat(slope, count)
    x = row + np.repeat(left, count)
    np.maximum(x, np.repeat(np.clip(least - margin, 0, width), count), out=x)
    np.minimum(x, float(width), out=x)
    start = x.astype(np.int64)
    row += np.repeat(right, count)
    np.minimum(row, np.repeat(np.clip(most + margin, -1, width), count), out=row)
    # the texel that the right end lies in is touched; -1 gives 0: nothing on the map is
    np.maximum(row, -1.0, out=row)
    row += 1.0
    stop = row.astype(np.int64)
    np.minimum(stop, width, out=stop)
    turns = np.repeat(turn, count)
    # slack is less than half a row: the middle can be missed in the first and in the last row only
    some = count > 0
    turns[begin[some & (np.maximum(low, 0) < np.ceil(yl - 0.5))]] = 0
    turns[(begin + count - 1)[some & (np.minimum(high, height - 1) > np.ceil(yu - 0.5) - 1)]] = 0
    return line, start, stop, turns


def _center_crossings(
    ends: NDArray[np.float64],
    weight: NDArray[np.integer],
    base: NDArray[np.integer],
    slack: NDArray[np.float64],
    width: int,
    height: int,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """The first texel center to the right of each edge in each row whose middle it crosses."""
    xl, yl, xu, yu, turn = _upward(ends, weight)
    row, line, count, _ = _rows(np.ceil(yl - 0.5), np.ceil(yu - 0.5) - 1, base, height)
    rise = yu - yl
    slope = (xu - xl) / np.where(rise > 0, rise, 1.0)
    row *= np.repeat(slope, count)
    row += np.repeat(xl + (0.5 - yl) * slope - 0.5, count)
    np.ceil(row, out=row)
    start = np.clip(row, 0, width).astype(np.int64)
    return line, start, start, np.repeat(turn, count)
