"""The rows of a snapshot in OpenGL buffers, for own passes: ids, depth, queries.

Uploaded once and reused by every pass. The arrays and matrices are those that VTK gets, so an own pass covers the same
pixels as the picture does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .layout import F64, I32, I64, U8, Batch, Instances, Mask, spread

if TYPE_CHECKING:
    import moderngl

    from ..view import View
    from .geometry import Geometry

#: Vertex shader of all passes; a pass may use another one with the same inputs.
VERTEX_SHADER = """
#version 330 core
in vec3 position;
in uint row;
in mat4 matrix;
flat out uint drawn_row;
void main() {
    drawn_row = row;
    gl_Position = matrix * vec4(position, 1.0);
}
"""


class RowBuffers:
    """Vertex buffers of all rows. Every method must be called inside `guard` of the window that owns the context.

    Parameters
    ----------
    gl : moderngl.Context
    geometry : Geometry
    """

    def __init__(self, gl: moderngl.Context, geometry: Geometry) -> None:
        self.geometry = geometry
        self._generation = geometry.generation
        self._parts: list[_BatchBuffers | _InstanceBuffers] = [_BatchBuffers(gl, b) for b in geometry.batches]
        self._parts += [_InstanceBuffers(gl, i) for i in geometry.instances]
        self._places: tuple[I32, I32] | None = None

    def draw(
        self,
        program: moderngl.Program,
        view: View,
        *,
        visible: Mask | I64 | None = None,
        level: U8 | None = None,
        translucent: bool = False,
    ) -> None:
        """Draw rows into the frame buffer in use.

        Parameters
        ----------
        program : moderngl.Program
            With the inputs of `VERTEX_SHADER`, or some of them.
        view : View
        visible : (n,) bool or (k,) indices, optional
            All rows by default. Indices cost as much as there are of them, however many rows there are.
        level : (n,) uint8, optional
            The finest level by default.
        translucent : bool
            Draw the translucent rows instead of the opaque ones.
        """
        if visible is not None and visible.dtype != np.bool_:
            self._draw_few(program, view, visible.astype(np.int64), level, translucent=translucent)
            return
        seen, levels = self._defaults(None if visible is None else visible.astype(bool, copy=False), level)
        for part in self._parts:
            if part.source.material.translucent == translucent:
                part.draw(program, view, part.source.chosen(seen, levels))

    def _draw_few(
        self, program: moderngl.Program, view: View, rows: I64, level: U8 | None, *, translucent: bool
    ) -> None:
        if self._places is None:
            self._places = self._find_places()
        parts, items = self._places
        wanted = np.zeros(len(rows), np.uint8) if level is None else level[rows]
        # a row without this level, or without anything to draw, is in no part
        inside = wanted < len(parts)
        rows, wanted = rows[inside], wanted[inside]
        part, item = parts[wanted, rows], items[wanted, rows]
        order = np.lexsort((item, part))
        part, item = part[order], item[order]
        for number in np.unique(part).tolist():
            first, end = np.searchsorted(part, (number, number + 1))
            if number >= 0 and self._parts[number].source.material.translucent == translucent:
                self._parts[number].draw_items(program, view, item[first:end])

    def _find_places(self) -> tuple[I32, I32]:
        """(levels, n) part that each level of each row is in, -1 for none, and which item of the part it is."""
        shape = self.geometry.snapshot.level_meshes.T.shape
        parts, items = np.full(shape, -1, np.int32), np.zeros(shape, np.int32)
        for number, part in enumerate(self._parts):
            at = part.source.levels, part.source.rows
            parts[at], items[at] = number, np.arange(len(part.source.rows))
        return parts, items

    def each_translucent(self, program: moderngl.Program, view: View) -> Iterator[tuple[int, Callable[[], None]]]:
        """Translucent rows one by one: the row, and what draws it."""
        seen, levels = self._defaults(None, None)
        for part in self._parts:
            if part.source.material.translucent:
                for item in np.flatnonzero(part.source.chosen(seen, levels)).tolist():
                    only = np.zeros(len(part.source.rows), bool)
                    only[item] = True

                    def draw(part: Any = part, only: Mask = only) -> None:
                        part.draw(program, view, only)

                    yield int(part.source.rows[item]), draw

    def _defaults(self, visible: Mask | None, level: U8 | None) -> tuple[Mask, U8]:
        n = self.geometry.snapshot.n
        return np.ones(n, bool) if visible is None else visible, np.zeros(n, np.uint8) if level is None else level

    def reach(self, view: View) -> float:
        """World units: largest magnitude of the numbers that are added up to place a merged vertex in eye space.

        Instances are placed relative to the eye, so that theirs is no more than their distance.
        """
        batches = [part for part in self._parts if isinstance(part, _BatchBuffers)]
        return max(
            (part.extent + float(np.linalg.norm(view.relative_eye(part.source.origin))) for part in batches),
            default=0.0,
        )

    def sync(self) -> None:
        """Upload what the geometry has rewritten."""
        if self._generation == self.geometry.generation:
            return
        for part in self._parts:
            if (part.source.changed_at > self._generation).any():
                part.upload()
        self._generation = self.geometry.generation

    def release(self) -> None:
        """Free the buffers."""
        for part in self._parts:
            part.release()
        self._parts = []


class _Buffers:
    """Vertex arrays by program, and what they are made of."""

    def __init__(self, gl: moderngl.Context) -> None:
        self.gl = gl
        self._arrays: dict[tuple[int, int], Any] = {}

    def array(self, program: moderngl.Program, content: list[tuple[Any, ...]], index: Any) -> Any:
        key = program.glo, index.glo
        if key not in self._arrays:
            # inputs that the compiler has removed are skipped
            made = self.gl.vertex_array(program, content, index_buffer=index, index_element_size=4, skip_errors=True)
            self._arrays[key] = made
        return self._arrays[key]

    def release_arrays(self) -> None:
        for array in self._arrays.values():
            array.release()
        self._arrays.clear()


class _BatchBuffers(_Buffers):
    def __init__(self, gl: moderngl.Context, batch: Batch) -> None:
        super().__init__(gl)
        self.source = batch
        self.vertices = gl.buffer(np.ascontiguousarray(batch.vertices))
        self.rows = gl.buffer(np.repeat(batch.rows.astype(np.uint32), np.diff(batch.first_vertex)))
        self.matrix = gl.buffer(reserve=64, dynamic=True)
        self.indices = gl.buffer(reserve=batch.faces.nbytes, dynamic=True)
        self._few_bytes = 4096
        self._few = gl.buffer(reserve=self._few_bytes, dynamic=True)
        self._loaded: Mask | None = None
        self._count = 0
        self.extent = _extent(batch)

    def draw(self, program: moderngl.Program, view: View, chosen: Mask) -> None:
        if not chosen.any():
            return
        if self._loaded is None or not np.array_equal(chosen, self._loaded):
            indices: I32 = self.source.indices(chosen)
            self.indices.orphan()
            self.indices.write(np.ascontiguousarray(indices))
            self._loaded, self._count = chosen, len(indices)
        self._render(program, view, self.indices, self._count)

    def draw_items(self, program: moderngl.Program, view: View, items: NDArray[np.integer]) -> None:
        """Draw items given by their numbers, ascending, without a look at the others."""
        first = self.source.first_triangle
        triangles = spread(first[items], first[items + 1] - first[items])
        indices = np.take(self.source.faces, triangles, axis=0)
        # moderngl's `size` does not follow what it orphans
        if indices.nbytes > self._few_bytes:
            self._few_bytes = 2 * indices.nbytes
        self._few.orphan(self._few_bytes)
        self._few.write(indices)
        self._render(program, view, self._few, indices.size)

    def _render(self, program: moderngl.Program, view: View, indices: moderngl.Buffer, count: int) -> None:
        self.matrix.write(packed((view.projection() @ view.view_matrix(self.source.origin))[None]))
        content = [(self.vertices, "3f4", "position"), (self.rows, "1u4", "row"), (self.matrix, "16f4/i", "matrix")]
        self.array(program, content, indices).render(vertices=count, instances=1)

    def upload(self) -> None:
        self.vertices.write(np.ascontiguousarray(self.source.vertices))
        self.extent = _extent(self.source)
        self._loaded = None

    def release(self) -> None:
        self.release_arrays()
        for buffer in (self.vertices, self.rows, self.matrix, self.indices, self._few):
            buffer.release()


class _InstanceBuffers(_Buffers):
    def __init__(self, gl: moderngl.Context, entry: Instances) -> None:
        super().__init__(gl)
        self.source = entry
        self.vertices = gl.buffer(np.ascontiguousarray(entry.vertices))
        self.indices = gl.buffer(np.ascontiguousarray(entry.faces))
        self.rows = gl.buffer(reserve=4 * len(entry.rows), dynamic=True)
        self.matrices = gl.buffer(reserve=64 * len(entry.rows), dynamic=True)

    def draw(self, program: moderngl.Program, view: View, chosen: Mask) -> None:
        items = np.flatnonzero(chosen)
        if len(items):
            self.draw_items(program, view, items)

    def draw_items(self, program: moderngl.Program, view: View, items: NDArray[np.integer]) -> None:
        """Draw items given by their numbers."""
        self.rows.write(self.source.rows[items].astype(np.uint32))
        # the eye is subtracted from the place of each instance before anything is rounded
        local = self.source.matrices[items].copy()
        local[:, :3, 3] -= np.asarray(view.eye)
        self.matrices.write(packed(view.projection() @ view.view_matrix(view.eye) @ local))
        content = [(self.vertices, "3f4", "position"), (self.rows, "1u4/i", "row"), (self.matrices, "16f4/i", "matrix")]
        self.array(program, content, self.indices).render(instances=len(items))

    def upload(self) -> None:
        """Matrices are uploaded with every draw."""

    def release(self) -> None:
        self.release_arrays()
        for buffer in (self.vertices, self.indices, self.rows, self.matrices):
            buffer.release()


def _extent(batch: Batch) -> float:
    """Bound of the finite coordinates of a batch, of all three together."""
    with np.errstate(invalid="ignore"):
        largest = np.nanmax(np.abs(batch.vertices), axis=0, initial=0.0, where=np.isfinite(batch.vertices))
    return float(largest.sum())


def packed(matrices: F64) -> bytes:
    """(k, 4, 4) row-major float64 → OpenGL's column-major float32."""
    return np.ascontiguousarray(matrices.transpose(0, 2, 1), np.float32).tobytes()
