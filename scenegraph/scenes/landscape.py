"""Open ground for the sanctuary: level in the middle, a wooded hill beside it, hills around, and a river.

The hill is a drawable of its own whose occluder is the hull of points below its upper, convex part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..mesh import Mesh
from ..nodes import Geode, Group
from ..occluder import Occluder
from .shapes import Floats, vertex_normals

GRASS, DRY, WOODS, GRAVEL_BED = (0.55, 0.58, 0.36), (0.72, 0.67, 0.47), (0.42, 0.48, 0.30), (0.66, 0.62, 0.53)
WATER = (0.45, 0.60, 0.66)


@dataclass(frozen=True)
class Landscape:
    """Heights of the ground.

    Attributes
    ----------
    level : 4 floats
        Rectangle x0, y0, x1, y1 in which the ground is level, at height 0.
    hill : 4 floats
        Middle x, y of the hill, its radius and its height.
    river : float
        x of the river, which runs along y.
    reach : float
        Half the edge of the square that the ground covers, in meters.
    seed : int
    """

    level: tuple[float, float, float, float]
    hill: tuple[float, float, float, float]
    river: float
    reach: float
    seed: int

    def height(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Meters above the level ground."""
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        x0, y0, x1, y1 = self.level
        away = np.hypot(np.maximum(np.maximum(x0 - x, x - x1), 0), np.maximum(np.maximum(y0 - y, y - y1), 0))
        rng = np.random.default_rng(self.seed)
        waves = np.zeros(x.shape)
        for length in (420.0, 300.0, 210.0, 120.0):
            turn, phase = rng.uniform(0, 2 * np.pi, 2)
            waves += length * np.sin(2 * np.pi * (np.cos(turn) * x + np.sin(turn) * y) / length + phase)
        rise = np.clip((away - 40.0) / 330.0, 0.0, 1.0)
        land = rise * rise * (3 - 2 * rise) * (38.0 + 0.055 * waves)
        bank = np.exp(-(((x - self.river) / 16.0) ** 2))
        low, hill = land * (1 - bank) - 2.6 * bank, self.knoll(x, y)
        return np.asarray(np.where(hill > 0, np.maximum(hill, low), low))

    def knoll(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Height of the hill alone: a smooth bump, convex upwards within half its radius."""
        cx, cy, radius, height = self.hill
        t = np.clip(np.hypot(np.asarray(x) - cx, np.asarray(y) - cy) / radius, 0.0, 1.0)
        return np.asarray(height * 0.5 * (1 + np.cos(np.pi * t)))


def build_landscape(land: Landscape, *, cells: int = 100, tiles: int = 5) -> tuple[Group, Group]:
    """Ground in square tiles, with the river; and the hill as a group that owns an occluder.

    Parameters
    ----------
    cells : int
        Along an edge of the square; two triangles each.
    tiles : int
        Along an edge; divides `cells`.
    """
    line = np.linspace(-land.reach, land.reach, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    points = np.stack([x, y, land.height(x, y)], axis=2).reshape(-1, 3)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    a, b, c, d = corner, corner + cells + 1, corner + cells + 2, corner + 1
    faces = np.stack([a, b, c, a, c, d], axis=1).reshape(-1, 3)
    normals = vertex_normals(points, faces)
    colors = _colors(land, points, normals)

    cx, cy, radius, _ = land.hill
    i, j = np.divmod(np.arange(cells * cells), cells)
    on_hill = (np.abs(line[i] - cx) < radius) & (np.abs(line[j] - cy) < radius)
    tile = np.where(on_hill, -1, i * tiles // cells * tiles + j * tiles // cells)

    def part(which: int, name: str) -> Geode:
        chosen = faces[np.repeat(tile == which, 2)]
        used, index = np.unique(chosen, return_inverse=True)
        mesh = Mesh(points[used], index.reshape(-1, 3), name=name, normals=normals[used], vertex_colors=colors[used])
        return Geode(mesh)

    ground = Group(*(part(k, "ground") for k in range(tiles * tiles) if (tile == k).any()), name="ground")
    w, r = 30.0, land.reach
    river = [
        [land.river - w, -r, -0.9],
        [land.river + w, -r, -0.9],
        [land.river + w, r, -0.9],
        [land.river - w, r, -0.9],
    ]
    ground.add(Geode(Mesh(river, [[0, 1, 2], [0, 2, 3]], name="river", color=WATER)))
    return ground, Group(part(-1, "hill"), hill_occluder(land, 2 * land.reach / cells), name="hill")


def hill_occluder(land: Landscape, cell: float) -> Occluder:
    """Hull of two rings and the top of the hill, lowered by what the grid of this cell size can cut off."""
    cx, cy, radius, height = land.hill
    # a linear interpolant lies below a convex-up surface by at most curvature * diagonal^2 / 8
    margin = 0.1 + 0.5 * height * (np.pi / radius) ** 2 * (2 * cell**2) / 8
    turn = 2 * np.pi * np.arange(12) / 12
    points = [[cx, cy, height - margin]]
    for share in (0.25, 0.48):
        for t in turn:
            px, py = cx + share * radius * np.cos(t), cy + share * radius * np.sin(t)
            points.append([px, py, float(land.knoll(px, py)) - margin])
    foot = [[p[0], p[1], 0.1] for p in points[-12:]]
    return Occluder.solid(np.array(points + foot), name="hill")


def _colors(land: Landscape, points: Floats, normals: Floats) -> NDArray[np.uint8]:
    x, y, z = points.T
    rng = np.random.default_rng(land.seed + 1)
    patch = np.zeros(len(x))
    for length in (160.0, 75.0, 38.0):
        turn, phase = rng.uniform(0, 2 * np.pi, 2)
        patch += np.sin(2 * np.pi * (np.cos(turn) * x + np.sin(turn) * y) / length + phase) / 3
    mix = np.clip(0.5 + 0.6 * patch, 0, 1)[:, None]
    color = mix * GRASS + (1 - mix) * np.array(DRY)
    wooded = np.clip((z - 4.0) / 22.0, 0, 1)[:, None]
    color = (1 - wooded) * color + wooded * np.array(WOODS) * (0.9 + 0.2 * mix)
    shore = np.exp(-(((x - land.river) / 24.0) ** 4))[:, None]
    color = (1 - shore) * color + shore * np.array(GRAVEL_BED)
    return np.round(np.column_stack([255 * color, np.full(len(x), 255)])).astype(np.uint8)
