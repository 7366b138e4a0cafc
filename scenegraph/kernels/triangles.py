"""Points against triangles: the nearest point, and how far it is.

Arrays are components first, as reducing over a short last axis is slow.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Relative area below which a triangle counts as a line: weights inside it would be rounding noise.
SLIVER = 1e-12


def point_triangle_weights(
    points: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], /
) -> NDArray[np.float64]:
    """Barycentric weights of the point of each triangle that is nearest to its point.

    Parameters
    ----------
    points, a, b, c : (3, k) float64
        Points, and corners of the triangle of each; triangles without area are lines or points.

    Returns
    -------
    (3, k) float64
        Not negative, of sum 1: whatever rounding does, they name a point of the triangle.
    """
    ab, ac, ap = b - a, c - a, points - a
    uu, uv, vv = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    pu, pv = _dot(ap, ab), _dot(ap, ac)
    area = uu * vv - uv * uv
    v, w = vv * pu - uv * pv, uu * pv - uv * pu
    inside = (v >= 0) & (w >= 0) & (v + w <= area) & (area > SLIVER * uu * vv)
    # the nearest points of the three sides
    edge = vv - 2 * uv + uu
    on_ab, on_ac = _share(pu, uu), _share(pv, vv)
    on_bc = _share(pv - pu - uv + uu, edge)
    far_ab = on_ab * (on_ab * uu - 2 * pu)
    far_ac = on_ac * (on_ac * vv - 2 * pv)
    along = (1 - on_bc, on_bc)
    far_bc = along[0] ** 2 * uu + along[1] ** 2 * vv + 2 * along[0] * along[1] * uv
    far_bc -= 2 * (along[0] * pu + along[1] * pv)
    is_bc = (far_bc < far_ab) & (far_bc < far_ac)
    is_ab = ~is_bc & (far_ab <= far_ac)
    out = np.zeros((3, points.shape[1]))
    divisor = np.where(inside, area, 1.0)
    out[1] = np.where(inside, v / divisor, np.where(is_bc, along[0], np.where(is_ab, on_ab, 0.0)))
    out[2] = np.where(inside, w / divisor, np.where(is_bc, along[1], np.where(is_ab, 0.0, on_ac)))
    out[0] = np.maximum(1 - out[1] - out[2], 0.0)
    return out


def point_triangle_distance(
    points: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], /
) -> NDArray[np.float64]:
    """Distance of each point from its triangle.

    Parameters
    ----------
    points, a, b, c : (3, k) float64
        Points, and corners of the triangle of each.

    Returns
    -------
    (k,) float64
        The distance from some point of the triangle, so never too small by more than the rounding of a subtraction.
    """
    weights = point_triangle_weights(points, a, b, c)
    away = points - a - weights[1] * (b - a) - weights[2] * (c - a)
    return np.asarray(np.sqrt(_dot(away, away)))


def _dot(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(u[0] * v[0] + u[1] * v[1] + u[2] * v[2])


def _share(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    """Part / whole within 0..1; 0 where the whole is."""
    return np.clip(part / np.where(whole > 0, whole, np.inf), 0.0, 1.0)
