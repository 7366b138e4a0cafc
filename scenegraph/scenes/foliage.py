"""Two equal objects, one behind a wall with a large hole, one behind a tree with many small ones (Kristmann 2022).

Figure 3.1 of the thesis: as much can be seen of both, but fine details show through the large hole only. Wall and crown
of the tree are flat, and their holes have the same area and lie before the objects' trunks, so as many pixels of the
objects are visible.
"""

from __future__ import annotations

import numpy as np

from ..errors import SceneError
from ..mesh import Mesh
from ..nodes import Geode, Group, Lod, Transform
from ..scene import Scene
from ..view import View
from .bunnies import FINEST, tessellated
from .shapes import Floats

#: Half the distance of the two objects from each other, and how far before them their occluders stand.
BESIDE, BEFORE = 6.0, 2.5
#: Half sizes of the occluders, and of the square in which their holes lie; objects have radius 1.
PANEL, REGION = 1.6, 0.42
FLOOR = -2.3
GROUND, WALL, LEAVES, BARK = (0.62, 0.62, 0.58), (0.72, 0.52, 0.44), (0.36, 0.52, 0.30), (0.45, 0.36, 0.28)


def build(*, model: str = "", ceiling: int = 20, holes: int = 12, part: float = 0.35, seed: int = 1) -> Scene:
    """An object behind a tree with many small holes, and one behind a wall with a large hole of equal area.

    Parameters
    ----------
    model : str
        A model file, reduced to 98 triangles and tessellated again; a stand-in if empty.
    ceiling : int
        Finest tessellation level, 1 to 20.
    holes : int
        Of the tree, along each side of a square.
    part : float
        Of that square that is open, in the wall as in the tree; 0 < part < 0.9.
    seed : int

    Returns
    -------
    Scene
        With the views "wall" and "tree", and the paths of the same names, which begin farther away.
    """
    if not 1 <= ceiling <= FINEST:
        raise SceneError(f"foliage: ceiling={ceiling}; tessellation levels are 1 to {FINEST}")
    if not 1 <= holes <= 64:
        raise SceneError(f"foliage: holes={holes}; it must be 1 to 64")
    if not 0.0 < part < 0.9:
        raise SceneError(f"foliage: part={part}; it must be between 0 and 0.9")
    rng = np.random.default_rng(seed)
    levels, errors = tessellated(model, ceiling)
    scene = Scene(name="foliage")
    scene.add(Geode(Mesh.box((-14, -4, FLOOR - 0.1), (14, 4, FLOOR)), name="ground", color=GROUND))
    for name, side, count, color in (("wall", -BESIDE, 1, WALL), ("tree", BESIDE, holes, LEAVES)):
        # models have y up
        upright = Transform(Lod(*levels, errors=errors, name=f"object behind the {name}"), rotation=(90.0, (1, 0, 0)))
        sheet = Geode(panel(count, part, rng), name=name, color=color)
        group = Group(upright, Transform(sheet, translation=(0, -BEFORE, 0)), name=f"{name} and object")
        group.add(Geode(Mesh.box((-0.5, -0.5, FLOOR), (0.5, 0.5, -0.9)), name=f"pedestal behind the {name}"))
        # what carries the panel: a trunk, or the foot of the wall
        wide, foot, paint = (0.22, "trunk", BARK) if name == "tree" else (PANEL, "foot of the wall", WALL)
        low, high = (-wide, -BEFORE, FLOOR), (wide, -BEFORE + 0.3, -PANEL)
        group.add(Geode(Mesh.box(low, high), name=foot, color=paint))
        scene.add(Transform(group, translation=(side, 0, 0)))
        eyes = [np.array([side, -BEFORE - d, 0.0]) for d in np.geomspace(14.0, 5.0, 24)]
        scene.paths[name] = [View(e, (side, 0, 0), fov=30.0, near=0.1, far=100.0) for e in eyes]
        scene.views[name] = scene.paths[name][-1]
    return scene


def panel(holes: int, part: float, rng: np.random.Generator) -> Mesh:
    """An upright square in the plane y = 0 with `holes`² square holes around its middle, at random in cells of a grid.

    Parameters
    ----------
    holes : int
    part : float
        Of the square of half size `REGION` that is open.
    rng : Generator
    """
    lines = np.concatenate([[-PANEL], np.linspace(-REGION, REGION, holes + 1), [PANEL]])
    m = len(lines)
    corners = np.stack(np.meshgrid(lines, lines, indexing="ij"), axis=2).reshape(-1, 2)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(m - 1), np.arange(m - 1), indexing="ij"))
    ring = np.stack([i * m + j, (i + 1) * m + j, (i + 1) * m + j + 1, i * m + j + 1], axis=1)
    pierced = (i > 0) & (i < m - 2) & (j > 0) & (j < m - 2)
    cell = 2 * REGION / holes
    hole = np.sqrt(part) * cell
    low = corners[ring[pierced, 0]] + rng.uniform(0.05, 0.95, (int(pierced.sum()), 2)) * (cell - hole)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * hole
    inner = (low[:, None] + square).reshape(-1, 2)
    inside = len(corners) + np.arange(len(inner)).reshape(-1, 4)
    outside, after = ring[pierced], [1, 2, 3, 0]
    faces = [
        ring[~pierced][:, [0, 1, 2]],
        ring[~pierced][:, [0, 2, 3]],
        np.stack([outside, outside[:, after], inside[:, after]], axis=2).reshape(-1, 3),
        np.stack([outside, inside[:, after], inside], axis=2).reshape(-1, 3),
    ]
    return Mesh(_upright(np.concatenate([corners, inner])), np.concatenate(faces))


def _upright(points: Floats) -> Floats:
    """Points (k, 2) of the plane as (x, 0, z), their front toward -y."""
    return np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
