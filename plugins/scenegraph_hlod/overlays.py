"""What the viewer can show of the stage: the boxes of the drawn nodes, by how much occlusion has lowered their error.

Figures 8 to 10 of the paper, in its colors: blue for nodes whose error is taken as it is, magenta in between, red for
those of which next to nothing is visible.
"""

from __future__ import annotations

import numpy as np

from scenegraph import Frame, Lines, Overlay

from .cut import HlodCut
from .measures import Floats, Ints

Color = tuple[float, float, float]

#: Colors of equal parts of the way from no correction to a full one.
STEPS = 7

#: The twelve edges of a box, by the numbers of its corners (bit 0 is x, and so on).
_EDGES = np.array([(i, i | 1 << axis) for axis in range(3) for i in range(8) if not i >> axis & 1])
_SIGNS = np.array([[2 * (i >> axis & 1) - 1 for axis in range(3)] for i in range(8)], np.float64)


def correction_color(step: int) -> Color:
    """Blue, magenta, red."""
    way = step / (STEPS - 1)
    return (min(2 * way, 1.0), 0.05, min(2 - 2 * way, 1.0))


def box_edges(boxes: Floats) -> Floats:
    """(12 k, 2, 3) ends of the edges of boxes (6, k)."""
    corners = boxes[:3].T[:, None] + _SIGNS * boxes[3:].T[:, None]
    return corners[:, _EDGES].reshape(-1, 2, 3)


def correction_steps(cut: HlodCut) -> Ints:
    """(k,) color of each drawn node."""
    return np.minimum((cut.correction * STEPS).astype(np.int64), STEPS - 1)


class HlodBoxes(Overlay):
    """The boxes of the drawn nodes: blue where the error is taken as it is, red where little of the box is visible."""

    name = "HLOD boxes"
    stage = "hlod"

    def lines(self, frame: Frame) -> list[Lines]:
        """Edges of boxes, one color after another."""
        cut = frame.find(HlodCut)
        if cut is None:
            return []
        steps = correction_steps(cut)
        return [
            Lines(box_edges(cut.tree.boxes[:, cut.nodes[steps == step]]), correction_color(step), 1.5)
            for step in range(STEPS)
            if (steps == step).any()
        ]
