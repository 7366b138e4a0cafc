"""Levels by distance: the rule that every engine has, with switch distances in sizes of the drawable.

Distances are to the nearest point of the box, so that turning on the spot changes nothing; they are counted in
diagonals of the box, so that a large thing and a small one of the same look on the screen get the same level; and
zooming in brings things nearer. Level 1 begins at `first`, and each further level at `ratio` times the distance of the
one before.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, parameter
from scenegraph.kernels.levels import box_distance

from .selection import I64, LevelStage, held


class LodDistance(LevelStage):
    """Draws what is farther away, counted in its own sizes, at coarser levels."""

    name = "lod_distance"

    first: float = parameter(
        8.0, minimum=0.0, maximum=1e6, unit="sizes", help="distance at which level 1 begins, at a view of 60 degrees"
    )
    ratio: float = parameter(
        2.0, minimum=1.01, maximum=100.0, help="each further level begins at so many times the distance"
    )
    hysteresis: float = parameter(
        0.1, minimum=0.0, maximum=0.95, help="a drawable keeps its level within this share of a switch distance"
    )

    def choose(self, frame: Frame, rows: I64, before: NDArray[np.int16]) -> I64:
        """Compare distances with those of the switches, and with distances a little shorter."""
        sizes = self.distances(frame, rows)
        coarsest = self._level(sizes)
        return held(before, self._level(sizes * (1 - self.hysteresis)), coarsest)

    def distances(self, frame: Frame, rows: I64) -> NDArray[np.float64]:
        """(k,) distance of each row in sizes of its box, as at a view of 60 degrees; 0 where unknown."""
        view, boxes = frame.view, frame.snapshot.boxes[:, rows]
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            size = 2 * np.sqrt((boxes[3:] ** 2).sum(axis=0))
            if view.parallel_scale is not None:
                far = np.full(len(rows), view.parallel_scale)
            else:
                far = box_distance(boxes, np.asarray(view.eye)) * math.tan(math.radians(view.fov) / 2)
            out = far / math.tan(math.radians(30)) / size
        # a point of no size is far away, but not if it is where the eye is
        return np.where(np.isnan(out), 0.0, out)

    def _level(self, sizes: NDArray[np.float64]) -> I64:
        with np.errstate(divide="ignore"):
            steps = np.log(sizes / self.first) / math.log(self.ratio) if self.first else np.full(len(sizes), np.inf)
        return np.asarray(np.clip(np.floor(steps) + 1, 0, 255), np.int64)
