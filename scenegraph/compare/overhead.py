"""A look from above: where the camera stands, what it can see, and what was hidden."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from scenegraph.compare.lighter import lighter
from scenegraph.compare.metrics import Image, Rows
from scenegraph.compare.results import Pictures
from scenegraph.snapshot import Snapshot
from scenegraph.view import View

#: As high as two frames of 16:9 beside it on the page.
WIDTH, HEIGHT = 1200, 856
PAPER, WIRE = (0.955, 0.955, 0.945), (0.20, 0.42, 0.90)
#: Triangles in the picture. Of more, wires would run together.
SOLID, WIRES = 1_500_000, 150_000
_ELEVATION = np.radians(52.0)


class Overhead:
    """A camera above a scene, for pictures of what each pipeline drew.

    Parameters
    ----------
    snapshot : Snapshot
    pictures : Pictures
        Gets a picture per pipeline.
    """

    def __init__(self, snapshot: Snapshot, pictures: Pictures) -> None:
        from scenegraph.render.drawing import Drawing
        from scenegraph.render.window import OffscreenWindow

        self._pictures = pictures
        solid, self._solid_rows = lighter(snapshot, SOLID)
        wires, self._wire_rows = lighter(snapshot, WIRES)
        bounds = telling_bounds(snapshot.boxes[:, ~snapshot.unknown])
        self._view = overhead_view(pictures.view, bounds, snapshot.scene.up, width=WIDTH, height=HEIGHT)
        pictures.overhead_view = self._view
        pictures.reach = float(((_corners(bounds) - pictures.view.eye) @ pictures.view.forward).max())
        self._window = OffscreenWindow(WIDTH, HEIGHT, PAPER, multisamples=4)
        self._wires: Any = Drawing(wires, self._window.renderer, mode="batches")
        for actor in self._window.renderer.GetActors():
            ink = actor.GetProperty()
            ink.SetRepresentationToWireframe()
            ink.LightingOff()
            ink.SetColor(*WIRE)
            ink.SetOpacity(0.4)
            actor.GetMapper().ScalarVisibilityOff()
        self._solid: Any = Drawing(solid, self._window.renderer, mode="batches")
        for actor in self._window.renderer.GetActors():
            # A sky or a ceiling faces those below; from above one should see through it.
            actor.GetProperty().BackfaceCullingOn()

    def __enter__(self) -> Overhead:
        return self

    def __exit__(self, *_: object) -> None:
        self._wires.remove()
        self._solid.remove()
        self._window.close()

    def photograph(self) -> None:
        """Take one picture per pipeline."""
        for name, shot in self._pictures.shots.items():
            self._pictures.overhead[name] = self._shoot(shot.kept)

    def _shoot(self, kept: Rows) -> Image:
        self._wires.show(~kept[self._wire_rows])
        self._solid.show(kept[self._solid_rows])
        self._window.draw(self._view)
        return np.asarray(self._window.image())


def telling_bounds(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bound what is worth seeing from above.

    A ground that reaches far beyond all else would shrink the rest to a spot. So where nine tenths of the drawables
    fill, with a margin, less than half of the whole, only they are bounded.

    Parameters
    ----------
    boxes : (6, k) float64
        Centers and half extents, finite.

    Returns
    -------
    (2, 3) float64
    """
    if not boxes.shape[1]:
        return np.array([[-1.0] * 3, [1.0] * 3])
    whole = np.array([(boxes[:3] - boxes[3:]).min(axis=1), (boxes[:3] + boxes[3:]).max(axis=1)])
    inner = np.quantile(boxes[:3], (0.05, 0.95), axis=1)
    margin = 0.2 * (inner[1] - inner[0]) + np.median(boxes[3:], axis=1)
    inner = np.array([np.maximum(inner[0] - margin, whole[0]), np.minimum(inner[1] + margin, whole[1])])
    return inner if 2 * np.linalg.norm(inner[1] - inner[0]) < np.linalg.norm(whole[1] - whole[0]) else whole


