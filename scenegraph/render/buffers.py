"""The rows of a snapshot in OpenGL buffers, for own passes: ids, depth, queries.

Uploaded once and reused by every pass. The arrays and matrices are those that VTK gets, so an own pass covers the same
pixels as the picture does.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from .layout import F64, I32, U8, Batch, Instances, Mask

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

    def draw(
        self,
        program: moderngl.Program,
        view: View,
        *,
        visible: Mask | None = None,
        level: U8 | None = None,
        translucent: bool = False,
    ) -> None:
        """Draw rows into the frame buffer in use.

        Parameters
        ----------
        program : moderngl.Program
            With the inputs of `VERTEX_SHADER`, or some of them.
        view : View
        visible : (n,) bool, optional
            All rows by default.
        level : (n,) uint8, optional
            The finest level by default.
        translucent : bool
            Draw the translucent rows instead of the opaque ones.
        """
        seen, levels = self._defaults(visible, level)
        for part in self._parts:
            if part.source.material.translucent == translucent:
                part.draw(program, view, part.source.chosen(seen, levels))

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

    def sync(self) -> None:
        """Upload what the geometry has rewritten."""
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
        self._arrays: dict[int, Any] = {}

    def array(self, program: moderngl.Program, content: list[tuple[Any, ...]], index: Any) -> Any:
        if program.glo not in self._arrays:
            # inputs that the compiler has removed are skipped
            made = self.gl.vertex_array(program, content, index_buffer=index, index_element_size=4, skip_errors=True)
            self._arrays[program.glo] = made
        return self._arrays[program.glo]

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
        self._loaded: Mask | None = None
        self._count = 0

    def draw(self, program: moderngl.Program, view: View, chosen: Mask) -> None:
        if not chosen.any():
            return
        if self._loaded is None or not np.array_equal(chosen, self._loaded):
            indices: I32 = self.source.indices(chosen)
            self.indices.orphan()
            self.indices.write(np.ascontiguousarray(indices))
            self._loaded, self._count = chosen, len(indices)
        self.matrix.write(packed((view.projection() @ view.view_matrix(self.source.origin))[None]))
        content = [(self.vertices, "3f4", "position"), (self.rows, "1u4", "row"), (self.matrix, "16f4/i", "matrix")]
        self.array(program, content, self.indices).render(vertices=self._count, instances=1)

    def upload(self) -> None:
        self.vertices.write(np.ascontiguousarray(self.source.vertices))
        self._loaded = None

    def release(self) -> None:
        self.release_arrays()
        for buffer in (self.vertices, self.rows, self.matrix, self.indices):
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
        if not len(items):
            return
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


def packed(matrices: F64) -> bytes:
    """(k, 4, 4) row-major float64 → OpenGL's column-major float32."""
    return np.ascontiguousarray(matrices.transpose(0, 2, 1), np.float32).tobytes()
