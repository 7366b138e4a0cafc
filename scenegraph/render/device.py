"""What a stage that needs "gl" gets as `frame.device`: VTK's OpenGL context, and the rows of the scene in it.

A stage draws with moderngl into frame buffers of its own, inside `Device.guard`. Rows are uploaded once, in the arrays
that VTK draws from, whatever number of stages asks for them.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

import numpy as np

from .buffers import VERTEX_SHADER, RowBuffers
from .context import context_of, depth_texture, guard, is_alive
from .geometry import Geometry
from .layout import F32, F64, I64, U8, Mask
from .queries import BoxQueries
from .standins import TableBuffers, TableGeometry

if TYPE_CHECKING:
    import moderngl

    from ..mesh import MeshTable
    from ..snapshot import Snapshot
    from ..view import View

#: Tables of stand-ins that are kept uploaded.
_TABLES_KEPT = 256

_NO_COLOR = """
#version 330 core
void main() {}
"""


#: Frame buffers of different sizes that a device keeps.
TARGETS = 8


class DepthTarget:
    """A frame buffer with nothing but depth.

    Attributes
    ----------
    width, height : int
    texture : moderngl.Texture
        The depth, for shaders that test against it.
    framebuffer : moderngl.Framebuffer
    """

    def __init__(self, window: Any, width: int, height: int) -> None:
        self.width, self.height = width, height
        self.texture = depth_texture(window, (width, height))
        # a plain value instead of the outcome of a comparison
        self.texture.compare_func = ""
        self.framebuffer = context_of(window).framebuffer(depth_attachment=self.texture)

    def clear(self, depth: float = 1.0) -> None:
        """Forget what was drawn; 1 is the far plane. VTK's scissors would spare a part of a buffer not in use."""
        self.framebuffer.use()
        self.framebuffer.clear(depth=depth)

    def read(self) -> F32:
        """(h, w) depth in window coordinates, 0 near to 1 far; row 0 is the lowest, as in the rectangles of `View`."""
        data = self.framebuffer.read(components=1, attachment=-1, dtype="f4", alignment=1)
        return np.frombuffer(data, np.float32).reshape(self.height, self.width)

    def release(self) -> None:
        """Free the frame buffer."""
        self.framebuffer.release()
        self.texture.release()


