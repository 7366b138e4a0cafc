"""The catalog of what may be drawn as an occluder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scenegraph import Mesh, OccluderTable, Snapshot, View
from scenegraph.kernels.boxes import box_from_bounds, box_packed
from scenegraph.meshes import inner_shell

from .shapes import F64, I64, ShapeTable, occluder_shapes

Source = Literal["auto", "declared", "meshes"]
Mask = NDArray[np.bool_]

#: A drawable of no more triangles is drawn itself, rather than what was fitted into it.
FEW_TRIANGLES = 100

#: Inner shells take seconds each when they are first made: only the most frequent meshes get one.
SHELLS = 64


@dataclass
class Catalog:
    """Everything in a snapshot that may be drawn as an occluder: opaque drawables, and declared occluders.

    Attributes
    ----------
    table : ShapeTable
    occluders : OccluderTable
        The snapshot's, as it was when the catalog was made.
    mesh : (i,) int64
        Which of the table's meshes each item is.
    transform : (i,) int64
        Index into the snapshot's transforms.
    row : (i,) int64
        The drawable, or -1 for a declared occluder.
    declared : (i,) int64
        Index into `occluders`, or -1.
    owner : (i, 2) int64
        First and end row that the item may never hide; empty for a drawable, which is what one sees.
    triangles : (i,) int64
    coarsest : bool
        Drawables are drawn at their coarsest level instead of their finest.
    shell : (i,) bool
        Not the drawable itself is drawn, but a shell that is proved to lie inside it, for eyes outside.
    """

    table: ShapeTable
    occluders: OccluderTable
    mesh: I64
    transform: I64
    row: I64
    declared: I64
    owner: I64
    triangles: I64
    coarsest: bool
    shell: Mask
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
                boxes = _boxes(self.occluders)[:, self.declared[~drawables]]
                self._packed[~drawables] = box_packed(boxes, snapshot.origin)
        return self._packed

    def standing_for(self, visible: Mask) -> Mask:
        """(i,) items that stand for something in a (n,) set of rows; a declared occluder without owner always does."""
        out = visible[self.row]
        declared = np.flatnonzero(self.row < 0)
        if len(declared):
            before = np.concatenate([[0], np.cumsum(visible)])
            first, end = self.owner[declared].T
            out[declared] = (before[end] > before[first]) | (end <= first)
        return out

    def usable(self, view: View, snapshot: Snapshot) -> Mask | None:
        """(i,) items that hold for a view, or None if all do: where an occluder does not, its drawable steps in."""
        declared = np.flatnonzero(self.row < 0)
        if not len(declared):
            return None if not self.shell.any() else self._seen_from_outside(view, snapshot)
        holds = self.occluders.holds_for(view, snapshot.boxes) & self._facing(view)
        conditional = self.occluders.outside_only[self.declared[declared]]
        out = self._seen_from_outside(view, snapshot)
        out[declared] = holds[self.declared[declared]]
        if conditional.any():
            first, end = self.owner[declared[conditional & out[declared]]].T
            step = np.zeros(snapshot.n + 1, np.int64)
            np.add.at(step, first, 1)
            np.add.at(step, end, -1)
            drawables = self.row >= 0
            out[drawables] &= np.cumsum(step)[self.row[drawables]] == 0
        return out

    def _seen_from_outside(self, view: View, snapshot: Snapshot) -> Mask:
        """(i,) False for shells of drawables whose box the near plane's corners or the eye may reach into."""
        out = np.ones(len(self), bool)
        inner = np.flatnonzero(self.shell)
        if len(inner):
            corners = view.corners(far=view.near)
            low = np.minimum(corners.min(axis=0), view.eye if not view.is_parallel else corners.min(axis=0))
            high = np.maximum(corners.max(axis=0), view.eye if not view.is_parallel else corners.max(axis=0))
            boxes = snapshot.boxes[:, self.row[inner]]
            apart = (boxes[:3] - boxes[3:] > high[:, None]) | (boxes[:3] + boxes[3:] < low[:, None])
            out[inner] = apart.any(axis=0)
        return out

    def _facing(self, view: View) -> Mask:
        """(o,) False for one-sided planar occluders seen from behind."""
        table = self.occluders
        facing = np.ones(len(table), bool)
        sided = np.flatnonzero(~(table.solid | table.two_sided))
        if len(sided):
            normal = table.normals[table.face_first[sided]]
            point = table.vertices[table.vertex_first[sided]]
            if view.is_parallel:
                facing[sided] = normal @ view.forward < 0
            else:
                facing[sided] = (normal * (np.asarray(view.eye) - point)).sum(axis=1) > 0
        return facing


def _boxes(table: OccluderTable) -> F64:
    low = np.minimum.reduceat(table.vertices, table.vertex_first[:-1]).T
    high = np.maximum.reduceat(table.vertices, table.vertex_first[:-1]).T
    return box_from_bounds(low, high)


