"""What the viewer can show of frustum culling: the culling camera's pyramid, and what lies outside it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import Faces, Frame, Lines, Overlay

from .frustum import Frustum

AMBER = (0.95, 0.62, 0.18)
OUTSIDE = (0.85, 0.33, 0.28)
INSIDE = (0.86, 0.86, 0.84)

#: Corners of the frustum joined by its edges: near four, far four.
EDGES = np.array([(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)])
SIDES = np.array([(0, 4, 5), (0, 5, 1), (1, 5, 6), (1, 6, 2), (2, 6, 7), (2, 7, 3), (3, 7, 4), (3, 4, 0)])


def shown_corners(frame: Frame) -> NDArray[np.float64]:
    """(8, 3) corners of the view frustum, the far ones not beyond the scene."""
    view = frame.view
    bounds = frame.snapshot.boxes
    known = np.isfinite(bounds).all(axis=0)
    if not known.any():
        return view.corners()
    center, half = bounds[:3, known], bounds[3:, known]
    along = view.forward @ (center - np.asarray(view.eye)[:, None]) + np.abs(view.forward) @ half
    return view.corners(far=float(np.clip(along.max(), view.near * 2, view.far)))


class Pyramid(Overlay):
    """The view frustum of the culling camera, as far as the scene reaches."""

    name = "view frustum"
    stage = Frustum.name

    def lines(self, frame: Frame) -> list[Lines]:
        """The twelve edges."""
        return [Lines(shown_corners(frame)[EDGES], AMBER, 2.0)]

    def faces(self, frame: Frame) -> list[Faces]:
        """The four sides."""
        return [Faces(shown_corners(frame), SIDES, AMBER, 0.06)]


class Outside(Overlay):
    """Rows that the view frustum has hidden in red, all others as they came."""

    name = "outside the frustum"
    stage = Frustum.name

    def colors(self, frame: Frame) -> NDArray[np.float64]:
        """Red outside."""
        names = [record.name for record in frame.record.stages]
        hidden = frame.hidden_by() == names.index(Frustum.name)
        return np.where(hidden[:, None], (*OUTSIDE, 1.0), (*INSIDE, 1.0))

    def legend(self, frame: Frame) -> list[tuple[str, tuple[float, float, float]]]:
        """Two colors."""
        return [("outside", OUTSIDE), ("inside or partly", INSIDE)]
