"""Which occluders are drawn in a frame."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame
from scenegraph.kernels.boxes import box_outside

from .catalog import Catalog
from .shapes import F64, I64

Ranking = Literal["size", "distance", "visible"]


def select(frame: Frame, catalog: Catalog, *, ranking: Ranking, active: int, triangles: int, reach: float) -> I64:
    """Items to draw in this frame, the best first; ties in the order of the catalog.

    Parameters
    ----------
    frame : Frame
    catalog : Catalog
    ranking : str
        "size": by solid angle of the box; "distance": by its closest point; "visible": half of them by size, then
        what the previous frame left visible.
    active : int
        At most so many.
    triangles : int
        At most so many triangles in all; an item beyond the budget is passed over.
    reach : float
        Leave out what is farther away than this, in world units; 0 for no limit.
    """
    snapshot, view = frame.snapshot, frame.view
    packed = catalog.packed(snapshot)
    # what an earlier stage has coarsened is not what the catalog would draw
    drawn = frame.visible & (frame.level == 0) if frame.level.any() and not catalog.coarsest else frame.visible
    alive = catalog.standing_for(drawn) & (catalog.triangles <= triangles)
    usable = catalog.usable(view, snapshot)
    items = np.flatnonzero(alive if usable is None else alive & usable)
    items = items[~box_outside(packed.take(items, axis=0), view.planes(snapshot.origin), radius=snapshot.radius)[0]]
    boxes = np.ascontiguousarray(packed.take(items, axis=0)[:, :6].T).astype(np.float64)
    offset = np.abs(boxes[:3] - view.relative_eye(snapshot.origin)[:, None])
    gap = np.maximum(offset - boxes[3:], 0.0)
    distance = np.sqrt((gap * gap).sum(axis=0))
    if reach > 0:
        near = distance <= reach
        items, offset, boxes, distance = items[near], offset[:, near], boxes[:, near], distance[near]
    sight = np.abs(view.forward)[:, None] if view.is_parallel else offset
    key = distance if ranking == "distance" else -_apparent_size(sight, boxes[3:], distance, parallel=view.is_parallel)
    previous = frame.previous if ranking == "visible" else None
    seen = np.zeros(len(items), bool)
    if previous is not None and len(previous.visible) == snapshot.n:
        seen = catalog.standing_for(previous.visible)[items]
    chosen = _best(key, seen, catalog.triangles[items], active=active, triangles=triangles, among=2 * active)
    if len(chosen) < active and len(items) > len(chosen):
        # what was looked at does not fit the budget
        chosen = _best(key, seen, catalog.triangles[items], active=active, triangles=triangles, among=len(items))
    return items[chosen]


def _best(key: F64, seen: NDArray[np.bool_], costs: I64, *, active: int, triangles: int, among: int) -> I64:
    """Positions of the lowest keys within the budget; half of the places prefer what was seen."""
    pool = np.arange(len(key))
    if among < len(key):
        # the best come out the same as from a sort of all, ties included
        pool = np.flatnonzero((key <= np.partition(key, among)[among]) | seen)
    order = pool[np.argsort(key[pool], kind="stable")]
    # half of the places go by key in any case: after a turn of the head, what was seen last is far away
    first, rest = order[: active // 2], order[active // 2 :]
    order = np.concatenate([first, rest[seen[rest]], rest[~seen[rest]]])
    if costs[order[:active]].sum() <= triangles:
        return order[:active]
    # the budget goes to the best: what no longer fits is passed over, not the end
    kept: list[int] = []
    for item, cost in zip(order.tolist(), costs[order].tolist(), strict=True):
        if cost <= triangles and len(kept) < active:
            triangles -= cost
            kept.append(item)
    return np.array(kept, np.int64)


def _apparent_size(sight: F64, half: F64, distance: F64, *, parallel: bool) -> F64:
    """Area of boxes across the line of sight over their squared distance; infinite where the eye is inside.

    Lines of sight are given by the magnitudes of their components, so that one formula serves all eight octants.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        length = np.sqrt((sight * sight).sum(axis=0))
        area = 4 * (sight[0] * half[1] * half[2] + sight[1] * half[0] * half[2] + sight[2] * half[0] * half[1]) / length
        if parallel:
            return np.broadcast_to(area, distance.shape)
        # the middle of a long wall may be far away while its end is at hand
        size = area / (length * np.maximum(distance, 0.25 * length))
    return np.where(distance > 0, np.nan_to_num(size, posinf=np.inf), np.inf)
