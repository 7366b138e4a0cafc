"""Surfaces as points: the triangles of a snapshot, and points spread over them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..snapshot import Snapshot

Floats = NDArray[np.float64]

#: More triangles than this are thinned out.
TRIANGLES = 1_000_000
#: Most points along an edge of a triangle.
MOST = 512


def row_triangles(snapshot: Snapshot, rows: NDArray[np.intp], frame: Floats, origin: Floats) -> Floats:
    """(f, 3, 3) corners of the triangles of rows, in the grid's directions, relative to `origin`."""
    total = int(snapshot.triangles[0, rows].sum())
    stride = -(-total // TRIANGLES) if total else 1
    parts = []
    for row in rows:
        mesh = snapshot.meshes[snapshot.level_meshes[row, 0]]
        matrix = snapshot.transforms[snapshot.transform_index[row]]
        local = mesh.vertices[mesh.faces[::stride]]
        parts.append((local @ matrix[:3, :3].T + (matrix[:3, 3] - origin)) @ frame.T)
    return np.concatenate(parts) if parts else np.empty((0, 3, 3))


def triangle_samples(triangles: Floats, spacing: float) -> tuple[Floats, Floats]:
    """Points (p, 3) on triangles no farther apart than `spacing`, and the upward part of their unit normals (p,).

    Each triangle is covered by rows parallel to its longest edge, so that slivers take few points.
    """
    length = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    first = np.argmax(length, axis=1)
    turn = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.moveaxis(np.take_along_axis(triangles, turn[:, :, None], axis=1), 1, 0)
    normal = np.cross(b - a, c - a)
    size = np.linalg.norm(normal, axis=1)
    upward = np.divide(normal[:, 2], size, out=np.zeros_like(size), where=size > 0)
    base = np.take_along_axis(length, first[:, None], axis=1)[:, 0]
    # in powers of two, so that there are few different lattices
    along, across = (
        2 ** np.ceil(np.log2(np.clip(np.nan_to_num(x / spacing), 1, MOST))).astype(int)
        for x in (base, np.divide(size, base, out=np.zeros_like(size), where=base > 0))
    )
    points, normals = [], []
    for n, m in np.unique(np.column_stack([along, across]), axis=0):
        s, t = (w.ravel() for w in np.meshgrid(np.linspace(0, 1, n + 1), np.linspace(0, 1, m + 1)))
        # the middle of one that is smaller than the spacing is enough: its neighbors have theirs
        weights = np.column_stack([(1 - s) * (1 - t), s * (1 - t), t]) if n > 1 else np.full((1, 3), 1 / 3)
        chosen = (along == n) & (across == m)
        corners = np.stack([a[chosen], b[chosen], c[chosen]])
        points.append(np.einsum("wk,ktc->twc", weights, corners).reshape(-1, 3))
        normals.append(np.repeat(upward[chosen], len(weights)))
    return np.concatenate([np.empty((0, 3)), *points]), np.concatenate([np.empty(0), *normals])
