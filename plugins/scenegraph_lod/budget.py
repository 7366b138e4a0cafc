"""Levels within a budget of triangles per frame.

Funkhouser and Séquin ("Adaptive display algorithm for interactive frame rates", SIGGRAPH 1993) fill a frame's budget
greedily by benefit over cost. Here the largest error on the screen is what counts: with the switch thresholds of all
drawables in one order, the number of triangles is a falling step function of the threshold, and the smallest one within
the budget is found exactly, by sums over the bits of the thresholds instead of a heap (`mesh_level_budget`).

Levels of the frame before are favored: the thresholds of steps that a drawable had taken count as smaller by
`hysteresis`, which changes whose turn it is and not how much there is.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, parameter
from scenegraph.kernels.levels import mesh_level_budget

from .selection import I64, LevelStage

_LARGEST = np.finfo(np.float32).max


class LodBudget(LevelStage):
    """Draws no more than so many triangles, with the smallest largest error on the screen."""

    name = "lod_budget"

    triangles: int = parameter(1_000_000, minimum=0, maximum=2_000_000_000, help="in one frame, stand-ins included")
    hysteresis: float = parameter(
        0.2, minimum=0.0, maximum=0.95, help="errors of levels that a drawable had already count as smaller by this"
    )

    def choose(self, frame: Frame, rows: I64, before: NDArray[np.int16]) -> I64:
        """Take the steps with the smallest errors until what is left fits."""
        snapshot = frame.snapshot
        whole = len(rows) == snapshot.n
        seen = self.seen_errors(frame, rows)
        number = np.arange(len(seen))[:, None]
        exists = number < snapshot.level_count[rows]
        # what cannot be measured goes last, but it goes; the order of the rest is not touched
        seen = np.where(exists, np.fmin(seen, _LARGEST), np.float32(np.inf))
        if self.hysteresis:
            seen = np.where(number <= before, seen * np.float32(1 - self.hysteresis), seen)
        triangles = snapshot.triangles if whole else snapshot.triangles[:, rows]
        budget = self.triangles - sum(standin.triangles for standin in frame.standins)
        levels = mesh_level_budget(seen, triangles, frame.level[rows], budget=budget)
        used = int(np.take_along_axis(triangles, levels[None], axis=0).sum(dtype=np.int64))
        frame.count(triangles_used=used, over_budget=max(used - budget, 0))
        return levels
