"""Which occluders are drawn: the catalog of what may be one, and its ranking for a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, Mesh, Snapshot
from scenegraph.kernels.boxes import box_from_bounds, box_outside, box_packed

from .shapes import F64, I64, ShapeTable, occluder_shapes

Source = Literal["auto", "declared", "meshes"]
Ranking = Literal["size", "distance", "visible"]


@dataclass
class Catalog:
    """Everything in a snapshot that may be drawn as an occluder: opaque drawables, and declared occluders.

    Attributes
    ----------
    table : ShapeTable
    mesh : (i,) int64
        Which of the table's meshes each item is.
    transform : (i,) int64
        Index into the snapshot's transforms.
    row : (i,) int64
        The drawable, or -1 for a declared occluder.
    declared : (i,) int64
        Index into `snapshot.occluders`, or -1.
    owner : (i, 2) int64
        First and end row that the item may never hide; empty for a drawable, which is what one sees.
    triangles : (i,) int64
    coarsest : bool
        Drawables are drawn at their coarsest level instead of their finest.
    """

    table: ShapeTable
    mesh: I64
    transform: I64
    row: I64
    declared: I64
    owner: I64
    triangles: I64
    coarsest: bool
    _packed: NDArray[np.float32]
    _version: int = -1

    def __len__(self) -> int:
        return len(self.mesh)

    def packed(self, snapshot: Snapshot) -> NDArray[np.float32]:
        """(i, 8) boxes relative to the snapshot's origin, as `snapshot.packed`."""
        if self._version != snapshot.version:
            self._version = snapshot.version
            drawables = self.row >= 0
            self._packed[drawables] = snapshot.packed[self.row[drawables]]
            if not drawables.all():
                self._packed[~drawables] = box_packed(
                    _declared_boxes(snapshot)[:, self.declared[~drawables]], snapshot.origin
                )
        return self._packed


def _declared_boxes(snapshot: Snapshot) -> F64:
    table = snapshot.occluders
    low = np.minimum.reduceat(table.vertices, table.vertex_first[:-1]).T
    high = np.maximum.reduceat(table.vertices, table.vertex_first[:-1]).T
    return box_from_bounds(low, high)


def make_catalog(snapshot: Snapshot, *, source: Source, largest: int, coarsest: bool) -> Catalog:
    """What may be drawn.

    Parameters
    ----------
    snapshot : Snapshot
    source : str
        "declared": declared occluders only; "meshes": drawables only; "auto": declared occluders, and drawables that
        none of them stands for. A planar occluder is left out where a solid stands for the same rows.
    largest : int
        Drawables of more triangles are left out.
    coarsest : bool
        Draw the coarsest level of drawables instead of the finest.
    """
    declared = snapshot.occluders
    count = len(declared) if source != "meshes" else 0
    chosen = np.arange(count)
    if source == "auto" and count:
        solids = {tuple(o) for o in declared.owner[declared.solid].tolist() if o[1] > o[0]}
        spare = [not s and tuple(o) in solids for s, o in zip(declared.solid, declared.owner.tolist(), strict=True)]
        chosen = chosen[~np.array(spare, bool)]
    rows = np.zeros(0, np.int64)
    last = snapshot.level_count.astype(np.int64) - 1 if coarsest else np.zeros(snapshot.n, np.int64)
    level_mesh = snapshot.level_meshes[np.arange(snapshot.n), last]
    if source != "declared":
        usable = np.array([_is_opaque(m) and 0 < m.triangles <= largest for m in snapshot.meshes], bool)
        allowed = usable[level_mesh] & (snapshot.colors[:, 3] >= 1.0) & ~snapshot.unknown
        if source == "auto":
            for first, end in declared.owner[chosen].tolist():
                allowed[first:end] = False
        rows = np.flatnonzero(allowed)
    used, mesh = np.unique(level_mesh[rows], return_inverse=True)
    table = occluder_shapes([snapshot.meshes[i] for i in used.tolist()], declared if len(chosen) else None)
    none = np.full(len(rows), -1)
    fans = np.diff(declared.loop_first) - 2
    faces = np.add.reduceat(fans, declared.face_first[:-1])[chosen] if len(chosen) else np.zeros(0, np.int64)
    return Catalog(
        table,
        np.concatenate([mesh.reshape(-1), len(used) + chosen]),
        np.concatenate([snapshot.transform_index[rows].astype(np.int64), declared.transform_index[chosen]]),
        np.concatenate([rows, np.full(len(chosen), -1)]),
        np.concatenate([none, chosen]),
        np.concatenate([np.zeros((len(rows), 2), np.int64), declared.owner[chosen]]),
        np.concatenate([snapshot.triangles[last[rows], rows].astype(np.int64), faces]),
        coarsest,
        np.zeros((len(rows) + len(chosen), 8), np.float32),
    )


