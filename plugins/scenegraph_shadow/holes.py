"""Holes of planar occluders: a box is hidden only if its image stays clear of every hole.

The image of a box is convex, and so is a hole: if the box lies wholly beyond one plane through the eye and an edge of
the hole, nothing of it is seen through the hole. As in OpenSceneGraph, a hole that a nearer occluder hides is no
hole.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import OccluderTable, View
from scenegraph.kernels.shadow_frusta import UNUSED, box_depth_in_frusta_exact
from scenegraph.kernels.silhouettes import cone_side_planes
from scenegraph.kernels.windows import point_outcodes

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def hole_rows(table: OccluderTable, view: View, ids: Ints, rows: Floats) -> tuple[Floats, Ints]:
    """Planes through the edges of the holes of occluders, facing away from the holes.

    Parameters
    ----------
    table : OccluderTable
    view : View
    ids : (m,) int
        Occluders.
    rows : (m, p, 8) float64
        Their shadow frusta.

    Returns
    -------
    planes : (h, q, 8) float64
        Unused ones hold for no box.
    hole_of : (h,) int
        Position in `ids` of each hole's occluder.
    """
    position = {int(number): i for i, number in enumerate(ids)}
    found = [(position[o], table.hole_vertices[a:b]) for o, a, b in table.holes if o in position]
    pierced = {i for i, _ in found}
    whole = np.array([i for i in range(len(ids)) if i not in pierced], np.int64)
    eye = np.asarray(view.eye)
    planes: list[Floats] = []
    hole_of: list[int] = []
    for i, corners in found:
        if not _matters(corners, view, rows[whole]):
            continue
        planes.append(_planes_away(corners.T - eye[:, None], view))
        hole_of.append(i)
    out = np.zeros((len(planes), max((len(p) for p in planes), default=1), 8))
    out[..., 6] = -UNUSED
    for target, given in zip(out, planes, strict=True):
        target[: len(given)] = given
    return out, np.array(hole_of, np.int64)


def _matters(corners: Floats, view: View, rows: Floats) -> bool:
    """Whether a hole can be seen: it is in the view, and not in the shadow of an occluder without holes."""
    points = corners.T - np.asarray(view.eye)[:, None]
    codes = point_outcodes(points, view.planes(view.eye), size=float(np.abs(points).max()))
    if np.bitwise_and.reduce(codes):
        return False
    boxes = np.zeros((6, len(corners)))
    boxes[:3] = corners.T
    depth = box_depth_in_frusta_exact(boxes, rows, eye=np.asarray(view.eye))
    return not bool((depth > 0.0).all(axis=1).any())


def _planes_away(corners: Floats, view: View) -> Floats:
    """(q, 8) rows of the planes through the edges of one hole, (3, q) corners relative to the eye."""
    q = corners.shape[1]
    center = np.repeat(corners.mean(axis=1, keepdims=True), q, axis=1)
    reach = np.full(q, 2.0 * float(np.abs(corners).max()))
    error = 4.0 * float(np.finfo(np.float64).eps) * (reach + 2.0 * max(map(abs, view.eye)))
    normal, offset, slack, turn = cone_side_planes(
        corners,
        np.roll(corners, -1, axis=1),
        center,
        reach=reach,
        error=error,
        direction=view.forward if view.is_parallel else None,
    )
    rows = np.zeros((q, 8))
    rows[:, :3] = -normal.T
    rows[:, 3:6] = -np.abs(rows[:, :3])
    # the offset of a parallel view was reduced toward the hole; here its uncertainty counts the other way
    doubt = (slack + 1e-14) * reach + error
    rows[:, 6] = -offset - 2.0 * doubt if view.is_parallel else -offset
    # directions inside the hole are sums of corners, which may be longer than what they sum to
    rows[:, 7] = -8.0 * slack
    with np.errstate(invalid="ignore"):
        holds = (normal.T @ corners + offset[:, None] >= -2.0 * doubt[:, None]).all(axis=1)
        holds &= np.abs(turn) > 4.0 * slack * reach
    rows[~holds] = 0.0
    rows[~holds, 6] = -UNUSED
    return rows
