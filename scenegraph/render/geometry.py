"""The rows of a snapshot as arrays that a GPU can draw: merged batches of light meshes, instances of heavy ones.

Precision. World coordinates are float64; what is drawn is float32 relative to an origin that is subtracted in float64,
and the origin itself goes into a float64 matrix. Where a scene is so large that float32 would move vertices by more
than `PRECISION` of the size of its drawables, it is divided into cells with an origin each.

Winding. A transform that mirrors reverses the order of a triangle's corners; it is put back here, so that front faces
stay front faces and lighting does not flip.

The item buffer draws the same arrays as the pictures do, so that a pixel belongs to the same row in both.
"""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING

import numpy as np

from .bake import (
    centered,
    determinants,
    normal_matrices,
    quantized,
    ready_parts,
    tinted,
    transformed,
    unit,
    without_lost_corners,
)
from .layout import F64, I64, Batch, Instances, Mask, Material, spread

if TYPE_CHECKING:
    from ..snapshot import Snapshot

#: Meshes from this many triangles on are not merged: one more draw call costs less than a copy of the mesh per row and
#: the copying of its indices (measured by `tests/bench/bench_drawing.py`).
HEAVY_TRIANGLES = 2000
#: Largest rounding of a vertex, relative to the median half diagonal of the drawables: 1/10 pixel where a drawable
#: fills 1000 pixels.
PRECISION = 1e-4
#: A batch uploads all its vertices when one of its rows moves, so batches do not grow without bound.
_BATCH_VERTICES = 1 << 22
_CELLS_AT_MOST = 256
_BAKE_VERTICES = 1 << 20


