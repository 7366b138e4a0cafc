"""Tables of stand-in meshes: laid out and loaded once, of which every frame draws a few.

A table of a thousand meshes costs as many actors as it has materials: choosing others exchanges an index array, as for
rows. Pictures and own passes draw the same arrays.
"""

from __future__ import annotations

import weakref
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kernels.boxes import box_from_bounds
from .actors import BatchActor, Materials, actor_of, matrix_of
from .bake import ready_parts, tinted, without_lost_corners
from .buffers import packed
from .geometry import cells, material_of
from .layout import F64, I64, Batch, Mask

if TYPE_CHECKING:
    import moderngl

    from ..frame import StandIn
    from ..mesh import MeshTable
    from ..view import View

#: Where each table was laid out, as long as somebody holds that.
_LAID_OUT: weakref.WeakValueDictionary[int, TableGeometry] = weakref.WeakValueDictionary()


class TableGeometry:
    """The meshes of a table as batches; the "rows" of a batch are the numbers of its meshes.

    Parameters
    ----------
    table : MeshTable

    Attributes
    ----------
    batches : list of Batch
        Opaque ones first.
    textures : list of (h, w, 3 or 4) uint8
    """

    def __init__(self, table: MeshTable) -> None:
        self.table = table
        parts, self.textures = ready_parts(table.meshes)
        self._parts = parts
        self.batches: list[Batch] = []
        number: I64 = np.flatnonzero([len(p.faces) > 0 for p in parts])
        if not len(number):
            return
        colors = [m.color if m.color is not None else (1.0, 1.0, 1.0, 1.0) for m in table.meshes]
        self._colors = np.array(colors, np.float32)
        clear = np.array([p.translucent for p in parts]) | (self._colors[:, 3] < 1)
        code = np.array([(p.texture + 1) * 4 + (p.normals is not None) * 2 for p in parts], np.int64) + clear
        low, high = np.array([m.bounds for m in table.meshes]).transpose(1, 2, 0)
        boxes = box_from_bounds(low, high)
        known = np.isfinite(boxes).all(axis=0)
        center = low[:, known].min(axis=1) / 2 + high[:, known].max(axis=1) / 2 if known.any() else np.zeros(3)
        cell, origins = cells(boxes[:, number], center)
        key = np.stack([cell, code[number]])
        order = np.lexsort((number, *key))
        number, key = number[order], key[:, order]
        starts = np.flatnonzero(np.concatenate([[True], (key[:, 1:] != key[:, :-1]).any(axis=0)]))
        for start, end in zip(starts.tolist(), [*starts[1:].tolist(), len(number)], strict=True):
            self.batches.append(self._merged(number[start:end], int(key[1, start]), origins[int(key[0, start])]))
        self.batches.sort(key=lambda b: b.material.translucent)

    def _merged(self, number: I64, code: int, origin: F64) -> Batch:
        parts = [self._parts[i] for i in number.tolist()]
        counts = np.array([len(p.vertices) for p in parts], np.int64)
        first_vertex = np.concatenate([[0], np.cumsum(counts)])
        triangles = np.array([len(p.faces) for p in parts], np.int64)
        faces = (
            np.concatenate([p.faces for p in parts]) + np.repeat(first_vertex[:-1], triangles).astype(np.int32)[:, None]
        )
        vertices, faces = without_lost_corners(np.concatenate([p.vertices for p in parts]) - origin, faces)
        material = material_of(code)
        return Batch(
            material,
            origin,
            number.astype(np.int32),
            np.zeros(len(number), np.uint8),
            number.astype(np.int32),
            first_vertex,
            np.concatenate([[0], np.cumsum(triangles)]),
            vertices=vertices,
            colors=tinted(self._colors[number], [p.colors for p in parts], counts),
            normals=np.concatenate([p.normals for p in parts if p.normals is not None]) if material.smooth else None,
            uv=np.concatenate([p.uv for p in parts if p.uv is not None]) if material.texture >= 0 else None,
            faces=np.ascontiguousarray(faces),
            changed_at=np.zeros(len(number), np.int64),
        )

    @classmethod
    def shared(cls, table: MeshTable) -> TableGeometry:
        """The layout of a table; the same object for all who hold one."""
        found = _LAID_OUT.get(id(table))
        if found is None:
            # it holds its table, so that the number names no other as long as it lives
            found = _LAID_OUT[id(table)] = cls(table)
        return found

    def chosen(self, numbers: I64) -> Mask:
        """(m,) which meshes of the table are drawn."""
        mask = np.zeros(len(self.table), bool)
        mask[numbers] = True
        return mask


class TableActors:
    """The stand-ins from one table in a renderer."""

    def __init__(self, geometry: TableGeometry, renderer: Any) -> None:
        self.geometry = geometry
        self._renderer = renderer
        self._materials = Materials(geometry.textures)
        self._casts: list[_Cast] = []

    @property
    def actor_count(self) -> int:
        """Number of actors in the renderer."""
        return sum(len(b.actors) for cast in self._casts for b in cast.batches)

    def show(self, standins: Sequence[StandIn]) -> None:
        """Draw these, all from this table, and no others."""
        groups: dict[bytes, list[StandIn]] = {}
        for standin in standins:
            groups.setdefault(standin.chosen.tobytes(), []).append(standin)
        while len(self._casts) < len(groups):
            self._casts.append(_Cast(self.geometry, self._materials, self._renderer))
        for cast, group in zip(self._casts, groups.values(), strict=False):
            cast.show(self.geometry.chosen(group[0].chosen), [s.matrix for s in group])
        for cast in self._casts[len(groups) :]:
            cast.show(None, [])

    def remove(self) -> None:
        """Take everything out of the renderer."""
        for cast in self._casts:
            for batch in cast.batches:
                for actor in batch.actors:
                    self._renderer.RemoveActor(actor)
        self._casts = []


