"""Levels by screen-space error: the coarsest level that lies within some pixels of the finest.

ε = λ · (pixels per world unit at the nearest point of the drawable) ≤ τ, with λ the model error of a level: the classic
rule of Lindstrom et al. (1996) and of Funkhouser and Séquin's static selection. λ is not an estimate here: it is a
bound on the distance of the two surfaces (see `scenegraph.meshes.level_chain`), so τ bounds how far any point of the
image moves, across the line of sight.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, parameter
from scenegraph.kernels.levels import mesh_level_within

from .selection import I64, LevelStage, held


class LodError(LevelStage):
    """Draws the coarsest level that lies within so many pixels of the finest."""

    name = "lod_error"

    pixels: float = parameter(1.0, minimum=0.0, maximum=1000.0, unit="px", help="largest error on the screen")
    hysteresis: float = parameter(
        0.2, minimum=0.0, maximum=0.95, help="a drawable keeps its level until a limit smaller by this share asks too"
    )

    def choose(self, frame: Frame, rows: I64, before: NDArray[np.int16]) -> I64:
        """Compare errors with the limit, and with a stricter one."""
        seen = self.seen_errors(frame, rows)
        limit = np.full(len(rows), self.pixels, np.float32)
        coarsest = mesh_level_within(seen, limit)
        return held(before, mesh_level_within(seen, limit * np.float32(1 - self.hysteresis)), coarsest)