def _is_opaque(mesh: Mesh) -> bool:
    if not mesh.is_finite:
        return False
    if mesh.vertex_colors is not None and mesh.vertex_colors[:, 3].min(initial=255) < 255:
        return False
    return mesh.texture is None or mesh.texture.shape[2] < 4 or bool(mesh.texture[..., 3].min(initial=255) == 255)


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
    alive = _alive(catalog, drawn) & (catalog.triangles <= triangles)
    items = np.flatnonzero(alive)
    items = items[~box_outside(packed.take(items, axis=0), view.planes(snapshot.origin), radius=snapshot.radius)[0]]
    items = items[_faces_eye(frame, catalog, items)]
    boxes = np.ascontiguousarray(packed.take(items, axis=0)[:, :6].T).astype(np.float64)
    offset = np.abs(boxes[:3] - view.relative_eye(snapshot.origin)[:, None])
    gap = np.maximum(offset - boxes[3:], 0.0)
    distance = np.sqrt((gap * gap).sum(axis=0))
    if reach > 0:
        near = distance <= reach
        items, offset, boxes, distance = items[near], offset[:, near], boxes[:, near], distance[near]
    sight = np.abs(view.forward)[:, None] if view.is_parallel else offset
    key = distance if ranking == "distance" else -_apparent_size(sight, boxes[3:], distance, parallel=view.is_parallel)
    order = np.argsort(key, kind="stable")
    if ranking == "visible" and frame.previous is not None and len(frame.previous.visible) == snapshot.n:
        # half of the places go by size in any case: after a turn of the head, what was seen last is far away
        first, rest = order[: active // 2], order[active // 2 :]
        seen = _alive(catalog, frame.previous.visible)[items[rest]]
        order = np.concatenate([first, rest[seen], rest[~seen]])
    items = items[order]
    if catalog.triangles[items[:active]].sum() <= triangles:
        return items[:active]
    # the budget goes to the best: an item that no longer fits is passed over, not the end
    kept: list[int] = []
    for item in items.tolist():
        if catalog.triangles[item] <= triangles and len(kept) < active:
            triangles -= int(catalog.triangles[item])
            kept.append(item)
    return np.array(kept, np.int64)


def _alive(catalog: Catalog, visible: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Items that stand for something visible; a declared occluder without owner always does."""
    alive = visible[catalog.row]
    declared = np.flatnonzero(catalog.row < 0)
    if len(declared):
        before = np.concatenate([[0], np.cumsum(visible)])
        first, end = catalog.owner[declared].T
        alive[declared] = (before[end] > before[first]) | (end <= first)
    return alive


def _faces_eye(frame: Frame, catalog: Catalog, items: I64) -> NDArray[np.bool_]:
    """False for one-sided planar occluders seen from behind."""
    table = frame.snapshot.occluders
    facing = np.ones(len(items), bool)
    declared = catalog.declared[items]
    sided = np.flatnonzero(declared >= 0)
    sided = sided[~(table.solid[declared[sided]] | table.two_sided[declared[sided]])]
    if len(sided):
        chosen = declared[sided]
        normal = table.normals[table.face_first[chosen]]
        point = table.vertices[table.vertex_first[chosen]]
        if frame.view.is_parallel:
            facing[sided] = normal @ frame.view.forward < 0
        else:
            facing[sided] = (normal * (np.asarray(frame.view.eye) - point)).sum(axis=1) > 0
    return facing


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
