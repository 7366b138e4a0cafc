"""Moving a view: steps, turns of the head, and feet on the ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..scenes.ground import Ground, find_ground
from ..scenes.paths import upright_axes
from ..snapshot import Snapshot
from ..view import View

#: Depth buffers tell near things apart while far:near is below this.
_DEPTH_RATIO = 2e5


class Walker:
    """Where one can stand in a scene, and how far one can see.

    Parameters
    ----------
    snapshot : Snapshot

    Attributes
    ----------
    pace : float
        World units of one step.
    ground : Ground or None
    """

    def __init__(self, snapshot: Snapshot) -> None:
        boxes = snapshot.boxes[:, np.isfinite(snapshot.boxes).all(axis=0)]
        if boxes.shape[1]:
            self.low, self.high = (boxes[:3] - boxes[3:]).min(axis=1), (boxes[:3] + boxes[3:]).max(axis=1)
        else:
            self.low, self.high = np.zeros(3), np.ones(3)
        self.size = float(np.linalg.norm(self.high - self.low)) or 1.0
        self.axes = upright_axes(snapshot.scene.up)
        self.ground: Ground | None = find_ground(snapshot, snapshot.scene.up)
        self.pace = 0.6 * self.ground.eye_height if self.ground is not None else self.size / 200

    def step(self, view: View, forward: float = 0.0, right: float = 0.0, up: float = 0.0) -> View:
        """Move by so many paces; level while there is a ground, along the line of sight without."""
        ahead = view.forward
        side = np.cross(ahead, self.axes[2])
        if self.ground is not None:
            level = ahead - self.axes[2] * (ahead @ self.axes[2])
            if np.linalg.norm(level) > 1e-6:
                ahead = level / np.linalg.norm(level)
        if np.linalg.norm(side) < 1e-6:
            side = view.axes[0]
        way = self.pace * (forward * ahead + right * side / np.linalg.norm(side) + up * self.axes[2])
        return self.fitted(view.moved(eye=np.add(view.eye, way), target=np.add(view.target, way)))

    def turn(self, view: View, left: float = 0.0, up: float = 0.0) -> View:
        """Turn the head by degrees; it never turns over."""
        ahead = self.axes @ view.forward
        yaw = np.arctan2(ahead[1], ahead[0]) + np.radians(left)
        pitch = np.arcsin(np.clip(ahead[2], -1, 1)) + np.radians(up)
        pitch = float(np.clip(pitch, -1.54, 1.54))
        ahead = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)]) @ self.axes
        reach = float(np.linalg.norm(np.subtract(view.target, view.eye)))
        return replace(view, target=tuple(np.add(view.eye, reach * ahead).tolist()), up=tuple(self.axes[2].tolist()))

    def fitted(self, view: View) -> View:
        """The view with clipping planes around the whole scene, as near to the eye as the depth buffer allows."""
        eye: NDArray[np.float64] = np.asarray(view.eye)
        gap = np.maximum(np.maximum(self.low - eye, eye - self.high), 0.0)
        outside = float(np.linalg.norm(gap))
        far = (
            float(np.linalg.norm(np.maximum(np.abs(self.low - eye), np.abs(self.high - eye)))) * 1.01 + 1e-6 * self.size
        )
        close = 0.1 * self.ground.eye_height if self.ground is not None else 1e-3 * self.size
        near = max(min(close, far / 2), far / _DEPTH_RATIO, 0.5 * outside)
        return replace(view, near=near, far=far)