class _Cast:
    """One choice of meshes, at any number of places."""

    def __init__(self, geometry: TableGeometry, materials: Materials, renderer: Any) -> None:
        self._materials, self._renderer = materials, renderer
        self.batches = [BatchActor(batch, materials) for batch in geometry.batches]
        for batch in self.batches:
            renderer.AddActor(batch.actors[0])

    def show(self, chosen: Mask | None, matrices: list[F64]) -> None:
        for batch in self.batches:
            picked = np.zeros(len(batch.batch.rows), bool) if chosen is None else chosen[batch.batch.rows]
            any_picked = bool(picked.any())
            if any_picked:
                batch.show(picked)
            while len(batch.actors) < len(matrices):
                actor = actor_of(batch.surface, matrix_of(np.eye(4)))
                self._materials.dress(actor, batch.batch.material)
                self._renderer.AddActor(actor)
                batch.actors.append(actor)
            for index, actor in enumerate(batch.actors):
                actor.SetVisibility(any_picked and index < len(matrices))
                if index < len(matrices):
                    actor.SetUserMatrix(matrix_of(_placed(matrices[index], batch.batch.origin)))


class TableBuffers:
    """The meshes of a table in OpenGL buffers, for own passes; inside `guard`.

    Parameters
    ----------
    gl : moderngl.Context
    geometry : TableGeometry
    """

    def __init__(self, gl: moderngl.Context, geometry: TableGeometry) -> None:
        self.geometry = geometry
        self._parts = [_PartBuffers(gl, b, len(geometry.table)) for b in geometry.batches if not b.material.translucent]

    def draw(self, program: moderngl.Program, view: View, chosen: I64, matrix: F64 | None = None) -> None:
        """Draw opaque meshes into the frame buffer in use, in the order in which they are given.

        Parameters
        ----------
        program : moderngl.Program
            With the input `position`, and `matrix` for each instance.
        view : View
        chosen : (j,) int64
            Numbers of meshes.
        matrix : (4, 4) float64, optional
            Of the stand-in.
        """
        for part in self._parts:
            part.draw(program, view, chosen, np.eye(4) if matrix is None else matrix)

    def reach(self, view: View) -> float:
        """World units: largest magnitude of the numbers that are added up to place a vertex in eye space."""
        return max((part.reach(view) for part in self._parts), default=0.0)

    def release(self) -> None:
        """Free the buffers."""
        for part in self._parts:
            part.release()
        self._parts = []


class _PartBuffers:
    def __init__(self, gl: moderngl.Context, batch: Batch, meshes: int) -> None:
        self.gl = gl
        self.batch = batch
        self.item = np.full(meshes, -1, np.int64)
        self.item[batch.rows] = np.arange(len(batch.rows))
        self.vertices = gl.buffer(np.ascontiguousarray(batch.vertices))
        self.indices = gl.buffer(np.ascontiguousarray(batch.faces))
        self.matrix = gl.buffer(reserve=64, dynamic=True)
        self.commands: Any = None
        self._arrays: dict[int, Any] = {}
        self._matrix = np.eye(4)
        self._extent = float(np.abs(batch.vertices).max(axis=0, initial=0.0).sum())

    def reach(self, view: View) -> float:
        """As drawn last; see `TableBuffers.reach`."""
        place = _placed(self._matrix, self.batch.origin)
        stretch = float(np.linalg.norm(place[:3, :3]))
        return stretch * self._extent + float(np.linalg.norm(place[:3, 3] - np.asarray(view.eye)))

    def draw(self, program: moderngl.Program, view: View, chosen: I64, matrix: F64) -> None:
        items = self.item[chosen]
        items = items[items >= 0]
        if not len(items):
            return
        if program.glo not in self._arrays:
            content = [(self.vertices, "3f4", "position"), (self.matrix, "16f4/i", "matrix")]
            self._arrays[program.glo] = self.gl.vertex_array(
                program, content, index_buffer=self.indices, index_element_size=4, skip_errors=True
            )
        array = self._arrays[program.glo]
        self._matrix = matrix
        # the eye is subtracted from the place in float64, before anything is rounded
        place = _placed(matrix, self.batch.origin)
        place[:3, 3] -= np.asarray(view.eye)
        self.matrix.write(packed((view.projection() @ view.view_matrix(view.eye) @ place)[None]))
        first = 3 * self.batch.first_triangle[items]
        counts = 3 * self.batch.first_triangle[items + 1] - first
        if self.gl.version_code < 430 or len(items) < _FEW_DRAWS:
            for start, count in zip(first.tolist(), counts.tolist(), strict=True):
                array.render(vertices=count, first=start, instances=1)
            return
        commands = np.zeros((len(items), 5), np.uint32)
        commands[:, 0], commands[:, 1], commands[:, 2] = counts, 1, first
        if self.commands is None:
            self.commands = self.gl.buffer(reserve=20 * len(self.batch.rows), dynamic=True)
        self.commands.write(commands)
        array.render_indirect(self.commands, count=len(items))

    def release(self) -> None:
        for resource in (*self._arrays.values(), self.vertices, self.indices, self.matrix, self.commands):
            if resource is not None:
                resource.release()
        self._arrays = {}


#: Fewer meshes are drawn by a call each.
_FEW_DRAWS = 3


def _placed(matrix: F64, origin: F64) -> F64:
    """(4, 4) world matrix for coordinates relative to `origin`."""
    placed = np.array(matrix, np.float64)
    placed[:3, 3] += placed[:3, :3] @ origin
    return placed
