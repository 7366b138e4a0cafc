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
    points, a, b, c : (3, ...) float64
        Points, and corners of the triangle of each; triangles without area are lines or points. Shapes are broadcast:
        what belongs to a triangle is worked out once for all points held against it.

    Returns
    -------
    (3, ...) float64
        Not negative, of sum 1: whatever rounding does, they name a point of the triangle.
    """
    v, w = _weights(points - a, b - a, c - a)
    return np.stack([np.maximum(1 - v - w, 0.0), v, w])


def point_triangle_distance(
    points: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], /
) -> NDArray[np.float64]:
    """Distance of each point from its triangle.

    Parameters
    ----------
    points, a, b, c : (3, ...) float64
        Points, and corners of the triangle of each; broadcast as above.

    Returns
    -------
    (...) float64
        The distance from some point of the triangle, so never too small by more than the rounding of a subtraction.
    """
    ab, ac, away = b - a, c - a, points - a
    v, w = _weights(away, ab, ac)
    # in place: the arrays are large, and fresh ones cost more than the arithmetic
    away -= v * ab
    away -= w * ac
    return np.asarray(np.sqrt(_dot(away, away)))


def _weights(
    ap: NDArray[np.float64], ab: NDArray[np.float64], ac: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights of the corners b and c, by what leads from the corner a to the point and to them."""
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
    along = 1 - on_bc
    far_bc = along**2 * uu + on_bc**2 * vv + 2 * along * on_bc * uv
    far_bc -= 2 * (along * pu + on_bc * pv)
    is_bc = (far_bc < far_ab) & (far_bc < far_ac)
    is_ab = ~is_bc & (far_ab <= far_ac)
    divisor = np.where(inside, area, 1.0)
    v = np.where(inside, v / divisor, np.where(is_bc, along, np.where(is_ab, on_ab, 0.0)))
    w = np.where(inside, w / divisor, np.where(is_bc, on_bc, np.where(is_ab, 0.0, on_ac)))
    return v, w


def _dot(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(u[0] * v[0] + u[1] * v[1] + u[2] * v[2])


def _share(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    """Part / whole within 0..1; 0 where the whole is."""
    return np.clip(part / np.where(whole > 0, whole, np.inf), 0.0, 1.0)
