"""The occlusion map by OpenGL: the depth of occluders, drawn into a small frame buffer and read back.

A rasterizer says whether something covers the center of a texel. Holes between centers are lost, and the depth is that
of the center, so nothing that is decided from this map is proven; strict coverage here asks that the eight neighbors
are covered too and takes the farthest of the nine depths.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from scenegraph import Frame
from scenegraph.kernels.nearness import NearnessScale, nearness_codes, nearness_of

from .scan import Drawn
from .shapes import F64, I64

#: Steps of a 24-bit depth buffer by which depths are pushed back.
STEPS = 2.0


def gl_map(
    frame: Frame, rows: I64, /, *, size: tuple[int, int], scale: NearnessScale, strict: bool, coarsest: bool
) -> Drawn:
    """Draw drawables into a map of nearness codes.

    Parameters
    ----------
    frame : Frame
        With a device.
    rows : (k,) int64
        Drawables.
    size : width, height of the map
    scale : NearnessScale
    strict : bool
        A texel is closed only if its neighbors are covered as well.
    coarsest : bool
        Draw the coarsest level instead of the finest.
    """
    snapshot, view, device = frame.snapshot, frame.view, frame.device
    chosen = np.zeros(snapshot.n, bool)
    chosen[rows] = True
    level = snapshot.level_count - np.uint8(1) if coarsest else None
    with device.guard():
        target = device.depth_target(*size)
        device.draw_depth(target, view, snapshot, chosen, level)
        window_depth: F64 = target.read().astype(np.float64)
    if strict:
        window_depth = _farthest_neighbor(window_depth)
    codes = np.zeros(window_depth.shape, np.uint16)
    closed = window_depth < 1.0
    pushed = np.minimum(window_depth[closed] + STEPS / 2**24, 1.0)
    codes[closed] = nearness_codes(
        nearness_of(_eye_depth(pushed, view.near, view.far, view.is_parallel), parallel=view.is_parallel), scale
    )
    none = np.zeros(0, np.int64)
    return Drawn(codes, none, none, none, none, np.zeros(0, np.uint16))


def _farthest_neighbor(depth: F64) -> F64:
    """Greatest value of each texel and its eight neighbors; beyond the border there is nothing to see."""
    wide = np.pad(depth, 1, mode="edge")
    rows = np.maximum(np.maximum(wide[:-2], wide[1:-1]), wide[2:])
    return np.asarray(np.maximum(np.maximum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:]))


def _eye_depth(window_depth: NDArray[np.float64], near: float, far: float, parallel: bool) -> F64:
    """Distance along the line of sight of depths in window coordinates, 0 near to 1 far."""
    if parallel:
        return near + window_depth * (far - near)
    return near * far / (far - window_depth * (far - near))
