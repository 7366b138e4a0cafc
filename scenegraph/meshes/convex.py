"""Meshes that are convex solids already: they are their own occluder, drawn in by a hair; nothing has to be searched.

**Proof.** The planes of the mesh's convex hull are drawn in by twice the clearance. If each triangle of the mesh lies
beyond one of the planes drawn in, with a clearance to spare, no triangle reaches into what they enclose. The mesh is a
closed shell, so the winding number is the same everywhere in there; it is asked at one point (see `solids`).
"""

from __future__ import annotations

import numpy as np

from .inflate import HalfSpaces, corners_of
from .prepared import F64, PreparedMesh
from .winding import winding_numbers

#: Hulls of more planes before coplanar ones are joined are not worth a look.
_MOST_VERTICES = 512


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
