"""Phong tessellation: a coarse mesh with vertex normals made round, at any level, without cracks.

Boubekeur and Alexa, "Phong tessellation" (SIGGRAPH Asia 2008), eq. 3: a point of a triangle is projected onto the
tangent planes of its corners; the mean of these, weighted as the point is, is blended with the point by α = 3/4.

Triangles are divided as OpenGL's tessellator divides them with all levels equal (OpenGL 4.6, section 11.2.2.1): in
rings within each other, each with two segments less along its sides than the one around it. Level n makes ⌊3n²/2⌋
triangles of one: 1, 6, 13, 24, ... and 600 at level 20.

No cracks: the points along an edge depend on its two ends alone, and are made once per edge.

Model error: the surface is a quadratic polynomial over each triangle, and a level is its linear interpolation. Over a
small triangle with sides d the two differ by the sum of w_i w_j Q(d_ij) over its pairs of corners, with Q the quadratic
part and weights w of sum 1: by no more than a third of the largest |Q|. That is a bound of the distance, and not a
sample of it. A level lies no farther from the finest level than both together lie from the polynomial.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..errors import SceneError
from ..mesh import Mesh

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Levels above this are refused: OpenGL guarantees 64.
HIGHEST = 64
#: How round: 0 is flat.
ALPHA = 0.75


def phong_levels(mesh: Mesh, finest: int, *, alpha: float = ALPHA) -> tuple[list[Mesh], list[float]]:
    """All tessellations of a mesh, finest first, and the model error of each.

    Parameters
    ----------
    mesh : Mesh
        With normals. Triangles that share vertices stay joined.
    finest : int
        Tessellation level of the first; the last is the mesh itself.
    alpha : float
        0 to 1.

    Returns
    -------
    levels : list of Mesh
    errors : list of float
        Upper bound of the distance from the first level, in local units.
    """
    levels = [phong_tessellated(mesh, n, alpha=alpha) for n in range(finest, 0, -1)]
    gaps = [phong_gap(mesh, n, alpha=alpha) for n in range(finest, 0, -1)]
    errors = [0.0, *(gaps[0] + gap for gap in gaps[1:])]
    return levels, np.maximum.accumulate(errors).tolist()


def phong_tessellated(mesh: Mesh, level: int, *, alpha: float = ALPHA) -> Mesh:
    """A mesh with each edge divided in `level` parts and rounded.

    Raises
    ------
    SceneError
        The mesh has no normals, or the level is out of range.
    """
    _check(mesh, level)
    if level == 1:
        return mesh
    weights, triangles = pattern(level)
    faces = mesh.faces.astype(np.int64)
    edges, of_face = np.unique(
        np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0, return_inverse=True
    )
    of_face = of_face.reshape(-1, 3)
    along = np.arange(1, level) / level
    on_edges = _rounded(mesh, edges, np.column_stack([1 - along, along]), alpha)
    within = weights[3 * level :]
    inner = _rounded(mesh, faces, within, alpha)
    corner_count, edge_count = len(mesh.vertices), len(edges) * (level - 1)
    # local numbers of a face's points: its corners and the points between them, all around, then the inner ones
    numbers = np.empty((len(faces), len(weights)), np.int64)
    for side in range(3):
        numbers[:, side * level] = faces[:, side]
        step = np.arange(level - 1)
        forward = faces[:, side] == edges[of_face[:, side], 0]
        place = np.where(forward[:, None], step, level - 2 - step)
        first = corner_count + of_face[:, side] * (level - 1)
        numbers[:, side * level + 1 : (side + 1) * level] = first[:, None] + place
    numbers[:, 3 * level :] = corner_count + edge_count + np.arange(len(faces) * len(within)).reshape(len(faces), -1)
    assert mesh.normals is not None
    points = np.concatenate([mesh.vertices, on_edges[0], inner[0]])
    normals = np.concatenate([mesh.normals.astype(np.float64), on_edges[1], inner[1]])
    return Mesh(
        points,
        numbers[:, triangles].reshape(-1, 3),
        name=f"{mesh.name}, level {level}",
        color=mesh.color,
        normals=normals,
    )


def phong_gap(mesh: Mesh, level: int, *, alpha: float = ALPHA) -> float:
    """Upper bound of the distance between a level and the smooth surface, in local units."""
    _check(mesh, level)
    weights, triangles = pattern(level)
    sides = weights[triangles] - weights[np.roll(triangles, 1, axis=1)]
    sides = np.unique(np.round(sides.reshape(-1, 3), 12), axis=0)
    assert mesh.normals is not None
    corners, normals = mesh.vertices[mesh.faces], mesh.normals.astype(np.float64)[mesh.faces]
    largest = 0.0
    # ((v_j - v_i) · n_i): how far each corner lies above the tangent plane of another
    above = np.einsum("fjc,fic->fij", corners, normals) - np.einsum("fic,fic->fi", corners, normals)[..., None]
    for d in sides:
        q = np.einsum("i,j,fij,fic->fc", d, d, above, normals)
        largest = max(largest, float(np.sqrt((q * q).sum(axis=1)).max(initial=0.0)))
    return alpha * largest / 3


def _check(mesh: Mesh, level: int) -> None:
    if mesh.normals is None:
        raise SceneError(f"mesh {mesh.name!r} has no normals, so it cannot be tessellated; give it vertex normals")
    if not 1 <= level <= HIGHEST:
        raise SceneError(f"tessellation level {level}; expected 1 to {HIGHEST}")


def _rounded(mesh: Mesh, corners: I64, weights: F64, alpha: float) -> tuple[F64, F64]:
    """Points and unit normals at weights (p, k) of the k corners of each of m edges or triangles, (m · p, 3) both."""
    assert mesh.normals is not None
    v, n = mesh.vertices[corners], mesh.normals.astype(np.float64)[corners]
    flat = np.einsum("pk,mkc->mpc", weights, v)
    height = np.einsum("mpc,mkc->mpk", flat, n) - np.einsum("mkc,mkc->mk", v, n)[:, None]
    points = flat - alpha * np.einsum("pk,mpk,mkc->mpc", weights, height, n)
    normals = np.einsum("pk,mkc->mpc", weights, n)
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    normals = normals / np.where(length > 0, length, 1.0)
    return points.reshape(-1, 3), normals.reshape(-1, 3)


@cache
def pattern(level: int) -> tuple[F64, I64]:
    """How a triangle is divided.

    Returns
    -------
    weights : (p, 3) float64
        Barycentric; the first 3·level run around the border from the first corner.
    triangles : (t, 3) int64
    """
    rings: list[list[int]] = []
    weights: list[F64] = []
    count = 0
    for depth in range(level // 2 + 1):
        segments = level - 2 * depth
        off = 2 * depth / (3 * level)
        corners = np.full((3, 3), off) + (1 - 3 * off) * np.eye(3)
        if segments == 0:
            weights.append(np.full((1, 3), 1 / 3))
            rings.append([count] * 3)
            break
        step = (np.arange(segments) / segments)[:, None]
        weights += [(1 - step) * corners[side] + step * corners[(side + 1) % 3] for side in range(3)]
        rings.append(list(range(count, count + 3 * segments)))
        count += 3 * segments
    triangles: list[tuple[int, int, int]] = []
    for depth in range(len(rings)):
        m = level - 2 * depth
        if m == 1:
            triangles.append((rings[depth][0], rings[depth][1], rings[depth][2]))
        elif m > 1:
            for side in range(3):
                outer = [rings[depth][(side * m + j) % (3 * m)] for j in range(m + 1)]
                inside = m - 2
                around = rings[depth + 1]
                inner = [around[(side * inside + j) % len(around)] for j in range(inside + 1)]
                triangles.append((outer[0], outer[1], inner[0]))
                for j in range(1, m - 1):
                    triangles.append((outer[j], outer[j + 1], inner[j - 1]))
                    triangles.append((outer[j + 1], inner[j], inner[j - 1]))
                triangles.append((outer[m - 1], outer[m], inner[inside]))
    found = np.concatenate(weights), np.array(triangles, np.int64)
    for array in found:
        array.flags.writeable = False
    return found
