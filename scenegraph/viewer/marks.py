"""All that is drawn to explain a frame: colorings, wires of what is hidden, flashes, gizmos and insets."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from ..overlay import Color, Overlay
from ..snapshot import Snapshot
from .ghosts import Gizmos, Painting

RED = (0.93, 0.30, 0.26, 1.0)
FLASH = (1.0, 0.15, 0.75, 1.0)


class Marks:
    """What a viewer adds to the scene; nothing of it is in a screenshot.

    Parameters
    ----------
    snapshot : Snapshot
    renderer : vtkRenderer
    front : vtkRenderer, optional
        Of a layer in front, with the same camera: for what shines through.

    Attributes
    ----------
    insets : list of (str, (h, w, 3) uint8)
        Name and picture of each that the overlays shown have for this frame.
    legend : list of (str, color)
        Of the coloring.
    """

    def __init__(self, snapshot: Snapshot, renderer: Any, front: Any = None) -> None:
        self._n, self._renderer, self._front = snapshot.n, renderer, front
        self._painting = Painting(snapshot, renderer)
        self._wires = {id(r): Painting(snapshot, r, wire=True) for r in (renderer, front) if r is not None}
        self._flash = Painting(snapshot, renderer if front is None else front, wire=True)
        self._gizmos = Gizmos(renderer)
        self._finest = np.zeros(snapshot.n, np.uint8)
        self.insets: list[tuple[str, NDArray[np.uint8]]] = []
        self.legend: list[tuple[str, Color]] = []

    def hide(self) -> None:
        """Draw nothing of it."""
        for painting in (self._painting, self._flash, *self._wires.values()):
            painting.hide()
        self._gizmos.clear()
        self.insets, self.legend = [], []

    def explain(
        self, frame: Frame, coloring: Overlay | None, gizmos: Sequence[Overlay], picked: int | None = None
    ) -> bool:
        """Draw what overlays have to show of a frame and of a picked row; whether its own colors are replaced.

        Raises
        ------
        Exception
            Whatever the overlays raise; then nothing of them is drawn.
        """
        for overlay in (*gizmos, *(() if coloring is None else (coloring,))):
            overlay.picked = picked
        colors = None if coloring is None else coloring.colors(frame)
        legend = [] if coloring is None else coloring.legend(frame)
        lines = [line for overlay in gizmos for line in overlay.lines(frame)]
        faces = [face for overlay in gizmos for face in overlay.faces(frame)]
        pictures = [(overlay.name, overlay.inset(frame)) for overlay in gizmos]
        if colors is not None:
            self._painting.show(np.asarray(colors), np.ones(self._n, bool), frame.level)
        self._gizmos.show(lines, faces)
        self.legend = legend
        self.insets = [(name, picture) for name, picture in pictures if picture is not None]
        return colors is not None

    def show_hidden(self, frame: Frame, *, shine_through: bool) -> None:
        """Draw what is hidden as red wires, in front of everything or where it is."""
        target = self._front if shine_through and self._front is not None else self._renderer
        self._wires[id(target)].show(np.tile(RED, (self._n, 1)), ~frame.kept(), self._finest)

    def flash(self, rows: NDArray[np.int64]) -> None:
        """Draw rows as pink wires in front of everything."""
        wrong = np.zeros(self._n, bool)
        wrong[rows] = True
        self._flash.show(np.tile(FLASH, (self._n, 1)), wrong, self._finest)
