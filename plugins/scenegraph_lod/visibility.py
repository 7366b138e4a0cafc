"""Levels by how much detail the occluders in front let through.

Kristmann, "Occluder frequency analysis for evaluating the level of visibility of partly occluded objects", TU Wien
2022, section 4.1.3: the interval of the level of visibility (LV, 1 covered to -1 free) is mapped linearly to the range
of levels, and cut off toward the coarser one: his LV of 641 / 1024 is tessellation level 4 of 20 here, too.

That rule (`rule="linear"`) knows nothing of how large a drawable is: behind the leaf of a plant the nearest bunny is as
coarse as the farthest. `rule="combined"` lets LV widen the limit of the screen-space error instead: ε · (1 - LV) / 2 ≤
τ, with the part of the detail that is let through as a factor, as Charalambos et al. scale theirs by the visible part
of the pixels. Without occluders it is `lod_error`.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, LevelOfVisibility, parameter
from scenegraph.kernels.levels import mesh_level_within

from .selection import I64, LevelStage, held


class LodVisibility(LevelStage):
    """Draws what occluders leave little of at coarser levels."""

    name = "lod_visibility"
    reads = (LevelOfVisibility,)

    rule: Literal["linear", "combined"] = parameter(
        "linear", help="map visibility to levels; or let it widen the limit of the error on the screen"
    )
    pixels: float = parameter(
        1.0, minimum=0.0, maximum=1000.0, unit="px", help="combined: largest error of what is not covered"
    )
    hysteresis: float = parameter(
        0.2,
        minimum=0.0,
        maximum=0.95,
        help="a drawable keeps its level within this part of a level, or (combined) until a stricter limit asks too",
    )

    def choose(self, frame: Frame, rows: I64, before: NDArray[np.int16]) -> I64:
        """Look at what an earlier stage has put."""
        # what is unknown counts as free
        value = np.nan_to_num(frame.get(LevelOfVisibility).values[rows].astype(np.float64), nan=-1.0)
        covered = (np.clip(value, -1.0, 1.0) + 1) / 2
        frame.count(covered=float(covered.sum()))
        if self.rule == "combined":
            seen = self.seen_errors(frame, rows)
            with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
                limit = (self.pixels / (1 - covered)).astype(np.float32)
            coarsest = mesh_level_within(seen, limit)
            return held(before, mesh_level_within(seen, limit * np.float32(1 - self.hysteresis)), coarsest)
        scaled = covered * (frame.snapshot.level_count[rows].astype(np.float64) - 1)
        finest = np.maximum(np.ceil(scaled - self.hysteresis), 0)
        return held(before, finest.astype(np.int64), np.ceil(scaled).astype(np.int64))