class Device:
    """GL services of one window.

    Parameters
    ----------
    window : vtkRenderWindow or OffscreenWindow

    Examples
    --------
    Depth of the rows that are still visible, in a stage::

        with frame.device.guard():
            target = frame.device.depth_target(frame.view.width, frame.view.height)
            frame.device.draw_depth(target, frame.view, frame.snapshot, frame.visible)
            depth = target.read()
    """

    def __init__(self, window: Any) -> None:
        self.window: Any = getattr(window, "render_window", window)
        self._gl: moderngl.Context | None = None
        self._rows: RowBuffers | None = None
        self._targets: dict[tuple[int, int], DepthTarget] = {}
        self._depth_program: moderngl.Program | None = None
        self._tables: dict[int, TableBuffers] = {}
        #: Occlusion queries against a depth target.
        self.queries = BoxQueries(self)

    @property
    def gl(self) -> moderngl.Context:
        """The moderngl context of the window; use it inside `guard` only.

        Raises
        ------
        GLError
            moderngl is missing, or cannot attach to this kind of window.
        """
        current = context_of(self.window)
        if current is not self._gl:
            # the window has a new context, and what was made in the old one went with it
            self._gl, self._rows, self._depth_program = current, None, None
            self._targets, self._tables = {}, {}
        return current

    @property
    def version_code(self) -> int:
        """430 for OpenGL 4.3, the first with shader storage buffers."""
        return int(self.gl.version_code)

    @property
    def largest_target(self) -> int:
        """Longest side in pixels that a depth target may have."""
        info = self.gl.info
        sizes = (info["GL_MAX_TEXTURE_SIZE"], info["GL_MAX_RENDERBUFFER_SIZE"], *info["GL_MAX_VIEWPORT_DIMS"])
        return int(min(sizes))

    def guard(self) -> AbstractContextManager[None]:
        """Around all own GL calls, so that VTK's picture stays right; may not be nested."""
        _ = self.gl
        return guard(self.window)

    def rows(self, snapshot: Snapshot) -> RowBuffers:
        """All rows of a snapshot as vertex buffers, as they are now; inside `guard`."""
        gl = self.gl
        geometry = Geometry.shared(snapshot)
        if self._rows is None or self._rows.geometry is not geometry:
            if self._rows is not None:
                self._rows.release()
            self._rows = RowBuffers(gl, geometry)
        self._rows.sync()
        return self._rows

    def reach(self, view: View) -> float:
        """Largest magnitude, in world units, of the coordinates in which rows and stand-ins are drawn in float32."""
        rows = self._rows.reach(view) if self._rows is not None else 0.0
        return max(rows, *(table.reach(view) for table in self._tables.values()), 0.0)

    def depth_target(self, width: int, height: int) -> DepthTarget:
        """A frame buffer of this size, the same one at every call; inside `guard`.

        Only the last `TARGETS` sizes are kept: a window that is being resized asks for a new one in every frame.
        """
        _ = self.gl
        target = self._targets.pop((width, height), None)
        if target is None:
            if len(self._targets) >= TARGETS:
                self._targets.pop(next(iter(self._targets))).release()
            target = DepthTarget(self.window, width, height)
        self._targets[width, height] = target
        return target

    def draw_depth(
        self,
        target: DepthTarget,
        view: View,
        snapshot: Snapshot,
        visible: Mask | I64 | None = None,
        level: U8 | None = None,
        *,
        clear: bool = True,
    ) -> None:
        """Draw the depth of opaque rows, as VTK would; inside `guard`.

        Parameters
        ----------
        target : DepthTarget
        view : View
            Its image is fitted to the target.
        snapshot : Snapshot
        visible : (n,) bool or (k,) indices, optional
            All rows by default. Indices cost as much as there are of them, however many rows there are.
        level : (n,) uint8, optional
            The finest level by default.
        clear : bool
            Forget what the target holds.
        """
        program = self._depth_pass(target, clear=clear)
        self.rows(snapshot).draw(program, view, visible=visible, level=level)

    def draw_depth_of(
        self,
        target: DepthTarget,
        view: View,
        table: MeshTable,
        chosen: I64,
        matrix: F64 | None = None,
        *,
        clear: bool = False,
    ) -> None:
        """Draw the depth of opaque meshes of a table of stand-ins; inside `guard`.

        Parameters
        ----------
        target : DepthTarget
        view : View
            Its image is fitted to the target.
        table : MeshTable
            Uploaded at the first call.
        chosen : (j,) int64
            Which meshes, in the order in which they are drawn.
        matrix : (4, 4) float64, optional
            World coordinates without.
        clear : bool
            Forget what the target holds.
        """
        program = self._depth_pass(target, clear=clear)
        loaded = self._tables.pop(id(table), None) or TableBuffers(self.gl, TableGeometry.shared(table))
        # taken out and put back: the order of the dict is the order of last use
        self._tables[id(table)] = loaded
        for key in list(self._tables)[: max(0, len(self._tables) - _TABLES_KEPT)]:
            self._tables.pop(key).release()
        loaded.draw(program, view, chosen, matrix)

    def _depth_pass(self, target: DepthTarget, *, clear: bool) -> moderngl.Program:
        gl = self.gl
        if self._depth_program is None:
            self._depth_program = gl.program(vertex_shader=VERTEX_SHADER, fragment_shader=_NO_COLOR)
        target.framebuffer.use()
        gl.enable_only(gl.DEPTH_TEST)
        gl.depth_func = "<="
        if clear:
            target.clear()
        return self._depth_program

    def close(self) -> None:
        """Free what this device has made. Closing twice is allowed."""
        if self._gl is not None and is_alive(self.window) and context_of(self.window) is self._gl:
            with guard(self.window):
                self.queries.close()
                for resource in (self._rows, self._depth_program, *self._targets.values(), *self._tables.values()):
                    if resource is not None:
                        resource.release()
        self._gl, self._rows, self._depth_program = None, None, None
        self._targets, self._tables = {}, {}