def make_catalog(
    snapshot: Snapshot,
    *,
    source: Source,
    largest: int,
    coarsest: bool,
    inner: bool = False,
    progress: Callable[[str, float], None] | None = None,
) -> Catalog:
    """What may be drawn.

    Parameters
    ----------
    snapshot : Snapshot
    source : str
        "declared": declared occluders only; "meshes": drawables only; "auto": declared occluders, and drawables that
        none of them stands for. A planar occluder is left out where a solid stands for the same rows, and one that was
        fitted into a drawable where the drawable itself has few triangles.
    largest : int
        Drawables of more triangles are left out.
    coarsest : bool
        Draw the coarsest level of drawables instead of the finest.
    inner : bool
        Draw shells made of coarsest levels and proved to lie inside, where the finest has more than a few triangles.
    progress : callable, optional
    """
    table = snapshot.occluders
    last = snapshot.level_count.astype(np.int64) - 1 if coarsest else np.zeros(snapshot.n, np.int64)
    level_mesh = snapshot.level_meshes[np.arange(snapshot.n), last]
    opaque = np.array([_is_opaque(m) for m in snapshot.meshes], bool)
    count = np.array([m.triangles for m in snapshot.meshes], np.int64)
    allowed = opaque[level_mesh] & (snapshot.colors[:, 3] >= 1.0) & ~snapshot.unknown
    shells: list[Mesh] = []
    shell_of = np.full(snapshot.n, -1)
    if inner and not coarsest and source != "declared":
        shells, shell_of = _inner_shells(snapshot, allowed, largest, progress)
    allowed &= (shell_of >= 0) | ((count[level_mesh] > 0) & (count[level_mesh] <= largest))
    chosen = np.arange(len(table) if source != "meshes" else 0)
    if source == "declared":
        allowed[:] = False
    elif source == "auto" and len(table):
        chosen = chosen[~_spare(table, allowed & (count[level_mesh] <= FEW_TRIANGLES))]
        for first, end in table.owner[chosen[~table.outside_only[chosen]]].tolist():
            allowed[first:end] = False
    rows = np.flatnonzero(allowed)
    drawn = np.where(shell_of >= 0, len(snapshot.meshes) + shell_of, level_mesh)[rows]
    meshes = [*snapshot.meshes, *shells]
    used, mesh = np.unique(drawn, return_inverse=True)
    shapes = occluder_shapes([meshes[i] for i in used.tolist()], table if len(chosen) else None)
    none = np.full(len(rows), -1)
    fans = np.diff(table.loop_first) - 2
    faces = np.add.reduceat(fans, table.face_first[:-1])[chosen] if len(chosen) else np.zeros(0, np.int64)
    return Catalog(
        shapes,
        table,
        np.concatenate([mesh.reshape(-1), len(used) + chosen]),
        np.concatenate([snapshot.transform_index[rows].astype(np.int64), table.transform_index[chosen]]),
        np.concatenate([rows, np.full(len(chosen), -1)]),
        np.concatenate([none, chosen]),
        np.concatenate([np.zeros((len(rows), 2), np.int64), table.owner[chosen]]),
        np.concatenate([np.array([m.triangles for m in meshes], np.int64)[drawn], faces]),
        coarsest,
        np.concatenate([shell_of[rows] >= 0, np.zeros(len(chosen), bool)]),
        np.zeros((len(rows) + len(chosen), 8), np.float32),
    )


def _inner_shells(
    snapshot: Snapshot, allowed: Mask, largest: int, progress: Callable[[str, float], None] | None
) -> tuple[list[Mesh], NDArray[np.int64]]:
    """Shells of the most frequent pairs of finest and coarsest level, and (n,) the shell of each row, or -1."""
    finest = snapshot.level_meshes[:, 0].astype(np.int64)
    coarse = snapshot.level_meshes[np.arange(snapshot.n), snapshot.level_count.astype(np.int64) - 1].astype(np.int64)
    triangles = np.array([m.triangles for m in snapshot.meshes] + [0], np.int64)
    worth = allowed & (triangles[finest] > FEW_TRIANGLES) & (2 * triangles[coarse] <= triangles[finest])
    worth &= triangles[coarse] <= largest
    rows = np.flatnonzero(worth)
    pairs, of, uses = np.unique(
        np.column_stack([finest[rows], coarse[rows]]), axis=0, return_inverse=True, return_counts=True
    )
    shells: list[Mesh] = []
    number = np.full(len(pairs), -1)
    asked = np.argsort(-uses, kind="stable")[:SHELLS]
    for done, pair in enumerate(asked.tolist()):
        if progress is not None:
            progress("fitting inner shells", done / len(asked))
        a, b = pairs[pair].tolist()
        shell = inner_shell(snapshot.meshes[a], snapshot.meshes[b])
        if shell is not None:
            number[pair] = len(shells)
            shells.append(shell)
    shell_of = np.full(snapshot.n, -1)
    shell_of[rows] = number[of.reshape(-1)]
    return shells, shell_of


def _spare(table: OccluderTable, cheap: Mask) -> Mask:
    """(o,) occluders that something else stands in for; `cheap` (n,) are the drawables that are drawn in any case."""
    owners = list(map(tuple, table.owner.tolist()))
    solids = {o for o, solid in zip(owners, table.solid.tolist(), strict=True) if solid and o[1] > o[0]}
    before = np.concatenate([[0], np.cumsum(~cheap)])
    first, end = table.owner.T
    all_cheap = (end > first) & (before[end] == before[first])
    doubled = np.array([o in solids for o in owners], bool) & ~table.solid
    return np.asarray(np.where(table.outside_only, all_cheap, doubled))


def _is_opaque(mesh: Mesh) -> bool:
    if not mesh.is_finite:
        return False
    if mesh.vertex_colors is not None and mesh.vertex_colors[:, 3].min(initial=255) < 255:
        return False
    return mesh.texture is None or mesh.texture.shape[2] < 4 or bool(mesh.texture[..., 3].min(initial=255) == 255)
