"""The two scenes of Kristmann 2022: 5 001 bunnies packed densely, and 10 001 of random size, sparsely.

The thesis copies a bunny of 98 triangles to random places in a cube, turns each about the x axis, and lets Phong
tessellation make up to 600 triangles of each of the 98 (sections 4.1.3 and 4.2). Here each copy has one level of detail
per tessellation level, all copies share the meshes, and `ceiling` is the finest level there is: at 20, the thesis', the
scenes have 294 058 800 and 588 058 800 triangles, which can be counted anywhere and drawn by few. The thesis does not
print the sizes of its cubes; what we took is what gives its figures' share of hidden bunnies. A corridor along the
flight is kept free, so that the camera is never inside a bunny.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import SceneError
from ..mesh import Mesh
from ..meshes import tessellation_chain
from ..nodes import Lod, Node, Transform
from ..scene import Scene
from ..view import View
from .rabbit import bunny
from .scatter import BACKGROUND, in_cells
from .shapes import Floats

#: Largest tessellation level of the thesis.
FINEST = 20
#: Clear radius around the eye on its flight.
CLEAR = 1.6


def dense(*, model: str = "", ceiling: int = 2, count: int = 5001, spacing: float = 1.6, seed: int = 1) -> Scene:
    """5001 tessellated bunnies packed in a cube, seen from around and from within (Kristmann 2022).

    Parameters
    ----------
    model : str
        A model file, reduced to 98 triangles; a stand-in if empty.
    ceiling : int
        Finest tessellation level, 1 to 20.
    count : int
        At least 1.
    spacing : float
        Edge of the cube that one bunny has to itself on average; bunnies are 2 across.
    seed : int

    Returns
    -------
    Scene
        With the paths "orbit", around the cube, and "enter", from there to its middle.
    """
    _check(ceiling, count, spacing)
    rng = np.random.default_rng(seed)
    edge = spacing * count ** (1 / 3)

    def from_flight(p: Floats) -> Floats:
        return np.where(p[:, 0] > 0, np.hypot(p[:, 1], p[:, 2]), np.linalg.norm(p, axis=1))

    place = _scattered(rng, edge, np.ones(count), from_flight)
    scene = _copies("bunnies-5001", model, ceiling, place, np.ones(count), rng, 4 * spacing)
    radius = _entry(edge)
    far = radius + edge
    views = []
    for turn in 2 * np.pi * (np.arange(100) + 1) / 100:
        eye = radius * np.array([np.cos(turn), np.sin(turn), 0.0])
        views.append(View(eye, (0, 0, 0), fov=45.0, near=0.1, far=far))
    enter = []
    for t in (np.arange(50) + 1) / 50:
        eye = np.array([radius * (1 - _eased(t)), 0.0, 0.0])
        enter.append(View(eye, eye - (1.0, 0.0, 0.0), fov=45.0, near=0.1, far=far))
    scene.paths = {"orbit": views, "enter": enter}
    return scene


def sparse(*, model: str = "", ceiling: int = 2, count: int = 10001, spacing: float = 5.0, seed: int = 1) -> Scene:
    """10001 tessellated bunnies of random size in a large cube, seen from outside and on a circle (Kristmann 2022).

    Parameters
    ----------
    model : str
        A model file, reduced to 98 triangles; a stand-in if empty.
    ceiling : int
        Finest tessellation level, 1 to 20.
    count : int
        At least 1.
    spacing : float
        Edge of the cube that one bunny has to itself on average; bunnies are 1 to 3 across.
    seed : int

    Returns
    -------
    Scene
        With the paths "approach", from outside into the cube, and "inside", along a circle there.
    """
    _check(ceiling, count, spacing)
    rng = np.random.default_rng(seed)
    edge = spacing * count ** (1 / 3)
    size = rng.uniform(0.5, 1.5, count)
    inner = 0.28 * edge

    def from_flight(p: Floats) -> Floats:
        off_ring = np.hypot(np.hypot(p[:, 0], p[:, 1]) - inner, p[:, 2])
        off_line = np.where(p[:, 0] > inner, np.hypot(p[:, 1], p[:, 2]), np.inf)
        return np.asarray(np.minimum(off_ring, off_line))

    place = _scattered(rng, edge, size, from_flight)
    scene = _copies("bunnies-10001", model, ceiling, place, size, rng, 4 * spacing)
    start = 0.5 * edge * (1 + 1.05 / np.tan(np.radians(30.0)))
    far = start + edge
    approach, inside = [], []
    for t in (np.arange(60) + 1) / 60:
        eye = np.array([start + (inner - start) * _eased(t), 0.0, 0.0])
        approach.append(View(eye, eye - (1.0, 0.0, 0.0), fov=60.0, near=0.1, far=far))
    for k, turn in enumerate(2 * np.pi * (np.arange(90) + 1) / 90):
        eye = inner * np.array([np.cos(turn), np.sin(turn), 0.0])
        # the head turns from the middle to the way ahead within the first views
        look = turn + np.pi - 0.5 * np.pi * _eased(min((k + 1) / 20, 1.0))
        inside.append(View(eye, eye + (np.cos(look), np.sin(look), 0.0), fov=60.0, near=0.1, far=far))
    scene.paths = {"approach": approach, "inside": inside}
    return scene


def tessellated(model: str, ceiling: int) -> tuple[list[Mesh], list[float]]:
    """Levels of detail of a bunny, finest first, and their errors: tessellation levels `ceiling` to 1."""
    levels, errors = zip(*tessellation_chain(bunny(model), ceiling), strict=True)
    return list(levels), list(errors)


def _check(ceiling: int, count: int, spacing: float) -> None:
    if not 1 <= ceiling <= FINEST:
        raise SceneError(f"bunnies: ceiling={ceiling}; tessellation levels are 1 to {FINEST}")
    if count < 1:
        raise SceneError(f"bunnies: count={count}; it must be at least 1")
    if not (np.isfinite(spacing) and spacing > 0):
        raise SceneError(f"bunnies: spacing={spacing}; it must be positive")


def _entry(edge: float) -> float:
    """How far from the middle the camera circles: all of a cube turned any way is in a view of 45 degrees."""
    return float(0.5 * edge * (np.sqrt(2.0) + 1.05 / np.tan(np.radians(22.5))))


def _eased(t: float) -> float:
    """0 to 1 with a standing start and end."""
    return t * t * (3 - 2 * t)


def _scattered(rng: np.random.Generator, edge: float, size: Floats, from_flight: Callable[[Floats], Floats]) -> Floats:
    """(k, 3) random places in a cube around the origin that leave the flight free."""
    place = rng.uniform(-edge / 2, edge / 2, (len(size), 3))
    while (blocked := from_flight(place) < size + CLEAR - 1.0).any():
        place[blocked] = rng.uniform(-edge / 2, edge / 2, (int(blocked.sum()), 3))
    return place


def _copies(
    name: str, model: str, ceiling: int, place: Floats, size: Floats, rng: np.random.Generator, width: float
) -> Scene:
    """A scene of bunnies at places (k, 3), of sizes (k,), each turned about the x axis, with all levels of detail."""
    levels, errors = tessellated(model, ceiling)
    turn = rng.uniform(0, 2 * np.pi, len(place))
    matrices = np.tile(np.eye(4), (len(place), 1, 1))
    matrices[:, 0, 0] = size
    matrices[:, 1, 1] = matrices[:, 2, 2] = size * np.cos(turn)
    matrices[:, 2, 1] = size * np.sin(turn)
    matrices[:, 1, 2] = -matrices[:, 2, 1]
    matrices[:, :3, 3] = place
    nodes: list[Node] = [
        Transform(Lod(*levels, errors=errors, name=f"bunny {k}"), matrix=m) for k, m in enumerate(matrices)
    ]
    scene = Scene(name=name, background=BACKGROUND)
    return scene.add(*in_cells(nodes, place - place.min(axis=0), width))
