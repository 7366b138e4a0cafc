"""Triangles cut into smaller ones as OpenGL's tessellator cuts them, and bent by Phong tessellation.

The pattern is that of the OpenGL 4.6 core specification, section 11.2.2.1, for equal spacing and the same level inside
and on all sides: concentric triangles whose sides have n, n - 2, n - 4, ... equal parts, down to one triangle or a
point. It has 3n²/2 triangles for even n, and (3n² - 1)/2 for odd n.

The surface is that of Boubekeur and Alexa, "Phong Tessellation", SIGGRAPH Asia 2008: a point of the flat triangle is
projected onto the tangent planes of its corners, and the projections are mixed as the point is mixed from the corners.
On a side of the triangle only the side's own ends have weight, so neighbors agree on what they share.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]


def face_tessellation_count(level: int, /) -> int:
    """Triangles into which `face_tessellation` cuts one."""
    return (3 * level * level - level % 2) // 2


def face_tessellation(level: int, /) -> tuple[F64, NDArray[np.int64]]:
    """The pattern of one triangle.

    Parameters
    ----------
    level : int
        Parts of each side, at least 1.

    Returns
    -------
    (p, 3) float64
        Barycentric weights: the three corners; the level - 1 points of side 01, of side 12 and of side 20, in that
        direction; then the inner ones.
    (t, 3) int64
        Counterclockwise if the corners are.
    """
    if level < 1:
        raise ValueError(f"tessellation level {level} is below 1")
    rings: list[NDArray[np.int64]] = []
    numerators: list[NDArray[np.int64]] = []
    count = 0
    for depth in range(level // 2 + 1):
        sides = level - 2 * depth
        if sides < 0:
            break
        ring = _ring(level, depth, sides)
        numerators.append(ring)
        rings.append(count + np.arange(len(ring)))
        count += len(ring)
    faces: list[NDArray[np.int64]] = []
    for depth, ring in enumerate(rings):
        sides = level - 2 * depth
        if sides == 1:
            faces.append(ring[None, :3])
        if sides < 2:
            break
        for side in range(3):
            outer = _side(ring, sides, side)
            inner = _side(rings[depth + 1], sides - 2, side)
            faces.append(_strip(outer, inner))
    weights = np.concatenate(numerators).astype(np.float64) / (3 * level)
    return weights, np.concatenate(faces)


def _ring(level: int, depth: int, sides: int) -> NDArray[np.int64]:
    """Numerators over 3 x level of a ring's corners and of the points between them, side by side."""
    low, high = 2 * depth, 3 * level - 4 * depth
    if sides == 0:
        return np.array([[level] * 3])
    corners = np.where(np.eye(3, dtype=bool), high, low)
    step = np.arange(1, sides)[:, None]
    # a side is low + (high - low) long in two coordinates, and (high - low) / sides is 3: whole numbers all along
    parts = [(corners[k] * (sides - step) + corners[(k + 1) % 3] * step) // sides for k in range(3)]
    return np.concatenate([corners, *parts])


def _side(ring: NDArray[np.int64], sides: int, side: int) -> NDArray[np.int64]:
    """Points of one side of a ring, both corners included; a ring of no sides is a point."""
    if sides == 0:
        return ring[:1]
    start = 3 + side * (sides - 1)
    return np.concatenate([ring[[side]], ring[start : start + sides - 1], ring[[(side + 1) % 3]]])


def _strip(outer: NDArray[np.int64], inner: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles between a side of n parts and the next one inward, of n - 2 parts; diagonals mirror in the middle."""
    ends = np.array([[outer[0], outer[1], inner[0]], [outer[-2], outer[-1], inner[-1]]])
    a, b, c, d = outer[1:-2], outer[2:-1], inner[1:], inner[:-1]
    first = (np.arange(len(a)) < len(a) / 2)[:, None]
    return np.concatenate(
        [
            ends,
            np.where(first, np.stack([a, b, c], axis=1), np.stack([a, b, d], axis=1)),
            np.where(first, np.stack([a, c, d], axis=1), np.stack([b, c, d], axis=1)),
        ]
    )


def face_phong_points(corners: F64, normals: F64, weights: F64, /, *, shape: float = 0.75) -> F64:
    """Points of bent triangles.

    Parameters
    ----------
    corners : (f, 3, 3) float64
    normals : (f, 3, 3) float64
        Of the tangent planes at the corners, of length 1; a normal of 0 leaves its corner's part flat.
    weights : (p, 3) float64
        Barycentric.
    shape : float
        0 keeps the triangle flat; 3/4 is what Boubekeur and Alexa use.

    Returns
    -------
    (f, p, 3) float64
    """
    return _bent(corners, normals, weights, shape)


def edge_phong_points(ends: F64, normals: F64, share: F64, /, *, shape: float = 0.75) -> F64:
    """Points of the bent sides of triangles: from the two ends alone.

    Parameters
    ----------
    ends, normals : (e, 2, 3) float64
    share : (m,) float64
        How far along, 0 to 1.
    shape : float
        See `face_phong_points`.

    Returns
    -------
    (e, m, 3) float64
    """
    return _bent(ends, normals, np.stack([1 - share, share], axis=1), shape)


def _bent(corners: F64, normals: F64, weights: F64, shape: float) -> F64:
    flat = np.zeros((len(corners), len(weights), 3))
    for k in range(corners.shape[1]):
        flat += weights[None, :, k, None] * corners[:, k, None]
    out = flat.copy()
    for k in range(corners.shape[1]):
        away = flat - corners[:, k, None]
        normal = normals[:, k, None]
        height = away[..., 0] * normal[..., 0] + away[..., 1] * normal[..., 1] + away[..., 2] * normal[..., 2]
        out -= (shape * weights[None, :, k] * height)[..., None] * normal
    return out


def face_phong_error(corners: F64, normals: F64, level: int, /, *, shape: float = 0.75) -> F64:
    """How far the flat parts of tessellated triangles lie from the bent surface at most.

    The surface is quadratic in the weights. Where f is quadratic with the Hessian form Q, and L its linear
    interpolation in a triangle with corners vᵢ, L - f = ½ Σ λᵢ λⱼ Q(vᵢ - vⱼ, vᵢ - vⱼ) over the three pairs, and Σ λᵢ
    λⱼ ≤ ⅓.

    Parameters
    ----------
    corners, normals : (f, 3, 3) float64
    level : int
    shape : float
        See `face_phong_points`.

    Returns
    -------
    (f,) float64
        A bound, for distances of the surface from the parts and of the parts from the surface.
    """
    weights, faces = face_tessellation(level)
    sides = weights[faces] - weights[np.roll(faces, -1, axis=1)]
    # the same few directions again and again
    sides = np.unique(np.rint(sides.reshape(-1, 3) * 3 * level), axis=0)
    away = corners[:, None] - corners[:, :, None]
    height = (away * normals[:, :, None]).sum(axis=3)
    out = np.zeros(len(corners))
    for side in sides / (3 * level):
        form = np.zeros((len(corners), 3))
        for k in range(3):
            form += side[k] * (height[:, k] * side).sum(axis=1)[:, None] * normals[:, k]
        # ½ · ⅓ · Q, and Q is twice the form
        np.maximum(out, shape * np.sqrt((form * form).sum(axis=1)) / 3, out=out)
    return out
