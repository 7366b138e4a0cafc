"""Winding numbers: how often a closed surface (or loop) goes around a point.

The number does not change along any path that does not touch the surface, and is 0 far away. So whoever stands where it
is not 0 is walled in. It is asked only for points that are known to keep a distance from the surface; there the sum of
the angles has an error of far less than the half that would change the rounded result.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

_CHUNK = 1 << 18
#: Farther than this from an integer is no answer: the surface is not closed, or the point lies on it.
_DOUBT = 1e-3


def winding_numbers(points: F64, simplices: F64) -> I64:
    """Winding number of a closed surface or loop around points that do not lie on it.

    Parameters
    ----------
    points : (k, d) float64
    simplices : (m, d, d) float64
        Triangles in space (solid angles after Van Oosterom and Strackee 1983), directed segments in the plane.

    Returns
    -------
    (k,) int
        0 outside, and also where the sum is not near an integer, that is, where there is no answer.
    """
    angle = _solid_angle if points.shape[1] == 3 else _turn
    out = np.zeros(len(points), np.int64)
    for i, point in enumerate(points):
        total = sum(float(angle(simplices[a : a + _CHUNK] - point).sum()) for a in range(0, len(simplices), _CHUNK))
        whole = round(total)
        out[i] = whole if abs(total - whole) < _DOUBT else 0
    return out


def _solid_angle(triangles: F64) -> F64:
    """(m,) signed share of the sphere that triangles cover, seen from the origin."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    la, lb, lc = (np.sqrt(np.einsum("ij,ij->i", p, p)) for p in (a, b, c))
    ab, bc, ca = (np.einsum("ij,ij->i", p, q) for p, q in ((a, b), (b, c), (c, a)))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    return np.asarray(np.arctan2(volume, la * lb * lc + ab * lc + bc * la + ca * lb) / (2 * np.pi))


def _turn(segments: F64) -> F64:
    """(m,) signed share of the circle that segments cover, seen from the origin."""
    a, b = segments[:, 0], segments[:, 1]
    return np.asarray(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], np.einsum("ij,ij->i", a, b)) / (2 * np.pi))
