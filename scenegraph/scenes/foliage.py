"""Two equal objects, one behind a wall with a large hole, one behind a tree with many small ones (Kristmann 2022).

Figure 3.1 of the thesis: as much can be seen of both, but fine details show through the large hole only. Wall and tree
are flat. The holes of the tree are spread over all of its object; that of the wall has the same area, and is
put where as much of its object can be seen from the nearest view.
"""

from __future__ import annotations

import numpy as np

from ..errors import SceneError
from ..mesh import Mesh
from ..nodes import Geode, Group, Lod, Transform, rotation_matrix
from ..scene import Scene
from ..view import View
from .bunnies import FINEST, tessellated
from .shapes import Floats, Ints

#: Half the distance of the two objects from each other, and how far before them their occluders stand.
BESIDE, BEFORE = 6.0, 2.5
#: Half size of the occluders; objects have radius 1.
PANEL = 1.6
#: Distance of the nearest and of the farthest eye from the occluders.
NEAREST, FARTHEST = 5.0, 14.0
FLOOR = -2.3
GROUND, WALL, LEAVES, BARK = (0.62, 0.62, 0.58), (0.72, 0.52, 0.44), (0.36, 0.52, 0.30), (0.45, 0.36, 0.28)


def build(*, model: str = "", ceiling: int = 20, holes: int = 12, part: float = 0.3, seed: int = 1) -> Scene:
    """An object behind a tree with many small holes, and one behind a wall with a large hole of equal area.

    Parameters
    ----------
    model : str
        A model file, reduced to 98 triangles and tessellated again; a stand-in if empty.
    ceiling : int
        Finest tessellation level, 1 to 20.
    holes : int
        Of the tree, along each side of the object's rectangle.
    part : float
        Of the object's rectangle that is open, in the wall as in the tree; 0 < part < 0.9.
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
    # the object on the panels, as the nearest eye sees it
    base = levels[-1].vertices @ rotation_matrix(90.0, (1, 0, 0)).T
    shadow = base[:, ::2] * (NEAREST / (NEAREST + BEFORE + base[:, 1]))[:, None]
    rect = np.concatenate([shadow.min(axis=0), shadow.max(axis=0)])
    points = silhouette_points(shadow, levels[-1].faces.astype(np.int64), rect)
    pierced = {"wall": large_hole(rect, part, points), "tree": small_holes(rect, holes, part, rng)}
    for name, side, count, color in (("wall", -BESIDE, 1, WALL), ("tree", BESIDE, holes, LEAVES)):
        # models have y up
        upright = Transform(Lod(*levels, errors=errors, name=f"object behind the {name}"), rotation=(90.0, (1, 0, 0)))
        sheet = Geode(panel(count, pierced[name]), name=name, color=color)
        group = Group(upright, Transform(sheet, translation=(0, -BEFORE, 0)), name=f"{name} and object")
        group.add(Geode(Mesh.box((-0.5, -0.5, FLOOR), (0.5, 0.5, -0.9)), name=f"pedestal behind the {name}"))
        # what carries the panel: a trunk, or the foot of the wall
        wide, foot, paint = (0.22, "trunk", BARK) if name == "tree" else (PANEL, "foot of the wall", WALL)
        low, high = (-wide, -BEFORE, FLOOR), (wide, -BEFORE + 0.3, -PANEL)
        group.add(Geode(Mesh.box(low, high), name=foot, color=paint))
        scene.add(Transform(group, translation=(side, 0, 0)))
        eyes = [np.array([side, -BEFORE - d, 0.0]) for d in np.geomspace(FARTHEST, NEAREST, 24)]
        scene.paths[name] = [View(e, (side, 0, 0), fov=30.0, near=0.1, far=100.0) for e in eyes]
        scene.views[name] = scene.paths[name][-1]
    return scene


def panel(cells: int, holes: Floats) -> Mesh:
    """An upright square in the plane y = 0 with one rectangular hole in each of some cells.

    Parameters
    ----------
    cells : int
        Along each side of a rectangle of cells, within a border.
    holes : (cells², 4) float
        Left, bottom, right, top of each hole, the cells' columns one after another; cells are the rectangles that the
        holes of one column, and of one row, have room in.
    """
    grid = holes.reshape(cells, cells, 4)
    across = _between(grid[:, :, 0].min(axis=1), grid[:, :, 2].max(axis=1))
    upward = _between(grid[:, :, 1].min(axis=0), grid[:, :, 3].max(axis=0))
    m = cells + 3
    corners = np.stack(np.meshgrid(across, upward, indexing="ij"), axis=2).reshape(-1, 2)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(m - 1), np.arange(m - 1), indexing="ij"))
    ring = np.stack([i * m + j, (i + 1) * m + j, (i + 1) * m + j + 1, i * m + j + 1], axis=1)
    pierced = (i > 0) & (i < m - 2) & (j > 0) & (j < m - 2)
    inner = holes[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(-1, 2)
    inside = len(corners) + np.arange(len(inner)).reshape(-1, 4)
    outside, after = ring[pierced], [1, 2, 3, 0]
    faces = [
        ring[~pierced][:, [0, 1, 2]],
        ring[~pierced][:, [0, 2, 3]],
        np.stack([outside, outside[:, after], inside[:, after]], axis=2).reshape(-1, 3),
        np.stack([outside, inside[:, after], inside], axis=2).reshape(-1, 3),
    ]
    points = np.concatenate([corners, inner])
    return Mesh(np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]]), np.concatenate(faces))


def _between(low: Floats, high: Floats) -> Floats:
    """Lines between intervals, with the border of the panel at both ends."""
    margin = 0.02
    lines = [low[0] - margin, *(0.5 * (high[:-1] + low[1:])), high[-1] + margin]
    return np.array([-PANEL, *lines, PANEL])


def small_holes(rect: Floats, count: int, part: float, rng: np.random.Generator) -> Floats:
    """(count², 4) holes at random places in the cells of a grid over a rectangle (left, bottom, right, top)."""
    cell = (rect[2:] - rect[:2]) / count
    hole = np.sqrt(part) * cell
    i, j = (k.ravel() for k in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    low = rect[:2] + np.column_stack([i, j]) * cell + rng.uniform(0.05, 0.95, (count * count, 2)) * (cell - hole)
    return np.column_stack([low, low + hole])


def large_hole(rect: Floats, part: float, silhouette: Floats) -> Floats:
    """(1, 4) a hole of a part of a rectangle's area, through which that part of some points (k, 2) is seen."""
    hole = np.sqrt(part) * (rect[2:] - rect[:2])
    free = rect[2:] - rect[:2] - hole
    steps = np.linspace(0, 1, 33)
    low = rect[:2] + np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=2).reshape(-1, 2) * free
    seen = ((silhouette >= low[:, None]) & (silhouette <= low[:, None] + hole)).all(axis=2).mean(axis=1)
    off = np.linalg.norm(low + hole / 2 - (rect[:2] + rect[2:]) / 2, axis=1)
    # of the places where it is right to half a percent, that nearest to the middle
    error = np.maximum(np.abs(seen - part), 0.005)
    best = np.lexsort([off, error])[0]
    return np.concatenate([low[best], low[best] + hole])[None]


def silhouette_points(points: Floats, faces: Ints, rect: Floats, count: int = 64) -> Floats:
    """(k, 2) those points of a lattice over a rectangle that triangles in the plane cover."""
    u, v = (np.linspace(a, b, count) for a, b in zip(rect[:2], rect[2:], strict=True))
    lattice = np.stack(np.meshgrid(u, v, indexing="ij"), axis=2).reshape(-1, 2)
    covered = np.zeros(len(lattice), bool)
    for a, b, c in points[faces]:
        sides = [
            (q - p)[0] * (lattice - p)[:, 1] - (q - p)[1] * (lattice - p)[:, 0] for p, q in ((a, b), (b, c), (c, a))
        ]
        covered |= (np.minimum.reduce(sides) >= 0) | (np.maximum.reduce(sides) <= 0)
    return lattice[covered]
