"""The exact visible set by VTK alone: one actor per row, in a flat color that encodes the row.

It shares no code with the item buffer's own pass but the idea, and is what that pass is tested against.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .actors import Surface, actor_of, translation_of
from .layout import I64
from .window import OffscreenWindow

if TYPE_CHECKING:
    from ..snapshot import Snapshot
    from ..view import View

_COLORS = 1 << 24


class FlatItemBuffer:
    """All rows at their finest level as actors without lighting, multisampling, normals or textures.

    Parameters
    ----------
    snapshot : Snapshot

    Raises
    ------
    ValueError
        More rows than 24 bits of color can tell apart.
    """

    def __init__(self, snapshot: Snapshot) -> None:
        if snapshot.n >= _COLORS:
            raise ValueError(f"{snapshot.n} rows are more than 24 bits of color can tell apart; install moderngl")
        self._n = snapshot.n
        self._window = OffscreenWindow(16, 16, (0.0, 0.0, 0.0))
        self._place = translation_of(np.asarray(snapshot.origin))
        self._actors = {row: self._actor(snapshot, row) for row in range(snapshot.n)}
        self._translucent = [row for row in self._actors if self._is_translucent(snapshot, row)]

    @staticmethod
    def _is_translucent(snapshot: Snapshot, row: int) -> bool:
        mesh = snapshot.meshes[int(snapshot.mesh_index[row])]
        clear = [snapshot.colors[row, 3] < 1]
        if mesh.vertex_colors is not None:
            clear.append(mesh.vertex_colors[:, 3].min(initial=255) < 255)
        if mesh.texture is not None and mesh.uv is not None and mesh.texture.shape[2] == 4:
            clear.append(mesh.texture[..., 3].min(initial=255) < 255)
        return any(clear)

    def _actor(self, snapshot: Snapshot, row: int) -> Any:
        mesh = snapshot.meshes[int(snapshot.mesh_index[row])]
        world = snapshot.transforms[int(snapshot.transform_index[row])]
        with np.errstate(invalid="ignore", over="ignore"):
            points = (mesh.vertices @ world[:3, :3].T + (world[:3, 3] - snapshot.origin)).astype(np.float32)
        finite = np.isfinite(points).all(axis=1)
        faces = mesh.faces[finite[mesh.faces].all(axis=1)]
        points[~finite] = 0
        actor = actor_of(Surface(points, faces.reshape(-1)), self._place)
        number = row + 1
        made = actor.GetProperty()
        made.LightingOff()
        made.SetColor((number & 255) / 255, (number >> 8 & 255) / 255, (number >> 16 & 255) / 255)
        self._window.renderer.AddActor(actor)
        return actor

    def render(self, view: View) -> tuple[NDArray[np.uint32], I64]:
        """(h, w) numbers of rows, 1 for row 0, top row first; and (n,) pixels of translucent rows."""
        for row in self._translucent:
            self._actors[row].VisibilityOff()
        numbers = self._picture(view)
        extra = np.zeros(self._n, np.int64)
        for row in self._translucent:
            self._actors[row].VisibilityOn()
            extra[row] = np.count_nonzero(self._picture(view) == row + 1)
            self._actors[row].VisibilityOff()
        return numbers, extra

    def _picture(self, view: View) -> NDArray[np.uint32]:
        self._window.draw(view)
        rgb = self._window.image().astype(np.uint32)
        return np.asarray(rgb[..., 0] | rgb[..., 1] << 8 | rgb[..., 2] << 16)

    def close(self) -> None:
        """Give the window back."""
        self._window.close()
        self._actors.clear()
