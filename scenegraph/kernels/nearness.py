"""Depth as 16-bit codes that grow toward the eye, rounded to the safe side.

A map of occluders needs to answer "is this behind all of that?" and no more. Codes are logarithmic in the depth
between the nearest and the farthest occludee (linear in parallel views), so 65 533 steps resolve 1.7e-4 of the depth
over a range of 1:50 000. Occluders are rounded away from the eye, occludees toward it: a comparison of codes never
hides what a comparison of exact depths would not. Integers also make the map the same on every machine.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

#: Code of the farthest depth; 0 means that nothing covers the texel.
FARTHEST = 1
#: Code of the nearest depth. What is nearer still gets NEAREST + 1, and nothing is behind it.
NEAREST = 65534

#: Spans that are looked at together: their arrays stay in the second-level cache.
SPANS_AT_ONCE = 1 << 13


class NearnessScale(NamedTuple):
    """What turns nearness into codes; from `nearness_scale`."""

    far: float
    factor: float
    margin: float
    parallel: bool


def nearness_scale(low: float, high: float, /, *, parallel: bool, tolerance: float = 1e-8) -> NearnessScale:
    """The scale whose codes span depths from `low` to `high`.

    Parameters
    ----------
    low, high : float
        Least and greatest depth of interest, low ≤ high; both positive unless `parallel`.
    parallel : bool
        Nearness is the negative depth; otherwise the reciprocal of the depth.
    tolerance : float
        Error of nearness values, relative to the value (perspective) or in world units (`parallel`).
    """
    far, extent = (-high, high - low) if parallel else (-np.log(high), np.log(high) - np.log(low))
    # a step is never finer than the error of what is measured with it
    steps = NEAREST - FARTHEST
    factor = steps / max(extent, steps * tolerance, np.finfo(float).tiny * steps)
    return NearnessScale(float(far), float(factor), float(0.01 + factor * tolerance), parallel)


def nearness_of(depth: NDArray[np.float64], /, *, parallel: bool) -> NDArray[np.float64]:
    """Nearness of depths: 1 / depth, or -depth in parallel views; linear over the screen for points of a plane.

    Parameters
    ----------
    depth : (...) float64
        Distances along the line of sight.
    parallel : bool

    Returns
    -------
    (...) float64
    """
    return np.asarray(-depth if parallel else 1.0 / depth)


def nearness_codes(
    nearness: NDArray[np.float64], scale: NearnessScale, /, *, occludee: bool = False
) -> NDArray[np.uint16]:
    """Codes of nearness values.

    Parameters
    ----------
    nearness : (k,) float64
        From `nearness_of`. NaN and, in perspective, what is not positive gives the safe extreme.
    scale : NearnessScale
    occludee : bool
        Round toward the eye instead of away from it.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        value = nearness if scale.parallel else np.log(nearness)
        code = (value - scale.far) * scale.factor + FARTHEST
        if occludee:
            code = np.ceil(code + scale.margin)
            # fmin returns the number where the other is NaN
            return np.asarray(np.maximum(np.fmin(code, NEAREST + 1), FARTHEST)).astype(np.uint16)
        code = np.floor(code - scale.margin)
        return np.asarray(np.minimum(np.fmax(code, FARTHEST), NEAREST + 1)).astype(np.uint16)


def nearness_depth(codes: NDArray[np.uint16], scale: NearnessScale, /) -> NDArray[np.float64]:
    """Depths that codes stand for.

    Parameters
    ----------
    codes : (...) uint16
    scale : NearnessScale

    Returns
    -------
    (...) float64
        +∞ where nothing covers the texel, or only what is at the far end or beyond.
    """
    value = (codes.astype(np.float64) - FARTHEST) / scale.factor + scale.far
    with np.errstate(over="ignore"):
        depth = -value if scale.parallel else np.exp(-value)
    return np.where(codes > FARTHEST, depth, np.inf)


def plane_nearness(
    normal: NDArray[np.float64],
    offset: NDArray[np.float64],
    /,
    *,
    window: tuple[float, float, float, float],
    size: tuple[int, int],
    parallel: bool,
) -> NDArray[np.float64]:
    """(3, k) coefficients a, b, c: the nearness of each plane is a·x + b·y + c at the texel coordinates x, y.

    Parameters
    ----------
    normal : (3, k) float64
        Eye space; need not be normalized.
    offset : (k,) float64
        n·p on the plane; not 0 in perspective (a plane through the eye is edge-on).
    window : left, right, bottom, top
        Tangents, or world units if `parallel`.
    size : width, height of the map
    """
    left, right, bottom, top = window
    dx, dy = (right - left) / size[0], (top - bottom) / size[1]
    if parallel:
        # d = (nx·x + ny·y - offset) / nz
        start = offset - normal[0] * left - normal[1] * bottom
        return np.asarray(np.stack([-normal[0] * dx, -normal[1] * dy, start]) / normal[2])
    start = normal[0] * left + normal[1] * bottom - normal[2]
    return np.asarray(np.stack([normal[0] * dx, normal[1] * dy, start]) / offset)


