"""Camera paths: walk along a line, orbit around bounds, enter them; and paths for scenes that came without any."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..view import View

if TYPE_CHECKING:
    from ..scene import Scene
    from ..snapshot import Snapshot

Floats = NDArray[np.float64]

#: Meters between the points at which a walk is computed, relative to the eye's height.
STEP = 0.15


@dataclass(frozen=True)
class Moment:
    """A place where a walk slows down and looks at something.

    Attributes
    ----------
    name : str
    at : 3 floats
        Where on the path; the nearest point of it counts.
    target : 3 floats
        What is looked at from there.
    reach : float
        Distance along the path, in world units, over which the head turns there and back.
    """

    name: str
    at: tuple[float, float, float]
    target: tuple[float, float, float]
    reach: float = 8.0


def upright_axes(up: ArrayLike) -> Floats:
    """(3, 3) right-handed rows: two horizontal directions and up; the identity if up is z."""
    z = np.asarray(up, np.float64)
    z = z / np.linalg.norm(z)
    x = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    x = x - z * (x @ z)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(z, x), z])


def _blur(values: Floats, sigma: float) -> Floats:
    """Gaussian mean over the rows; beyond the ends the series is continued by point reflection, so that they stay."""
    if sigma < 0.5 or len(values) < 3:
        return values
    half = min(int(3 * sigma), len(values) - 1)
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    kernel /= kernel.sum()
    before, after = 2 * values[0] - values[half:0:-1], 2 * values[-1] - values[-2 : -half - 2 : -1]
    longer = np.concatenate([before, values, after])
    return np.stack([np.convolve(c, kernel, "valid") for c in longer.T], axis=1)


def _resampled(points: Floats, step: float) -> Floats:
    leg = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.concatenate([[True], leg > 0])]
    along = np.concatenate([[0.0], np.cumsum(leg[leg > 0])])
    at = np.linspace(0.0, along[-1], max(int(along[-1] / step), 2) + 1)
    return np.stack([np.interp(at, along, c) for c in points.T], axis=1)


def walk(
    points: ArrayLike,
    *,
    count: int = 64,
    eye_height: float = 1.7,
    swing: float = 25.0,
    rounding: float = 3.0,
    moments: Sequence[Moment] = (),
    up: ArrayLike = (0.0, 0.0, 1.0),
    fov: float = 60.0,
    near: float = 0.2,
    far: float = 5000.0,
) -> list[View]:
    """Walk along a line of footsteps, turning smoothly at its corners and swinging the head.

    Parameters
    ----------
    points : (k, 3) float
        Corners of the line, on the ground.
    count : int
        Number of views, evenly spaced except around moments, where the walk is three times slower.
    eye_height : float
        Above the line, along `up`.
    swing : float
        How far the head turns to either side of the direction of travel, in degrees.
    rounding : float
        Corners are rounded off over this distance, in eye heights.
    moments : sequence of Moment
    up, fov, near, far
        As for `View`.

    Returns
    -------
    list of View
    """
    axes = upright_axes(up)
    line = _resampled(np.asarray(points, np.float64), STEP * eye_height)
    feet = _blur(line, 0.5 * rounding / STEP)
    tangent = _blur(np.gradient(feet, axis=0), rounding / STEP) @ axes.T
    heading = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
    eyes = feet + eye_height * axes[2]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(feet, axis=0), axis=1))])

    slow, looks = np.ones(len(along)), []
    for moment in moments:
        place = along[np.argmin(np.linalg.norm(feet - moment.at, axis=1))]
        near_it = np.exp(-0.5 * ((along - place) / (0.4 * moment.reach)) ** 2)
        slow += 2.0 * near_it
        looks.append((near_it, np.asarray(moment.target, np.float64)))
    clock = np.concatenate([[0.0], np.cumsum(0.5 * (slow[1:] + slow[:-1]) * np.diff(along))])
    at = np.interp(np.linspace(0.0, clock[-1], count), clock, along)

    views = []
    for k, s in enumerate(at):
        eye = np.array([np.interp(s, along, c) for c in eyes.T])
        yaw = np.interp(s, along, heading) + np.radians(swing) * np.sin(2 * np.pi * k / 13)
        pitch = np.radians(4.0) * np.sin(2 * np.pi * k / 9)
        direction = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)]) @ axes
        for nearness, target in looks:
            weight = np.interp(s, along, nearness)
            wanted = (target - eye) / np.linalg.norm(target - eye)
            direction = (1 - weight) * direction + weight * wanted
        direction /= np.linalg.norm(direction)
        views.append(View(eye, eye + 10 * eye_height * direction, axes[2], fov=fov, near=near, far=far))
    return views


def closest(views: Sequence[View], at: ArrayLike) -> View:
    """The view whose eye is nearest to a point."""
    distance = np.linalg.norm(np.array([v.eye for v in views]) - np.asarray(at, np.float64), axis=1)
    return views[int(np.argmin(distance))]


def distance_to_line(points: Floats, line: ArrayLike) -> Floats:
    """(k,) distance of points (k, d) from a polyline (m, d)."""
    corners = np.asarray(line, np.float64)
    leg = np.diff(corners, axis=0)
    to = points[:, None] - corners[:-1]
    share = np.clip((to * leg).sum(axis=2) / (leg**2).sum(axis=1), 0.0, 1.0)
    return np.asarray(np.linalg.norm(to - share[..., None] * leg, axis=2).min(axis=1, initial=np.inf))


def _sphere(bounds: ArrayLike) -> tuple[Floats, float]:
    low, high = np.asarray(bounds, np.float64)
    # a scene that is a single point is still looked at from somewhere
    return (low + high) / 2, float(np.linalg.norm(high - low)) / 2 or 1.0


def orbit(
    bounds: ArrayLike,
    *,
    count: int = 48,
    elevation: float = 25.0,
    margin: float = 1.05,
    fov: float = 50.0,
    up: ArrayLike = (0.0, 0.0, 1.0),
) -> list[View]:
    """Circle around bounds (2, 3), looking at their center.

    Parameters
    ----------
    elevation : float
        Degrees above the horizon.
    margin : float
        At 1 the bounds just fit into every view; below 1 the eye is that much nearer.
    """
    center, radius = _sphere(bounds)
    axes, half = upright_axes(up), np.diff(np.asarray(bounds, np.float64), axis=0)[0] / 2
    signs = np.stack(np.meshgrid(*[(-1, 1)] * 3), axis=-1).reshape(-1, 3)
    angle, rise = 2 * np.pi * np.arange(count) / count, np.radians(elevation)
    level = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(count)]) @ axes
    outward = np.cos(rise) * level + np.sin(rise) * axes[2]
    views = [View(center + o, center, axes[2], fov=fov) for o in outward]
    distance = 0.0
    for view in views:
        right, over, back = (signs * half @ view.axes.T).T
        _, wide, _, high = view.window
        distance = max(distance, float((np.maximum(np.abs(right) / wide, np.abs(over) / high) + back).max()))
    # a scene without extent is still looked at from somewhere
    distance = margin * (distance or radius)
    near, far = max(distance - 1.1 * radius, 0.01 * distance), distance + 1.5 * radius
    return [View(center + distance * o, center, axes[2], fov=fov, near=near, far=far) for o in outward]


def enter(
    bounds: ArrayLike,
    *,
    count: int = 24,
    margin: float = 2.0,
    fov: float = 60.0,
    up: ArrayLike = (0.0, 0.0, 1.0),
) -> list[View]:
    """Fly from outside bounds (2, 3) to their center along a horizontal axis, glancing about.

    Parameters
    ----------
    margin : float
        The first eye lies this many half sizes of the bounds from the center.
    """
    center, radius = _sphere(bounds)
    axes = upright_axes(up)
    low, high = np.asarray(bounds, np.float64)
    start = margin * float(np.abs(axes[0]) @ (high - low)) / 2
    views = []
    for k in range(count):
        t = (k + 1) / count
        eye = center + (1 - t) * start * axes[0]
        glance = np.array([-1.0, 0.25 * np.sin(6 * t), 0.1 * np.sin(9 * t)]) @ axes
        far = 2 * (margin + 1) * radius
        views.append(View(eye, eye + radius * glance, axes[2], fov=fov, near=1e-3 * radius, far=far))
    return views


def default_paths(scene: Scene, snapshot: Snapshot | None = None) -> dict[str, list[View]]:
    """Camera paths for a scene that has none.

    Parameters
    ----------
    scene : Scene
    snapshot : Snapshot, optional
        Of the same scene, to save making one.

    Returns
    -------
    dict
        "orbit", if anything in the scene has finite bounds; and "walk", at eye height through what is free, if the
        scene has a ground: a large, nearly level surface low in it, with things standing on it.
    """
    from .ground import find_ground

    snapshot = snapshot or scene.snapshot()
    boxes = snapshot.boxes[:, np.isfinite(snapshot.boxes).all(axis=0)]
    if not boxes.shape[1]:
        return {}
    bounds = np.array([(boxes[:3] - boxes[3:]).min(axis=1), (boxes[:3] + boxes[3:]).max(axis=1)])
    paths = {"orbit": orbit(bounds, up=scene.up)}
    ground = find_ground(snapshot, scene.up)
    route = None if ground is None else ground.route()
    if ground is not None and route is not None:
        far = 2.0 * float(np.linalg.norm(bounds[1] - bounds[0]))
        paths["walk"] = walk(route, eye_height=ground.eye_height, up=scene.up, near=0.1 * ground.eye_height, far=far)
    return paths
