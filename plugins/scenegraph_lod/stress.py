"""Levels under stress: a limit of the error that gives way when frames take too long.

The stress filter of SGI's Performer: the load is the time of the last frame over the time that it may take. Within a
band of loads nothing changes; above it the stress grows by `gain` times the load, up to a cap; below it falls, down to
none. The views of a group share the largest stress of all. Objects that are large on the screen are protected: they are
drawn as without stress.

What we changed:

* Performer scales switch ranges by the stress, where this doubles the limit of the screen-space error for each unit of
  it, so that equal steps of stress are equal steps of what one sees, whatever the limit is.
* Below the band, Performer's stress falls by `gain` times the load: the less there is to draw, the longer it stays
  coarse. Here it falls by `gain`.

A filter of measured times cannot be repeated. For a run that can be, `clock="triangles"` takes the time of a frame to
be proportional to its triangles.
"""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame, PipelineError, parameter
from scenegraph.kernels.levels import mesh_level_within

from .selection import I64, LevelStage, held


class LodStress(LevelStage):
    """Draws coarser levels as long as frames take too long."""

    name = "lod_stress"

    milliseconds: float = parameter(
        16.0, minimum=0.01, maximum=10_000.0, unit="ms", help="time that culling and drawing a frame may take"
    )
    pixels: float = parameter(1.0, minimum=0.0, maximum=1000.0, unit="px", help="largest error without stress")
    low: float = parameter(0.8, minimum=0.0, maximum=10.0, help="load below which stress falls")
    high: float = parameter(1.0, minimum=0.0, maximum=10.0, help="load above which stress grows")
    gain: float = parameter(0.25, minimum=0.0, maximum=10.0, help="growth of stress per load, and fall in a frame")
    most: float = parameter(8.0, minimum=0.0, maximum=30.0, help="cap of the stress; each unit doubles the error")
    protect: float = parameter(
        400.0, minimum=0.0, maximum=100_000.0, unit="px", help="drawables with a larger image are not stressed"
    )
    group: bool = parameter(False, help="views share the largest stress of all")
    clock: Literal["measured", "triangles"] = parameter(
        "measured", help="where the time comes from: the clock, or the number of triangles"
    )
    nanoseconds: float = parameter(
        10.0, minimum=0.0, maximum=1e6, unit="ns", help="time of a triangle, for clock=triangles"
    )
    hysteresis: float = parameter(
        0.2, minimum=0.0, maximum=0.95, help="a drawable keeps its level until a limit smaller by this share asks too"
    )

    def __init__(self, **values: Any) -> None:
        super().__init__(**values)
        self._stress: dict[str, float] = {}
        if self.low > self.high:
            raise PipelineError([f"stage 'lod_stress': low={self.low:g} is above high={self.high:g}"])

    def started(self, *, fresh: bool) -> None:
        """Calm down."""
        if fresh:
            self._stress.clear()

    def choose(self, frame: Frame, rows: I64, before: NDArray[np.int16]) -> I64:
        """Update the stress by the frame before, and compare errors with what it allows."""
        stress = self.stress(frame)
        seen = self.seen_errors(frame, rows)
        limit = np.full(len(rows), self.pixels * 2.0**stress)
        if stress:
            large = frame.view.box_pixels(frame.snapshot.boxes[:, rows]) > self.protect
            limit[large] = self.pixels
            frame.count(protected=int(large.sum()))
        limits = limit.astype(np.float32)
        coarsest = mesh_level_within(seen, limits)
        return held(before, mesh_level_within(seen, limits * np.float32(1 - self.hysteresis)), coarsest)

    def stress(self, frame: Frame) -> float:
        """Work the stress of a view out from the frame before; once per frame."""
        stress, load = self._stress.get(frame.view_name, 0.0), self.load(frame)
        if load is not None:
            if load > self.high:
                stress = min(stress + self.gain * load, self.most)
            elif load < self.low:
                stress = max(stress - self.gain, 0.0)
            frame.count(load=load)
        self._stress[frame.view_name] = stress
        if self.group:
            stress = max(self._stress.values())
        frame.count(stress=stress)
        return stress

    def load(self, frame: Frame) -> float | None:
        """Time of the frame before over what it may take; None if nobody has told it."""
        if frame.previous is None:
            return None
        record = frame.previous.record
        if self.clock == "triangles":
            return record.triangles * self.nanoseconds * 1e-6 / self.milliseconds
        return None if record.draw_ms is None else (record.cull_ms + record.draw_ms) / self.milliseconds
