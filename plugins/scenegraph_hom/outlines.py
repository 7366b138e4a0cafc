"""A closer look at what its rectangle does not hide: the outline of the drawable's own box, row by row of the map.

The world box of a rotated drawable is larger than the drawable's, and a rectangle larger than either's image. Few
drawables get here, so a few hundred nanoseconds for each row of texels that they touch do not matter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import Snapshot
from scenegraph.kernels.coverage import edge_extents
from scenegraph.kernels.nearness import nearness_codes, nearness_of
from scenegraph.kernels.rectangles import (
    rect_minimum,
)

from .products import OcclusionMap
from .scan import ROUNDING, on_map, snapping
from .shapes import F64, I64

_CORNERS = np.array([[i >> 2 & 1, i >> 1 & 1, i & 1] for i in range(8)], bool)
_EDGES = np.array([(i, i | 1 << k) for i in range(8) for k in range(3) if not i >> k & 1])


def outlines_hidden(occlusion: OcclusionMap, snapshot: Snapshot, rows: I64) -> NDArray[np.bool_]:
    """Which rows lie behind closed texels wherever the image of their local box, at its place, can be.

    Parameters
    ----------
    occlusion : OcclusionMap
    snapshot : Snapshot
    rows : (k,) int64

    Returns
    -------
    (k,) bool
        False where a corner reaches the near plane.
    """
    hidden = np.zeros(len(rows), bool)
    view, size = occlusion.view, occlusion.size
    points, error = _corners(occlusion, snapshot, rows)
    depth = -points[2] - error
    nearest = depth.min(axis=0)
    usable = np.isfinite(points).all(axis=(0, 1)) & (view.is_parallel | (nearest > view.near))
    chosen = np.flatnonzero(usable)
    if not len(chosen):
        return hidden
    points, error, nearest = points[:, :, chosen], error[:, chosen], nearest[chosen]
    x, y, slack = on_map(view, size, points, error)
    slack = slack.max(axis=0) + snapping(view, size)
    clear = slack < 0.5
    a, b = _EDGES.T
    ends = np.stack([x[a], y[a], x[b], y[b]]).reshape(4, -1)
    group = np.tile(np.arange(len(chosen)), len(_EDGES))
    spans = edge_extents(
        ends, group, groups=len(chosen), size=size, slack=np.tile(np.minimum(slack, 0.49), len(_EDGES))
    )
    of, row, first, end = spans
    codes = nearness_codes(nearness_of(nearest, parallel=view.is_parallel), occlusion.scale, occludee=True)
    closed = rect_minimum(occlusion.codes, np.stack([first, row, end, row + 1])) > codes[of]
    seen = np.bincount(of, ~closed, minlength=len(chosen)) > 0
    # what has no texel on the map is outside the view, and not our business
    touched = np.bincount(of, minlength=len(chosen)) > 0
    hidden[chosen] = clear & touched & ~seen
    return hidden


def _corners(occlusion: OcclusionMap, snapshot: Snapshot, rows: I64) -> tuple[F64, F64]:
    """(3, 8, k) corners in eye space of each row's local box over all its levels; (8, k) bounds of their error."""
    view = occlusion.view
    bounds = snapshot.prepared("hom bounds", _mesh_bounds)
    levels = snapshot.level_meshes[rows]
    # levels that a row does not have repeat its first
    levels = np.where(levels >= 0, levels, levels[:, :1])
    low, high = bounds[levels, 0].min(axis=1), bounds[levels, 1].max(axis=1)
    local = np.where(_CORNERS[:, None, :], high, low)
    matrix = snapshot.transforms[snapshot.transform_index[rows]]
    eye = np.asarray(view.eye)
    shift = (matrix[:, :3, 3] - eye) @ view.axes.T
    linear = view.axes @ matrix[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        points = np.einsum("kij,ckj->ick", linear, local) + shift.T[:, None]
        size = np.abs(points).sum(axis=0) + 2 * (np.abs(matrix[:, :3, 3]).sum(axis=1) + np.abs(eye).sum())
    return points, ROUNDING * np.finfo(np.float64).eps * size


def _mesh_bounds(snapshot: Snapshot) -> F64:
    """(m, 2, 3) local bounds of the meshes."""
    return np.array([m.bounds for m in snapshot.meshes]).reshape(-1, 2, 3)
