"""Inner shells: a coarse mesh pulled into a fine one until all of it is proved to be inside, so that it may occlude.

An edge collapse, or the coarse end of a tessellation, bulges out of the surface here and there; drawn as an occluder it
would hide what can be seen past the true surface. Its vertices are therefore moved inward, step by step, and a triangle
counts when every cell of a grid that it touches is enclosed.

**Claim.** Whatever lies behind a triangle of the shell, seen from outside the fine mesh, lies behind the fine mesh.

**Proof.** An enclosed cell is touched by no triangle of the fine surface, and the surface winds around it
(`scenegraph.meshes.solids`): so every way from a point of such a cell to the outside crosses the surface. All of the
triangle lies in such cells; cells that it touches are found with a margin for rounding (`cells`). A line of sight that
ends behind the triangle passes one of its points, and before that, coming from outside, it has crossed the surface.
Triangles that cannot be brought inside, as those of thin ears, are left out; the others do not need them.

From inside the fine mesh nothing is claimed: see `scenegraph.Occluder`, whose `outside_only` is the same condition.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..mesh import Mesh
from .cache import DiskCache
from .cells import Simplices
from .prepared import PreparedMesh, hindrance
from .solids import Interior, interior

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]

#: Counted up whenever results change; part of the name of what is cached.
VERSION = 1
CACHE_KIND = "inner-shells"
#: Steps, in cells, by which each vertex is tried to be moved outward again.
_OUTWARD = (1.0, 1.0, 0.5, 1.0, 0.5)


def inner_shell(
    fine: Mesh, coarse: Mesh, *, cells: int = 96, steps: int = 16, largest: int = 400, cache: DiskCache | None = None
) -> Mesh | None:
    """Pull a coarse mesh into a fine one.

    Parameters
    ----------
    fine : Mesh
        Closed, or it has no inside.
    coarse : Mesh
        About the same surface, in the same coordinates.
    cells : int
        Of the grid along the longest extent: the shell keeps away from the surface by a cell or two.
    steps : int
        Of half a cell, by which a vertex is moved at most.
    largest : int
        Coarse meshes of more triangles are not looked at.
    cache : DiskCache, optional
        Where shells are kept; in the usual folder if not given.

    Returns
    -------
    Mesh or None
        Without normals and colors. None if less than a quarter of the triangles could be brought inside.
    """
    if hindrance(fine) or not 0 < coarse.triangles <= largest or not coarse.is_finite:
        return None
    store = DiskCache() if cache is None else cache
    key = DiskCache.key(f"{fine.key} {coarse.key}", VERSION, {"cells": cells, "steps": steps})
    found = store.load(CACHE_KIND, key)
    if found is None:
        vertices, faces = _pulled(fine, coarse, cells, steps)
        found = {"vertices": vertices, "faces": faces}
        store.store(CACHE_KIND, key, found)
    if 4 * len(found["faces"]) < coarse.triangles:
        return None
    return Mesh(found["vertices"], found["faces"], name=f"{coarse.name}, inner shell")


def _pulled(fine: Mesh, coarse: Mesh, cells: int, steps: int) -> tuple[F64, I64]:
    prepared = PreparedMesh.of(fine)
    points = (coarse.vertices - prepared.center) / prepared.size
    faces = coarse.faces.astype(np.int64)
    inward = -_normals(points, faces)
    rooms = [
        room
        for shell in prepared.worth_a_look("none")
        if (room := interior(shell, np.eye(3), "none", cells=cells, clearance=prepared.clearance)) is not None
    ]
    if not rooms:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64)

    def inside(triangles: I64) -> NDArray[np.bool_]:
        return np.asarray(np.any([_wholly_enclosed(points[triangles], room) for room in rooms], axis=0))

    start = points.copy()
    good = np.zeros(len(faces), bool)
    wanted = np.ones(len(faces), bool)
    for _ in range(2):
        # once to see what can be brought inside, and again without what cannot, which pulls its neighbors along
        points[:] = start
        good[:] = False
        left = np.flatnonzero(wanted)
        for step in range(steps + 1):
            good[left] = inside(faces[left])
            moving = np.zeros(len(points), bool)
            moving[faces[wanted & ~good]] = True
            left = np.flatnonzero(moving[faces].any(axis=1) & wanted)
            if not len(left) or step == steps:
                break
            points[moving] += 0.5 / cells * inward[moving]
        wanted = good.copy()
    kept = faces[good]
    around: list[list[int]] = [[] for _ in points]
    for number, corners in enumerate(kept.tolist()):
        for corner in corners:
            around[corner].append(number)
    for share in _OUTWARD:
        for vertex in np.unique(kept).tolist():
            before = points[vertex].copy()
            points[vertex] -= share / cells * inward[vertex]
            if not inside(kept[around[vertex]]).all():
                points[vertex] = before
    used, index = np.unique(faces[good], return_inverse=True)
    return prepared.in_mesh(points[used]), index.reshape(-1, 3)


def _wholly_enclosed(triangles: F64, room: Interior) -> NDArray[np.bool_]:
    """(m,) whether every cell that a triangle touches is enclosed."""
    placed = (triangles @ room.axes.T - room.origin) / room.cell
    end = np.array(room.enclosed.shape)
    first = np.floor(placed.min(axis=1) - room.margin).astype(np.int64)
    last = np.floor(placed.max(axis=1) + room.margin).astype(np.int64)
    out = np.asarray((first >= 0).all(axis=1) & (last < end).all(axis=1))
    # only cells that are not enclosed can speak against a triangle
    open_cells = np.argwhere(~room.enclosed)
    simplices = Simplices(placed)
    span = np.prod(last - first + 1, axis=1)
    for t in np.flatnonzero(out).tolist():
        block = tuple(slice(int(a), int(b) + 1) for a, b in zip(first[t], last[t], strict=True))
        if span[t] < len(open_cells):
            near = np.argwhere(~room.enclosed[block]) + first[t]
        else:
            near = open_cells[((open_cells >= first[t]) & (open_cells <= last[t])).all(axis=1)]
        rows = np.full(len(near), t)
        out[t] = not simplices.touch(rows, near + 0.5, 0.5 + room.margin).any()
    return out


def _normals(points: F64, faces: I64) -> F64:
    """(v, 3) area-weighted unit normals; 0 where there is none."""
    a, b, c = (points[faces[:, i]] for i in range(3))
    area = np.cross(b - a, c - a)
    total = np.stack([np.bincount(faces.ravel(), np.repeat(area[:, k], 3), len(points)) for k in range(3)], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total / np.where(length > 0, length, 1.0))