def overhead_view(
    view: View, bounds: NDArray[np.float64], up: tuple[float, float, float], *, width: int, height: int
) -> View:
    """Look down on a scene, slanted, in the direction in which the camera looks.

    Parameters
    ----------
    view : View
        The camera to look at; it is inside the picture.
    bounds : (2, 3) float64
        Lower and upper corner of what should be in the picture.
    up : 3 floats
    width, height : int
        Pixels of the picture.

    Returns
    -------
    View
        Orthographic, so that sizes can be compared across the picture.
    """
    vertical = np.asarray(up, float) / np.linalg.norm(up)
    ahead = view.forward - (view.forward @ vertical) * vertical
    if np.linalg.norm(ahead) < 1e-6:
        ahead = view.axes[1] - (view.axes[1] @ vertical) * vertical
    ahead /= np.linalg.norm(ahead)
    down = np.cos(_ELEVATION) * ahead - np.sin(_ELEVATION) * vertical
    points = np.vstack([_corners(bounds), [view.eye]])
    center = (points.min(0) + points.max(0)) / 2
    size = float(np.linalg.norm(points.max(0) - points.min(0))) or 1.0
    looking = View(
        eye=tuple(center - down * size),
        target=tuple(center),
        up=tuple(vertical),
        width=width,
        height=height,
        near=1e-3 * size,
        far=2.5 * size,
        parallel_scale=size,
    )
    flat = (points - center) @ looking.axes[:2].T
    middle, extent = (flat.max(0) + flat.min(0)) / 2, np.ptp(flat, axis=0)
    shift = middle @ looking.axes[:2]
    scale = 0.54 * max(extent[1], extent[0] * height / width)
    return dataclasses.replace(
        looking,
        eye=tuple(np.asarray(looking.eye) + shift),
        target=tuple(np.asarray(looking.target) + shift),
        parallel_scale=float(scale) or 1.0,
    )


def project(view: View, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 2) pixels, y down as in SVG, of (k, 3) world points seen by an orthographic view."""
    origin = np.asarray(view.target)
    clip = view.projection() @ view.view_matrix(origin) @ np.column_stack([points - origin, np.ones(len(points))]).T
    return np.column_stack([(clip[0] + 1) * view.width / 2, (1 - clip[1]) * view.height / 2])


def frustum_overlay(view: View, above: View, reach: float) -> str:
    """Draw a camera's frustum as SVG over the picture from above.

    Parameters
    ----------
    view : View
        The camera.
    above : View
        What the picture was taken with.
    reach : float
        How far the frustum is drawn, in world units; the scene ends before the far plane does.
    """
    far = min(view.far, max(reach, 2 * abs(view.near)))
    corners = project(above, view.corners(far=far))
    eye = project(above, np.array([view.eye]))[0]
    # The part before the near plane is cut off, but without it one does not see whose frustum it is.
    near, end = (corners[:4] if view.is_parallel else np.tile(eye, (4, 1))), corners[4:]
    try:
        outline = np.concatenate([near, end])
        outline = outline[ConvexHull(outline).vertices]
    except QhullError:  # seen exactly edge-on
        outline = end
    edges = " ".join(f"M{_at(a)}L{_at(b)}" for a, b in zip(near, end, strict=True))
    box = f'viewBox="0 0 {above.width} {above.height}" aria-hidden="true"'
    return (
        f'<svg class="cone" {box}><polygon points="{" ".join(map(_at, outline))}"/></svg>'
        f'<svg {box}><path d="{edges}M{_at(end[0])}L{_at(end[1])}L{_at(end[2])}L{_at(end[3])}Z"/>'
        f'<circle cx="{eye[0]:.1f}" cy="{eye[1]:.1f}" r="6"/></svg>'
    )


def _corners(bounds: NDArray[np.float64]) -> NDArray[np.float64]:
    pick = np.indices((2, 2, 2)).reshape(3, 8)
    return np.asarray(bounds)[pick, np.arange(3)[:, None]].T


def _at(point: NDArray[np.float64]) -> str:
    return f"{point[0]:.1f},{point[1]:.1f}"
