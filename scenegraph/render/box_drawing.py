"""How boxes for occlusion queries are drawn: corners in a vertex buffer, tested against depth, nothing written."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np

from ..kernels.proxies import TRIANGLES
from .layout import F32

if TYPE_CHECKING:
    import moderngl

    from .device import DepthTarget

_VERTEX = """
#version 330 core
in vec4 corner;
flat out int box;
void main() {
    box = gl_VertexID / 8;
    gl_Position = corner;
}
"""
_NOTHING = """
#version 330 core
void main() {}
"""
# without early tests the shader would count what is hidden, because it has a side effect
_COUNT = """
#version 430 core
layout(early_fragment_tests) in;
layout(std430, binding = 0) buffer Counts { uint counts[]; };
flat in int box;
void main() {
    @WAY@;
}
"""
_WAYS = {"count": "atomicAdd(counts[box], 1u)", "mark": "counts[box] = 1u"}

#: Part of its slope (depth per pixel) by which a face comes nearer: interpolating steep faces is not exact.
SLOPE = 1 / 16

#: Depth of the known box, in half depth ranges; next to the near plane.
_KNOWN_DEPTH = 2.0**-22 - 1.0


class BoxDrawing:
    """Corners of boxes in a vertex buffer, and the two programs that draw them."""

    def __init__(self, gl: moderngl.Context) -> None:
        self.gl = gl
        self._programs = {"plain": gl.program(vertex_shader=_VERTEX, fragment_shader=_NOTHING)}
        self._arrays: dict[str, Any] = {}
        self._capacity = 0
        self._vertices: Any = None
        self._indices: Any = None
        self._counts: Any = None

    @property
    def plain(self) -> Any:
        """Draws box i with `first=36 * i, vertices=36`."""
        return self._array("plain")

    def counting(self, way: str) -> Any:
        """Draws k boxes with `vertices=36 * k`; "count" counts their samples, "mark" sets those to 1 that have any."""
        if way not in self._programs:
            shader = _COUNT.replace("@WAY@", _WAYS[way])
            self._programs[way] = self.gl.program(vertex_shader=_VERTEX, fragment_shader=shader)
        return self._array(way)

    def _array(self, name: str) -> Any:
        if name not in self._arrays:
            content = [(self._vertices, "4f4", "corner")]
            self._arrays[name] = self.gl.vertex_array(
                self._programs[name], content, index_buffer=self._indices, index_element_size=4
            )
        return self._arrays[name]

    def load(self, corners: F32) -> None:
        """Take over corners (k, 8, 4)."""
        if len(corners) > self._capacity:
            self._release_buffers()
            self._capacity = max(64, 2 * len(corners))
            self._vertices = self.gl.buffer(reserve=128 * self._capacity, dynamic=True)
            all_boxes = np.arange(self._capacity, dtype=np.uint32)[:, None] * 8 + TRIANGLES
            self._indices = self.gl.buffer(all_boxes)
            self._counts = self.gl.buffer(reserve=4 * self._capacity, dynamic=True)
        else:
            # what is being drawn from it is left alone
            self._vertices.orphan()
        self._vertices.write(corners)

    def cleared_counts(self, k: int) -> Any:
        """A buffer of k zeros, or more."""
        self._counts.write(bytes(4 * k))
        return self._counts

    def _release_buffers(self) -> None:
        for resource in (*self._arrays.values(), self._vertices, self._indices, self._counts):
            if resource is not None:
                resource.release()
        self._arrays = {}

    def release(self) -> None:
        """Free all."""
        self._release_buffers()
        for program in self._programs.values():
            program.release()


@contextmanager
def testing_only(gl: moderngl.Context, target: DepthTarget) -> Iterator[None]:
    """Draw front faces against the depth of a target, without writing."""
    target.framebuffer.depth_mask = False
    target.framebuffer.use()
    gl.enable_only(gl.DEPTH_TEST | gl.CULL_FACE)
    gl.depth_func, gl.cull_face, gl.front_face = "<=", "back", "ccw"
    gl.polygon_offset = -SLOPE, 0.0
    try:
        yield
    finally:
        gl.polygon_offset = 0.0, 0.0
        target.framebuffer.depth_mask = True
        # masks take effect with the next use, and the caller may go on drawing
        target.framebuffer.use()


def _clip_box(x: float, y: float, front: float, back: float) -> F32:
    """(1, 8, 4) corners of a box in clip space, around the middle of the picture."""
    # of two depths the smaller is the nearer, so that bit 2 of a corner's number means what it does in eye space
    corners = [[[[i * x, j * y, z, 1.0] for i in (-1, 1)] for j in (-1, 1)] for z in (back, front)]
    return np.array(corners, np.float32).reshape(1, 8, 4)


def wide_box(front: float) -> F32:
    """A box as wide as the picture, with its front at this depth, in half depth ranges."""
    return _clip_box(1.0, 1.0, front, front + 0.1)


def known_box(target: DepthTarget) -> F32:
    """A box of four by four pixels, or the whole target if that is smaller, in front of everything."""
    return _clip_box(min(4 / target.width, 1.0), min(4 / target.height, 1.0), _KNOWN_DEPTH, _KNOWN_DEPTH + 0.001)