class Geometry:
    """All rows and levels of a snapshot, laid out for drawing. Drawings and own passes share it: see `shared`.

    Parameters
    ----------
    snapshot : Snapshot
    heavy : int
        Meshes with at least so many triangles become `instances`, the others are merged into `batches`.

    Attributes
    ----------
    batches : list of Batch
        Opaque ones first.
    instances : list of Instances
        Opaque ones first.
    textures : list of (h, w, 3 or 4) uint8
    generation : int
        Counted up by `refresh`; items say in which generation they were written.
    """

    def __init__(self, snapshot: Snapshot, *, heavy: int = HEAVY_TRIANGLES) -> None:
        self.snapshot = snapshot
        self.batches: list[Batch] = []
        self.instances: list[Instances] = []
        self._parts, self.textures = ready_parts(snapshot.meshes)
        self.generation = 0
        self._version = snapshot.version
        self._structure_version = snapshot.structure_version
        self._transforms = snapshot.transforms.copy()
        self._colors = snapshot.colors.copy()
        self._placeless = np.zeros(len(self._transforms), bool)
        self._build(heavy)

    @property
    def nbytes(self) -> int:
        """Bytes held by the arrays, textures included."""
        parts = sum(b.nbytes for b in self.batches) + sum(i.nbytes for i in self.instances)
        return parts + sum(t.nbytes for t in self.textures)

    @classmethod
    def shared(cls, snapshot: Snapshot, *, heavy: int = HEAVY_TRIANGLES) -> Geometry:
        """The geometry of a snapshot as it is now; the same object for all who hold one."""
        known: weakref.WeakValueDictionary[int, Geometry]
        known = snapshot.prepared("scenegraph.render.geometry", lambda _: weakref.WeakValueDictionary())
        found = known.get(heavy)
        if found is None or not found.refresh():
            found = known[heavy] = cls(snapshot, heavy=heavy)
        return found

    # -- building -------------------------------------------------------------------------------------------------

    def _build(self, heavy: int) -> None:
        snapshot = self.snapshot
        row, level = np.nonzero(snapshot.level_meshes >= 0)
        mesh = snapshot.level_meshes[row, level].astype(np.int64)
        triangles = np.array([len(p.faces) for p in self._parts], np.int64)
        codes = np.array([(p.texture + 1) * 4 + (p.normals is not None) * 2 for p in self._parts], np.int64)
        clear = np.array([p.translucent for p in self._parts], bool)
        some = triangles[mesh] > 0 if len(mesh) else np.zeros(0, bool)
        row, level, mesh = row[some], level[some], mesh[some]
        if not len(row):
            return
        code = codes[mesh] + (clear[mesh] | (snapshot.colors[row, 3] < 1))
        big = triangles[mesh] >= heavy
        self._build_instances(row[big], level[big], mesh[big], code[big])
        self._build_batches(row[~big], level[~big], mesh[~big], code[~big])

    def _build_batches(self, row: I64, level: I64, mesh: I64, code: I64) -> None:
        if not len(row):
            return
        cell, origins = cells(self.snapshot.boxes[:, row], np.asarray(self.snapshot.origin, np.float64))
        order = np.lexsort((level, row, cell, code, code & 1))
        row, level, mesh, code, cell = row[order], level[order], mesh[order], code[order], cell[order]
        counts = np.array([len(p.vertices) for p in self._parts], np.int64)[mesh]
        chunk = (np.cumsum(counts) - counts) // _BATCH_VERTICES
        key = np.stack([code, cell, chunk])
        starts = np.flatnonzero(np.concatenate([[True], (key[:, 1:] != key[:, :-1]).any(axis=0)]))
        for start, end in zip(starts, [*starts[1:], len(row)], strict=True):
            items = slice(int(start), int(end))
            self.batches.append(
                self._merge(material_of(int(code[start])), origins[cell[start]], row[items], level[items], mesh[items])
            )

    def _merge(self, material: Material, origin: F64, row: I64, level: I64, mesh: I64) -> Batch:
        parts = [self._parts[m] for m in mesh.tolist()]
        first_vertex = np.concatenate([[0], np.cumsum([len(p.vertices) for p in parts], dtype=np.int64)])
        first_triangle = np.concatenate([[0], np.cumsum([len(p.faces) for p in parts], dtype=np.int64)])
        total = int(first_vertex[-1])
        batch = Batch(
            material,
            origin,
            row.astype(np.int32),
            level.astype(np.uint8),
            mesh.astype(np.int32),
            first_vertex,
            first_triangle,
            vertices=np.empty((total, 3), np.float32),
            colors=np.empty((total, 4), np.uint8),
            normals=np.empty((total, 3), np.float32) if material.smooth else None,
            uv=np.concatenate([p.uv for p in parts if p.uv is not None]) if material.texture >= 0 else None,
            faces=np.empty((int(first_triangle[-1]), 3), np.int32),
            changed_at=np.zeros(len(row), np.int64),
        )
        self._fill(batch, np.arange(len(row)))
        return batch

    def _fill(self, batch: Batch, items: I64) -> None:
        """Write vertices, normals, colors and faces of some items of a batch, in pieces that bound the memory."""
        counts = np.diff(batch.first_vertex)[items]
        piece = (np.cumsum(counts) - counts) // _BAKE_VERTICES
        for some in np.split(items, np.flatnonzero(np.diff(piece)) + 1):
            self._fill_piece(batch, some)

    def _fill_piece(self, batch: Batch, items: I64) -> None:
        parts = [self._parts[m] for m in batch.meshes[items].tolist()]
        rows = batch.rows[items]
        first, counts = batch.first_vertex[items], np.diff(batch.first_vertex)[items]
        target = spread(first, counts)
        world = self.snapshot.transforms[self.snapshot.transform_index[rows]]
        linear = world[:, :3, :3]
        with np.errstate(invalid="ignore", over="ignore"):
            local = np.concatenate([p.vertices for p in parts])
            moved = transformed(linear, local, counts) + np.repeat(world[:, :3, 3] - batch.origin, counts, axis=0)
            if batch.normals is not None:
                normals = np.concatenate([p.normals for p in parts if p.normals is not None])
                batch.normals[target] = unit(transformed(normal_matrices(linear), normals, counts))
        batch.colors[target] = tinted(self.snapshot.colors[rows], [p.colors for p in parts], counts)
        triangle_counts = np.diff(batch.first_triangle)[items]
        starts = np.cumsum(counts) - counts
        faces = np.concatenate([p.faces for p in parts]) + np.repeat(starts, triangle_counts).astype(np.int32)[:, None]
        mirrored = np.repeat(determinants(linear) < 0, triangle_counts)
        faces[mirrored] = faces[mirrored][:, ::-1]
        batch.vertices[target], faces = without_lost_corners(moved, faces)
        shift = np.repeat(first - starts, triangle_counts).astype(np.int32)
        batch.faces[spread(batch.first_triangle[items], triangle_counts)] = faces + shift[:, None]

    def _build_instances(self, row: I64, level: I64, mesh: I64, code: I64) -> None:
        if not len(row):
            return
        world = self.snapshot.transforms[self.snapshot.transform_index[row]]
        known = np.isfinite(world).all(axis=(1, 2))
        self._placeless[self.snapshot.transform_index[row[~known]]] = True
        colors = quantized(self.snapshot.colors[row])
        # a mesh with colors of its own is tinted as a whole, so only rows of one color can share it
        own = np.array([p.colors is not None for p in self._parts])[mesh]
        tint = np.where(own, colors.view(np.uint32).reshape(-1).astype(np.int64), -1)
        keys = np.stack([code & 1, mesh, code, determinants(world[:, :3, :3]) < 0, tint], axis=1)
        unique, member = np.unique(keys, axis=0, return_inverse=True)
        for group, (_, number, material, mirrored, _) in enumerate(unique.tolist()):
            items = np.flatnonzero((member.reshape(-1) == group) & known)
            if not len(items):
                continue
            part = self._parts[number]
            center = part.vertices.min(axis=0) / 2 + part.vertices.max(axis=0) / 2
            vertex_colors = None
            if part.colors is not None:
                row_color = self.snapshot.colors[row[items[:1]]]
                vertex_colors = tinted(row_color, [part.colors], np.array([len(part.colors)]))
            self.instances.append(
                Instances(
                    material_of(material),
                    row[items].astype(np.int32),
                    level[items].astype(np.uint8),
                    vertices=(part.vertices - center).astype(np.float32),
                    faces=np.ascontiguousarray(part.faces[:, ::-1]) if mirrored else part.faces,
                    normals=part.normals,
                    uv=part.uv,
                    vertex_colors=vertex_colors,
                    center=center,
                    matrices=centered(world[items], center),
                    colors=colors[items],
                    changed_at=np.zeros(len(items), np.int64),
                )
            )

    # -- following edits ------------------------------------------------------------------------------------------

    def refresh(self) -> bool:
        """Follow the snapshot after its `sync()`: rewrite what moved or changed its color, and nothing else.

        Returns
        -------
        bool
            False if the geometry has to be built anew: rows came or went, turned translucent or opaque, or a heavy mesh
            became its mirror image or lost its finite place.
        """
        snapshot = self.snapshot
        if self._structure_version != snapshot.structure_version or len(snapshot.transforms) != len(self._transforms):
            return False
        if self._version == snapshot.version:
            return True
        now, before = snapshot.transforms, self._transforms
        moved = (now.view(np.int64) != before.view(np.int64)).any(axis=(1, 2))
        colored = (snapshot.colors != self._colors).any(axis=1)
        if ((snapshot.colors[:, 3] < 1) != (self._colors[:, 3] < 1)).any():
            return False
        changed = moved[snapshot.transform_index] | colored
        if (moved & self._placeless).any() or any(self._needs_rebuild(e, moved, colored) for e in self.instances):
            return False
        self._transforms, self._colors, self._version = now.copy(), snapshot.colors.copy(), snapshot.version
        self.generation += 1
        for batch in self.batches:
            items = np.flatnonzero(changed[batch.rows])
            if len(items):
                self._fill(batch, items)
                batch.changed_at[items] = self.generation
        for entry in self.instances:
            items = np.flatnonzero(changed[entry.rows])
            rows = entry.rows[items]
            entry.matrices[items] = centered(now[snapshot.transform_index[rows]], entry.center)
            entry.colors[items] = quantized(snapshot.colors[rows])
            entry.changed_at[items] = self.generation
        return True

    def _needs_rebuild(self, entry: Instances, moved: Mask, colored: Mask) -> bool:
        if entry.vertex_colors is not None and bool(colored[entry.rows].any()):
            return True
        index = self.snapshot.transform_index[entry.rows]
        index = index[moved[index]]
        now = determinants(self.snapshot.transforms[index][:, :3, :3])
        before = determinants(self._transforms[index][:, :3, :3])
        return not np.isfinite(now).all() or bool(((now < 0) != (before < 0)).any())


