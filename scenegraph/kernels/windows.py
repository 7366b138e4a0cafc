"""Points and edges against the planes of a view."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Rounding of a plane's distance in units of float64 epsilon.
ROUNDING = 64.0

_EPS = float(np.finfo(np.float64).eps)


#: One bit per plane.
_BITS = np.array([1, 2, 4, 8, 16, 32, 64, 128], np.uint8)


def point_sides(
    points: NDArray[np.float64], planes: NDArray[np.float64], /, *, size: float, around: int
) -> tuple[NDArray[np.uint8], NDArray[np.bool_]]:
    """`point_outcodes` for some planes and `point_inside` for the first of them, for little more than one of the two.

    Parameters
    ----------
    points, planes, size
        See `point_outcodes`.
    around : int
        To how many planes the second result belongs.

    Returns
    -------
    codes : (...) uint8
    inside : (...) bool
    """
    with np.errstate(invalid="ignore", over="ignore"):
        level = planes[:, :3] @ points.reshape(3, -1)
        level += planes[:, 3:]
        limit = ROUNDING * _EPS * (size + np.abs(planes[:, 3:]))
        outside = level < -limit
        inside = np.logical_and.reduce(level[:around] > limit[:around], axis=0)
    shape = points.shape[1:]
    return (_BITS[: len(planes)] @ outside.view(np.uint8)).reshape(shape), inside.reshape(shape)


def point_outcodes(points: NDArray[np.float64], planes: NDArray[np.float64], /, *, size: float) -> NDArray[np.uint8]:
    """Of which planes each point is surely on the outer side, one bit per plane (Cohen & Sutherland).

    Two points with a bit in common lie outside the same plane, and so does all between them.

    Parameters
    ----------
    points : (3, ...) float64
    planes : (up to 8, 4) float64
        Inside is n·x + d ≥ 0.
    size : float
        No coordinate is larger.

    Returns
    -------
    (...) uint8
        Bit i, of value 2**i, for plane i. What is within rounding of a plane, or not a number, has no bit.
    """
    return point_sides(points, planes, size=size, around=0)[0]


def point_inside(points: NDArray[np.float64], planes: NDArray[np.float64], /, *, size: float) -> NDArray[np.bool_]:
    """Which points lie surely and strictly inside all planes; for parameters see `point_outcodes`.

    Returns
    -------
    (...) bool
        False for what is within rounding of a plane, or not a number.
    """
    return point_sides(points, planes, size=size, around=len(planes))[1]


def edge_enters(
    start: NDArray[np.float64], end: NDArray[np.float64], planes: NDArray[np.float64], /, *, size: float
) -> NDArray[np.bool_]:
    """Which segments surely have a point strictly inside all planes: a part of a millionth of them at least.

    Parameters
    ----------
    start, end : (3, ...) float64
    planes : (p, 4) float64
        Inside is n·x + d ≥ 0.
    size : float
        No coordinate is larger.

    Returns
    -------
    (...) bool
        False where a coordinate is not a number.
    """
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        limit = ROUNDING * _EPS * (size + np.abs(planes[:, 3:]))
        ends = np.stack([start.reshape(3, -1), end.reshape(3, -1)])
        level = planes[:, :3] @ ends + (planes[:, 3:] - limit)
        out = ~(level > 0.0)
        # where along the segment each plane is crossed; nowhere inside a plane that both ends are outside of
        at = level[0] / (level[0] - level[1])
        first = np.where(out[0], np.where(out[1], np.inf, at), 0.0).max(axis=0, initial=0.0)
        last = np.where(out[1], at, 1.0).min(axis=0, initial=1.0)
        return np.asarray(last - first > 1e-6).reshape(start.shape[1:])
