"""The exact visible set: which drawables can be seen in a view, and with how many pixels.

All rows are drawn at their finest level, whatever a pipeline has decided, each with its row number as its color, into
an own frame buffer of 32-bit integers inside VTK's context; counting the numbers gives the pixels of each row. Back
faces are drawn, as VTK draws them. Translucent rows let others shine through: they are counted one by one against the
depth of the opaque rows.

Where moderngl is missing, `FlatItemBuffer` answers instead: the same by another way, through VTK alone, and slower.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..errors import GLError
from .buffers import VERTEX_SHADER, RowBuffers
from .context import context_of, depth_texture, guard, is_alive
from .flat_item_buffer import FlatItemBuffer
from .geometry import Geometry
from .layout import I32, I64, Mask
from .window import OffscreenWindow

if TYPE_CHECKING:
    import moderngl

    from ..snapshot import Snapshot
    from ..view import View

#: Largest side of the frame buffer; larger images are drawn in tiles.
TILE = 4096

_FRAGMENT_SHADER = """
#version 330 core
flat in uint drawn_row;
out uint number;
void main() {
    number = drawn_row + 1u;
}
"""


@dataclass(frozen=True)
class ExactVisibleSet:
    """The truth about one view.

    Rasterizers snap corners to a fraction of a pixel, so a row of very few samples may be found at one factor of
    supersampling and missed at another.

    Attributes
    ----------
    pixels : (n,) int64
        Samples of each row: pixels of the view, times `supersample`². Fragments for translucent rows.
    ids : (h · supersample, w · supersample) int32
        Row in front at each sample, -1 where there is none; top row first. Translucent rows are not in it.
    supersample : int
    """

    pixels: I64
    ids: I32
    supersample: int = 1

    @property
    def visible(self) -> Mask:
        """(n,) bool rows with at least one sample."""
        return np.asarray(self.pixels > 0)


class ItemBuffer:
    """Exact visible sets of a snapshot.

    Parameters
    ----------
    snapshot : Snapshot
    window : OffscreenWindow, optional
        Whose OpenGL context is used; nothing in it is changed. An own one by default.

    Raises
    ------
    GLError
        There is no OpenGL here.
    """

    def __init__(self, snapshot: Snapshot, window: OffscreenWindow | None = None) -> None:
        self.snapshot = snapshot
        self._own_window = OffscreenWindow(16, 16) if window is None else None
        self._window = window or self._own_window
        self._passes: _IdPass | FlatItemBuffer | None = None

    @property
    def is_independent_of_vtk(self) -> bool:
        """Whether own passes draw the ids, rather than VTK's actors because moderngl is missing."""
        return isinstance(self._opened(), _IdPass)

    def _opened(self) -> _IdPass | FlatItemBuffer:
        if self._passes is None:
            assert self._window is not None
            try:
                gl = context_of(self._window.render_window)
            except GLError:
                self._passes = FlatItemBuffer(self.snapshot)
            else:
                self._passes = _IdPass(gl, self._window, Geometry.shared(self.snapshot))
        return self._passes

    def render(self, view: View, *, supersample: int = 1) -> ExactVisibleSet:
        """What can be seen in a view.

        Parameters
        ----------
        view : View
        supersample : int, default 1
            Samples per pixel and axis.
        """
        if supersample < 1:
            raise ValueError(f"supersample={supersample}; expected at least 1")
        large = view.resized(view.width * supersample, view.height * supersample)
        numbers, extra = self._opened().render(large)
        pixels = np.bincount(numbers.reshape(-1), minlength=self.snapshot.n + 1)[1:].astype(np.int64) + extra
        return ExactVisibleSet(pixels, numbers.astype(np.int32) - 1, supersample)

    def sync(self) -> None:
        """Follow the snapshot after its own `sync()`."""
        if not (isinstance(self._passes, _IdPass) and self._passes.sync()):
            self._release()

    def _release(self) -> None:
        if self._passes is not None:
            self._passes.close()
            self._passes = None

    def close(self) -> None:
        """Free what the window holds for this item buffer. Closing twice is allowed."""
        self._release()
        if self._own_window is not None:
            self._own_window.close()
            self._own_window = None
        self._window = None


class _IdPass:
    """The own pass: numbers of rows, 1 for row 0."""

    def __init__(self, gl: moderngl.Context, window: OffscreenWindow, geometry: Geometry) -> None:
        self._gl = gl
        self._window = window.render_window
        self._geometry = geometry
        with guard(self._window):
            self._program = gl.program(vertex_shader=VERTEX_SHADER, fragment_shader=_FRAGMENT_SHADER)
            self._buffers = RowBuffers(gl, geometry)
        self._tile = min(TILE, int(gl.info["GL_MAX_RENDERBUFFER_SIZE"]), int(gl.info["GL_MAX_TEXTURE_SIZE"]))
        self._largest = min(gl.info["GL_MAX_VIEWPORT_DIMS"])

    def render(self, view: View) -> tuple[NDArray[np.uint32], I64]:
        """(h, w) numbers, top row first, and (n,) fragments of translucent rows."""
        if max(view.width, view.height) > self._largest:
            raise GLError(
                f"an item buffer of {view.width}x{view.height} samples is too large for this OpenGL; "
                f"its longer side may have {self._largest}: take a smaller image or supersampling factor"
            )
        numbers = np.empty((view.height, view.width), np.uint32)
        extra = np.zeros(self._geometry.snapshot.n, np.int64)
        with guard(self._window):
            for y in range(0, view.height, self._tile):
                for x in range(0, view.width, self._tile):
                    width, height = min(self._tile, view.width - x), min(self._tile, view.height - y)
                    tile = self._render_tile(view, x, y, width, height, extra)
                    numbers[view.height - y - height : view.height - y, x : x + width] = tile[::-1]
        return numbers, extra

    def _render_tile(self, view: View, x: int, y: int, width: int, height: int, extra: I64) -> NDArray[np.uint32]:
        gl = self._gl
        color = gl.texture((width, height), 1, dtype="u4")
        depth = depth_texture(self._window, (width, height))
        target = gl.framebuffer([color], depth)
        try:
            # the viewport of the whole image, moved: triangles are snapped to the same subpixels in every tile
            target.viewport = (-x, -y, view.width, view.height)
            target.use()
            gl.enable_only(gl.DEPTH_TEST)
            gl.depth_func = "<="
            target.clear(depth=1.0)
            # clearing an integer buffer with a floating-point color is undefined
            color.write(np.zeros((height, width), np.uint32))
            self._buffers.draw(self._program, view)
            found = np.frombuffer(target.read(components=1, dtype="u4", alignment=1), np.uint32).reshape(height, width)
            target.depth_mask = False
            target.use()
            for row, draw in self._buffers.each_translucent(self._program, view):
                query = gl.query(samples=True)
                with query:
                    draw()
                extra[row] += int(query.samples)
            return found
        finally:
            for resource in (target, color, depth):
                resource.release()

    def sync(self) -> bool:
        """Take over moved rows; False if everything has to be loaded anew."""
        if Geometry.shared(self._geometry.snapshot) is not self._geometry:
            return False
        with guard(self._window):
            self._buffers.sync()
        return True

    def close(self) -> None:
        # a window that was closed before has taken its buffers with it
        if is_alive(self._window):
            with guard(self._window):
                self._buffers.release()
                self._program.release()
