"""The host's own colorings and gizmos; they know frames, and no method by name."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame
from ..overlay import Color, Lines, Overlay

#: Distinct on bright and dark scenes, and for most color-blind eyes: one per stage, in order.
STAGE_COLORS: tuple[Color, ...] = (
    (0.84, 0.32, 0.28),
    (0.25, 0.55, 0.85),
    (0.93, 0.66, 0.20),
    (0.55, 0.40, 0.75),
    (0.25, 0.68, 0.55),
    (0.85, 0.48, 0.66),
    (0.55, 0.62, 0.25),
    (0.45, 0.75, 0.85),
    (0.65, 0.45, 0.33),
)
VISIBLE: Color = (0.88, 0.88, 0.86)
#: Level 0, the finest, to the coarsest.
LEVEL_COLORS: tuple[Color, ...] = (
    (0.88, 0.88, 0.86),
    (0.98, 0.80, 0.42),
    (0.94, 0.56, 0.30),
    (0.82, 0.32, 0.34),
    (0.60, 0.22, 0.46),
    (0.34, 0.20, 0.48),
)
BOX_COLOR: Color = (0.30, 0.65, 0.72)
#: Corners of a box as signs, and its edges.
_SIGNS = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], np.float64)
_EDGES = np.array([(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)])


def stage_color(index: int) -> Color:
    """The color of the stage at this place of the pipeline."""
    return STAGE_COLORS[index % len(STAGE_COLORS)]


class ByStage(Overlay):
    """Everything, in the color of the stage that hid it."""

    name = "by hiding stage"

    def colors(self, frame: Frame) -> NDArray[np.float64]:
        """One color per stage, light gray for what is visible."""
        table = np.array([*(stage_color(i) for i in range(len(frame.record.stages))), VISIBLE])
        return np.column_stack([table[frame.hidden_by()], np.ones(frame.snapshot.n)])

    def legend(self, frame: Frame) -> list[tuple[str, Color]]:
        """The stages."""
        return [("visible", VISIBLE), *((r.name, stage_color(i)) for i, r in enumerate(frame.record.stages))]


class ByLevel(Overlay):
    """What is visible, in the color of its level of detail."""

    name = "by level"

    def colors(self, frame: Frame) -> NDArray[np.float64]:
        """Light gray for the finest level, darker and warmer for coarser ones."""
        table = level_colors(int(frame.snapshot.level_count.max(initial=1)))
        return np.column_stack([table[frame.level], frame.visible])

    def legend(self, frame: Frame) -> list[tuple[str, Color]]:
        """The levels that the scene has; of many, some."""
        deepest = int(frame.snapshot.level_count.max(initial=1))
        table = level_colors(deepest)
        shown = np.unique(np.linspace(0, deepest - 1, min(deepest, len(LEVEL_COLORS))).astype(int)).tolist()
        return [(f"level {i}", (float(table[i, 0]), float(table[i, 1]), float(table[i, 2]))) for i in shown]


def level_colors(count: int) -> NDArray[np.float64]:
    """(count, 3) colors of so many levels: those of the table, or spread between its first and last."""
    table = np.array(LEVEL_COLORS)
    if count <= len(table):
        return table[:count]
    at = np.linspace(0, len(table) - 1, count)
    return np.stack([np.interp(at, np.arange(len(table)), table[:, k]) for k in range(3)], axis=1)


class Boxes(Overlay):
    """The bounding hierarchy: boxes of its nodes."""

    name = "bounding hierarchy"
    #: More nodes than this are too many lines to see anything.
    most = 4000

    def lines(self, frame: Frame) -> list[Lines]:
        """Boxes of the deepest levels that are not too many."""
        tree = frame.snapshot.tree
        starts = tree.level_start
        last = int(np.searchsorted(starts, self.most, side="right")) - 1
        boxes = tree.boxes[:, : starts[max(last, 1)]] if len(tree) else tree.boxes
        return [Lines(box_edges(boxes), BOX_COLOR, 1.0)]


def box_edges(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(12 k, 2, 3) edges of boxes (6, k); boxes that are not finite have none."""
    known = boxes[:, np.isfinite(boxes).all(axis=0)].T
    corners = known[:, None, :3] + _SIGNS * known[:, None, 3:]
    return np.asarray(corners[:, _EDGES].reshape(-1, 2, 3))
