"""Meshes that are convex solids already: they are their own occluder, drawn in by a hair; nothing has to be searched.

**Proof.** The planes of the mesh's convex hull are drawn in by twice the clearance. If each triangle of the mesh lies
beyond one of the planes drawn in, with a clearance to spare, no triangle reaches into what they enclose. The mesh is a
closed shell, so the winding number is the same everywhere in there; it is asked at one point (see `solids`).
"""

from __future__ import annotations

import numpy as np

from ..mesh import Mesh
from .inflate import HalfSpaces, corners_of
from .prepared import F64, PreparedMesh, clearance_of
from .solids import box_corners
from .winding import winding_numbers

#: Hulls of more planes before coplanar ones are joined are not worth a look.
_MOST_VERTICES = 512


def upright_box(mesh: Mesh) -> F64 | None:
    """(8, 3) corners, drawn in, of a mesh that is nothing but a box along its axes: the commonest mesh of plots.

    In a hundredth of the time that taking any mesh apart takes. Twelve triangles on the sides of the box, each edge
    passed once in each direction, are a cycle without a point inside it, so that the volume they enclose says how often
    they go around: once, if it is that of the box.
    """
    if mesh.triangles != 12 or len(mesh.vertices) > 36:
        return None
    points = mesh.vertices[mesh.faces]
    low, high = points.min(axis=(0, 1)), points.max(axis=(0, 1))
    size = high - low
    upper = points == high
    # corners of the box, and each triangle on one of its sides
    is_corner, is_level = upper | (points == low), (upper == upper[:, :1]).all(axis=1)
    if not (size > 0).all() or not is_corner.all() or not is_level.any(axis=1).all():
        return None
    number = (upper @ np.array([1, 2, 4])).astype(np.int64)
    ends = np.concatenate([number[:, [0, 1]], number[:, [1, 2]], number[:, [2, 0]]])
    net = np.zeros((8, 8), np.int64)
    np.add.at(net, (ends[:, 0], ends[:, 1]), 1)
    unit = upper.astype(np.float64) - 0.5
    volume = abs(float(np.einsum("ij,ij->", unit[:, 0], np.cross(unit[:, 1], unit[:, 2])))) / 6
    if not np.array_equal(net, net.T) or abs(volume - 1) > 1e-9:
        return None
    inset = 2 * clearance_of(mesh) * float(size.max())
    return None if 4 * inset > size.min() else box_corners(low + inset, high - inset)


def convex_solid(prepared: PreparedMesh, *, planes: int) -> tuple[F64, bool] | None:
    """Corners (k, 3) of the solid, in the prepared mesh's coordinates, and whether it is a box; None if it is none.

    Parameters
    ----------
    prepared : PreparedMesh
    planes : int
        A solid of more sides is none: stages work on every side.
    """
    from scipy.spatial import ConvexHull, QhullError

    if prepared.pieces != 1 or len(prepared.closed) != 1 or len(prepared.points) > _MOST_VERTICES:
        return None
    triangles = prepared.closed[0].triangles
    try:
        hull = ConvexHull(prepared.points)
    except QhullError:
        return None
    normals, offsets = _sides(hull.equations, prepared.clearance)
    if len(normals) > planes:
        return None
    beyond = np.all(triangles @ normals.T >= offsets - prepared.clearance, axis=1)
    if not np.all(np.any(beyond, axis=1)):
        return None
    middle = prepared.points[hull.vertices].mean(axis=0)
    corners = corners_of(HalfSpaces(normals, offsets - 2 * prepared.clearance), middle)
    if corners is None or winding_numbers(middle[None], triangles)[0] == 0:
        return None
    upright = np.abs(normals @ normals.T)
    is_box = len(normals) == 6 and bool(((upright < 1e-12) | (upright > 1 - 1e-12)).all())
    return corners, is_box


def _sides(equations: F64, clearance: float) -> tuple[F64, F64]:
    """Planes n·x <= d of a hull's facets, those that lie in the same plane joined; d is the least of them."""
    normals, offsets = equations[:, :3], -equations[:, 3]
    same = (normals @ normals.T > 1 - 1e-12) & (np.abs(offsets[:, None] - offsets) < 0.5 * clearance)
    first = same.argmax(axis=1)
    kept = np.unique(first)
    return normals[kept], np.array([offsets[first == k].min() for k in kept])