def material_of(code: int) -> Material:
    """The material of a code: translucent + 2 · smooth + 4 · (texture + 1)."""
    return Material(texture=code // 4 - 1, smooth=bool(code & 2), translucent=bool(code & 1))


def cells(boxes: F64, center: F64) -> tuple[I64, F64]:
    """Cell of each item and the origin of each cell; one cell unless float32 would be too coarse.

    Parameters
    ----------
    boxes : (6, k) float64
        World boxes of the items.
    center : (3,) float64
        The origin, as long as one is enough.
    """
    cell = np.zeros(boxes.shape[1], np.int64)
    known = np.flatnonzero(np.isfinite(boxes).all(axis=0))
    if not len(known):
        return cell, center[None]
    middle, half = boxes[:3, known] - center[:, None], boxes[3:, known]
    reach = float((np.abs(middle) + half).max())
    allowed = float(np.median(np.linalg.norm(half, axis=0))) * PRECISION * 2.0**24
    if not reach > allowed > 0:
        return cell, center[None]
    # powers of two above the allowed width until few enough cells are taken
    width = max(2 * allowed, reach * 2.0**-40)
    while True:
        place, member = np.unique(np.floor(middle / width), axis=1, return_inverse=True)
        if place.shape[1] <= _CELLS_AT_MOST:
            break
        width *= 2
    cell[known] = member.reshape(-1)
    return cell, np.asarray(center + (place.T + 0.5) * width)
