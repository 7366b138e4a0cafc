"""Which drawable is under a pixel: the nearest triangle that the line of sight through it meets."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..frame import Frame

F64 = NDArray[np.float64]


def row_at(frame: Frame, x: float, y: float) -> int | None:
    """The visible row that is drawn at a point of the picture, or None.

    Parameters
    ----------
    frame : Frame
    x, y : float
        Pixels of `frame.view` from the lower left corner.
    """
    view, snapshot = frame.view, frame.snapshot
    left, right, bottom, top = view.window
    across, up = left + (right - left) * x / view.width, bottom + (top - bottom) * y / view.height
    eye = np.asarray(view.eye)
    if view.is_parallel:
        eye, way = eye + across * view.axes[0] + up * view.axes[1], view.forward
    else:
        way = across * view.axes[0] + up * view.axes[1] + view.forward
    rows = frame.candidates()
    entry = _entries(snapshot.boxes[:, rows], eye, way)
    best: tuple[float, int | None] = (np.inf, None)
    for position in np.argsort(entry, kind="stable").tolist():
        if not entry[position] < best[0]:
            break
        row = int(rows[position])
        mesh = snapshot.meshes[snapshot.level_meshes[row, frame.level[row]]]
        matrix = snapshot.transforms[snapshot.transform_index[row]]
        points = mesh.vertices @ matrix[:3, :3].T + (matrix[:3, 3] - eye)
        depth = _first_hit(points[mesh.faces], way)
        if depth < best[0]:
            best = depth, row
    return best[1]


def _entries(boxes: F64, eye: F64, way: F64) -> F64:
    """(k,) how far along the line it enters each box, in lengths of `way`; infinite where it does not."""
    with np.errstate(invalid="ignore", over="ignore"):
        # 0 times infinity would be no number
        inverse = 1.0 / np.where(way == 0, 1e-200, way)[:, None]
        middle, half = (boxes[:3] - eye[:, None]) * inverse, boxes[3:] * np.abs(inverse)
        near, far = (middle - half).max(axis=0), (middle + half).min(axis=0)
    return np.where((near <= far) & (far > 0), np.maximum(near, 0.0), np.inf)


def _first_hit(triangles: F64, way: F64) -> float:
    """How far along the line from the origin the first of (m, 3, 3) triangles is met; infinite if none (Möller)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    across = np.cross(np.broadcast_to(way, a.shape), c - a)
    size = ((b - a) * across).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = -(a * across).sum(axis=1) / size
        turned = np.cross(-a, b - a)
        v = (turned @ way) / size
        depth = ((c - a) * turned).sum(axis=1) / size
        met = (u >= 0) & (v >= 0) & (u + v <= 1) & (depth > 0)
    return float(depth[met].min(initial=np.inf))
