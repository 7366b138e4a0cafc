"""Views from anywhere in a scene, in any number: what no camera path would show, for judging more than for looking."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..view import View
from .ground import Ground, find_ground
from .paths import upright_axes

if TYPE_CHECKING:
    from ..snapshot import Snapshot

#: A drawable longer than this share of the scene is a ground or a room: an eye may be inside its box.
_ROOM = 0.3
#: So many places are tried for each view before one inside a box is taken.
_TRIES = 64

Floats = NDArray[np.float64]


def anywhere(snapshot: Snapshot, count: int, *, seed: int = 0, up: ArrayLike = (0.0, 0.0, 1.0)) -> list[View]:
    """Random views from within a scene, outside of boxes where there is room; one in eight is a parallel view.

    Where the scene has a ground, eyes are above it, most of them low: what is below a ground is not made to be looked
    at, and hills are hollow. The first views are the same whatever the count.

    Parameters
    ----------
    snapshot : Snapshot
        Drawables without a finite box do not count.
    count : int
    seed : int
    up : 3 floats

    Returns
    -------
    list of View
        Empty if nothing has a finite box.
    """
    known = np.isfinite(snapshot.boxes).all(axis=0)
    if not known.any():
        return []
    boxes = snapshot.boxes[:, known]
    low, high = (boxes[:3] - boxes[3:]).min(axis=1), (boxes[:3] + boxes[3:]).max(axis=1)
    size = float(np.linalg.norm(high - low)) or 1.0
    solid = boxes[:, np.linalg.norm(boxes[3:], axis=0) * 2 < _ROOM * size]
    axes, ground = upright_axes(up), find_ground(snapshot, up)
    rise = float(np.abs(axes[2]) @ (high - low))
    views = []
    for k in range(count):
        rng = np.random.default_rng((seed, k))
        eyes = _above(ground, rise, rng) if ground is not None else low + (high - low) * rng.random((_TRIES, 3))
        gap = np.abs(eyes[:, :, None] - solid[:3]) - solid[3:]
        free = (gap.max(axis=1) > 1e-4 * size).all(axis=1)
        views.append(_glance(eyes[int(np.argmax(free))], axes, size, rng, rise if ground is not None else None))
    return views


def _above(ground: Ground, rise: float, rng: np.random.Generator) -> Floats:
    """(tries, 3) places over free cells of the ground, up to the height of the scene."""
    cells = np.argwhere(ground.free & np.isfinite(ground.height))
    if not len(cells):
        cells = np.argwhere(np.isfinite(ground.height))
    cells = cells[rng.integers(len(cells), size=_TRIES)]
    above = 0.3 * ground.eye_height + rise * rng.random(_TRIES) ** 3
    local = np.column_stack([(cells + rng.random((_TRIES, 2))) * ground.cell, ground.height[tuple(cells.T)] + above])
    return np.asarray(ground.origin + local @ ground.axes)


def _glance(eye: Floats, axes: Floats, size: float, rng: np.random.Generator, rise: float | None) -> View:
    """A view in any direction; a parallel one, where there is a ground, down from above all of it."""
    turn, tilt = rng.uniform(0, 2 * np.pi), rng.normal(0, 0.25)
    scale = float(rng.uniform(0.02, 0.3)) * size if rng.random() < 0.125 else None
    if scale is not None and rise is not None:
        # its lines of sight start all over the near plane, which must not reach below the ground
        eye, tilt = eye + (rise + scale) * axes[2], -0.2 - abs(tilt)
    forward = np.array([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)]) @ axes
    fov = float(rng.uniform(25, 100))
    return View(eye, eye + forward, axes[2], fov=fov, near=1e-4 * size, far=2 * size, parallel_scale=scale)