def span_nearness(
    group: NDArray[np.int64],
    row: NDArray[np.int64],
    first: NDArray[np.int64],
    end: NDArray[np.int64],
    planes: NDArray[np.float64],
    /,
    *,
    step: float,
    relative: bool,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Spans cut into pieces, each with a nearness that all of it has at least.

    The surface of group g is the farthest of its planes at each point, as the front of a convex solid is. Its nearness
    is concave over the screen, so the least of a piece is found at the corners of its first and last texel.

    Parameters
    ----------
    group, row, first, end : (k,) int64
        As from `edge_spans`.
    planes : (p, 3, g) float64
        From `plane_nearness`; fill up with (0, 0, +∞).
    step : float
        Spans are cut until nearness changes by no more than this along a piece, or a piece is one texel.
    relative : bool
        `step` is relative to the least nearness of the span.

    Returns
    -------
    span : (j,) int64
        Which span each piece is from.
    first, end : (j,) int64
    nearness : (j,) float64
    """
    parts = [
        _pieces(
            group[a : a + SPANS_AT_ONCE],
            row[a : a + SPANS_AT_ONCE],
            first[a : a + SPANS_AT_ONCE],
            end[a : a + SPANS_AT_ONCE],
            planes,
            step,
            relative=relative,
        )
        for a in range(0, max(len(group), 1), SPANS_AT_ONCE)
    ]
    if len(parts) == 1:
        return parts[0]
    span, begin, stop, nearness = (np.concatenate(each) for each in zip(*parts, strict=True))
    sizes = [len(part[0]) for part in parts]
    return span + np.repeat(np.arange(len(parts)) * SPANS_AT_ONCE, sizes), begin, stop, nearness


def _pieces(
    group: NDArray[np.int64],
    row: NDArray[np.int64],
    first: NDArray[np.int64],
    end: NDArray[np.int64],
    planes: NDArray[np.float64],
    step: float,
    *,
    relative: bool,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """`span_nearness` of some of the spans."""
    slope = [p[0].take(group) for p in planes]
    # the corner of the texel row where the plane is farthest
    level = [(p[2] + np.minimum(p[1], 0.0)).take(group) + p[1].take(group) * row for p in planes]

    def at(x: NDArray[np.int64], where: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        out = None
        for a, b in zip(slope, level, strict=True):
            value = x * (a if where is None else a.take(where))
            value += b if where is None else b.take(where)
            out = value if out is None else np.minimum(out, value, out=out)
        return np.asarray(out)

    left, right = at(first), at(end)
    least, most = np.minimum(left, right), np.maximum(left, right)
    lowest = least
    if len(planes) > 1:
        # a ridge between two planes may be nearer than both ends
        middle = at((first + end) >> 1)
        lowest, most = np.minimum(least, middle), np.maximum(most, middle)
    limit = step * np.abs(lowest) if relative else step
    length = end - first
    with np.errstate(invalid="ignore", divide="ignore"):
        count = np.ceil((most - lowest) / limit)
    count = np.fmin(np.fmax(count, 1.0), length)
    many = np.flatnonzero(count > 1.0)
    if not len(many):
        return np.arange(len(row)), first, end, least
    one = np.flatnonzero(count <= 1.0)
    pieces = count[many].astype(np.int64)
    source = np.repeat(many, pieces)
    last = np.cumsum(pieces)
    number = np.arange(len(source)) - np.repeat(last - pieces, pieces)
    begin = first.take(source) + (number * np.repeat(length[many] / pieces, pieces)).astype(np.int64)
    stop = np.empty_like(begin)
    stop[:-1] = begin[1:]
    stop[last - 1] = end[many]
    nearness = np.minimum(at(begin, source), at(stop, source))
    return (
        np.concatenate([one, source]),
        np.concatenate([first[one], begin]),
        np.concatenate([end[one], stop]),
        np.concatenate([least[one], nearness]),
    )
