"""What the viewer can show of occlusion queries: the boxes that were asked, and how old answers are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, Lines, Overlay

from .history import QueryHistory
from .query import Query

Color = tuple[float, float, float]

SEEN, HIDDEN, PROTECTED = (0.35, 0.78, 0.36), (0.85, 0.33, 0.28), (0.55, 0.55, 0.60)
FRESH, OLD = np.array([0.35, 0.78, 0.36]), np.array([0.95, 0.62, 0.18])

#: Corners of a box, bit 0 x, bit 1 y, bit 2 z, joined by its edges.
_EDGES = np.array([(i, i | bit) for bit in (1, 2, 4) for i in range(8) if not i & bit])
_SIGNS = np.array([[2 * (i >> axis & 1) - 1 for axis in range(3)] for i in range(8)], np.float64)


def box_edges(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(12 k, 2, 3) edges of the finite ones of boxes (6, k)."""
    boxes = boxes[:, np.isfinite(boxes).all(axis=0)].T
    corners = boxes[:, None, :3] + boxes[:, None, 3:] * _SIGNS
    return np.asarray(corners[:, _EDGES].reshape(-1, 2, 3))


class Asked(Overlay):
    """The boxes that occlusion queries asked about in this frame, green where something was seen and red where not."""

    name = "occlusion queries"
    stage = Query.name

    def lines(self, frame: Frame) -> list[Lines]:
        """The edges of the boxes."""
        history = frame.find(QueryHistory)
        if history is None:
            return []
        parts = [(history.seen, SEEN, 1.5), (~history.seen, HIDDEN, 1.0)]
        return [
            Lines(box_edges(history.asked_boxes[:, mask]), color, width) for mask, color, width in parts if mask.any()
        ]

    def legend(self, frame: Frame) -> list[tuple[str, Color]]:
        """Numbers of boxes."""
        history = frame.find(QueryHistory)
        if history is None:
            return []
        seen = int(np.count_nonzero(history.seen))
        return [(f"seen: {seen}", SEEN), (f"not seen: {len(history.seen) - seen}", HIDDEN)]


class ByAge(Overlay):
    """Visible rows by the age of the answer they rest on, from green to amber; red what queries have hidden."""

    name = "age of query answers"
    stage = Query.name

    def colors(self, frame: Frame) -> NDArray[np.float64] | None:
        """By age; what was not asked about is gray."""
        history = frame.find(QueryHistory)
        if history is None:
            return None
        ages = history.ages()
        share = np.clip(ages / max(int(ages.max(initial=0)), 1), 0.0, 1.0)[:, None]
        colors = np.ones((len(ages), 4))
        colors[:, :3] = np.where(ages[:, None] < 0, PROTECTED, FRESH + share * (OLD - FRESH))
        names = [record.name for record in frame.record.stages]
        colors[frame.hidden_by() == names.index(Query.name), :3] = HIDDEN
        return colors

    def legend(self, frame: Frame) -> list[tuple[str, Color]]:
        """Fresh, oldest, never asked, hidden."""
        history = frame.find(QueryHistory)
        oldest = 0 if history is None else int(history.ages().max(initial=0))
        red, green, blue = OLD.tolist()
        return [
            ("asked in this frame", SEEN),
            (f"answers up to {oldest} frames old", (red, green, blue)),
            ("not asked", PROTECTED),
            ("hidden", HIDDEN),
        ]
