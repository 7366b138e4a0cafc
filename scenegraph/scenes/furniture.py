"""Small things for the built-in scenes: trees, lamps, cars, fountains, statues. Local origin on the ground."""

from __future__ import annotations

import numpy as np

from ..mesh import Mesh
from .shapes import NO_BOTTOM, Shape, bumps, icosphere, lathe

BARK = (0.40, 0.31, 0.23)
IRON = (0.20, 0.22, 0.22)
LIGHT = (0.98, 0.94, 0.80)
TIRE = (0.12, 0.12, 0.13)
WINDOW = (0.20, 0.25, 0.29)
STONE = (0.78, 0.76, 0.70)
WATER = (0.42, 0.58, 0.64)


def _crown(
    shape: Shape,
    center: tuple[float, float, float],
    size: tuple[float, float, float],
    color: tuple[float, ...],
    rng: np.random.Generator,
    levels: int,
) -> None:
    points, faces = icosphere(levels)
    uneven = 1 + 0.22 * bumps(points, rng)
    shape.surface(points * uneven[:, None] * size + center, faces, color)


def broadleaf(
    rng: np.random.Generator, *, height: float = 7.0, green: tuple[float, ...] = (0.36, 0.50, 0.25), levels: int = 0
) -> Mesh:
    """Tree with a round crown of two lumps; 50 triangles at level 0."""
    shape = Shape()
    shape.surface(*lathe([(0.035 * height, 0.0), (0.02 * height, 0.5 * height)], 5), BARK)
    _crown(shape, (0, 0, 0.6 * height), (0.29 * height, 0.29 * height, 0.32 * height), green, rng, levels)
    lighter = tuple(min(1.0, 1.12 * c) for c in green)
    turn = rng.uniform(0, 2 * np.pi)
    center = (0.1 * height * np.cos(turn), 0.1 * height * np.sin(turn), 0.8 * height)
    _crown(shape, center, (0.21 * height, 0.21 * height, 0.22 * height), lighter, rng, levels)
    return shape.mesh(name="tree")


def conifer(rng: np.random.Generator, *, height: float = 10.0, slim: bool = False) -> Mesh:
    """Cypress (slim) or pine."""
    shape = Shape()
    dark = (0.20, 0.32, 0.21) if slim else (0.27, 0.38, 0.22)
    points, faces = lathe([(0.02 * height, 0.0), (0.015 * height, 0.3 * height)], 5)
    shape.surface(points, faces, BARK)
    if slim:
        profile = [(0.0, 0.06), (0.075, 0.2), (0.085, 0.45), (0.05, 0.8), (0.0, 1.0)]
        points, faces = lathe(np.array(profile) * height, 8, flute=0.16, turn=rng.uniform(0, 1))
        shape.surface(points, faces, dark)
    else:
        for k, (low, high, radius) in enumerate(((0.2, 0.55, 0.20), (0.42, 0.78, 0.16), (0.64, 1.0, 0.11))):
            points, faces = lathe(np.array([(radius, low), (0.0, high)]) * height, 10, flute=0.25, turn=0.7 * k)
            shape.surface(points, faces, tuple(c * (1 + 0.08 * k) for c in dark))
    return shape.mesh(name="cypress" if slim else "pine")


def olive(rng: np.random.Generator, *, height: float = 4.5, levels: int = 0) -> Mesh:
    """Low gray-green tree with a thick, leaning trunk."""
    shape = Shape()
    points, faces = lathe([(0.09 * height, 0.0), (0.05 * height, 0.2 * height), (0.04 * height, 0.55 * height)], 6)
    points[:, 0] += 0.15 * points[:, 2]
    shape.surface(points, faces, (0.45, 0.39, 0.31))
    for k in range(3):
        turn = 2.1 * k + rng.uniform(0, 0.8)
        center = (0.08 * height + 0.17 * height * np.cos(turn), 0.17 * height * np.sin(turn), (0.6 + 0.1 * k) * height)
        tint = 0.92 + 0.08 * k
        _crown(
            shape,
            center,
            (0.27 * height, 0.27 * height, 0.2 * height),
            (0.49 * tint, 0.53 * tint, 0.38 * tint),
            rng,
            levels,
        )
    return shape.mesh(name="olive")


def bush(rng: np.random.Generator) -> Mesh:
    """Low shrub."""
    shape = Shape()
    _crown(shape, (0, 0, 0.4), (0.8, 0.8, 0.5), (0.47, 0.49, 0.30), rng, 0)
    return shape.mesh(name="bush")


def street_lamp(detail: int = 1) -> Mesh:
    """Lamp with an arm towards -y, 6 m high."""
    shape, sides = Shape(), 4 if detail < 2 else 8
    shape.surface(*lathe([(0.10, 0.0), (0.06, 6.0)], sides), IRON)
    shape.boxes((-0.04, -1.5, 5.9), (0.04, 0.0, 6.0), ("-x", "+x", "-z", "+z"), IRON)
    shape.boxes((-0.15, -1.9, 5.86), (0.15, -1.2, 6.02), ("-x", "+x", "-y", "-z", "+z"), LIGHT)
    return shape.mesh(name="lamp")


def car(color: tuple[float, ...]) -> Mesh:
    """Parked car, 4.3 m long along x."""
    shape = Shape()
    shape.boxes((-2.15, -0.88, 0.3), (2.15, 0.88, 0.86), color=color)
    base = np.array([[-1.7, -0.84, 0.86], [1.05, -0.84, 0.86], [1.05, 0.84, 0.86], [-1.7, 0.84, 0.86]])
    roof = np.array([[-1.25, -0.68, 1.42], [0.35, -0.68, 1.42], [0.35, 0.68, 1.42], [-1.25, 0.68, 1.42]])
    after = np.roll(np.arange(4), -1)
    shape.polygons(np.stack([base, base[after], roof[after], roof], axis=1), WINDOW)
    shape.polygons([roof], color)
    for x in (-1.35, 1.35):
        shape.boxes((x - 0.33, -0.9, 0.0), (x + 0.33, 0.9, 0.62), ("-x", "+x", "-y", "+y"), TIRE)
    return shape.mesh(name="car")


def bench() -> Mesh:
    """Park bench along x."""
    shape = Shape()
    wood = (0.52, 0.38, 0.25)
    shape.boxes((-0.9, -0.25, 0.40), (0.9, 0.25, 0.46), color=wood)
    shape.boxes((-0.9, 0.22, 0.55), (0.9, 0.28, 0.9), color=wood)
    shape.boxes([[-0.8, -0.22, 0.0], [0.7, -0.22, 0.0]], [[-0.7, 0.28, 0.9], [0.8, 0.28, 0.9]], NO_BOTTOM, IRON)
    return shape.mesh(name="bench")


def fountain() -> Mesh:
    """Round basin with a central bowl, 9 m across."""
    shape = Shape()
    basin = [(4.5, 0.0), (4.5, 0.6), (4.1, 0.6), (4.1, 0.35)]
    shape.surface(*lathe(basin, 20), STONE)
    shape.surface(*lathe([(4.1, 0.42), (0.0, 0.421)], 20), WATER)
    shape.surface(*lathe([(0.6, 0.0), (0.35, 0.8), (0.4, 1.7), (1.6, 2.1), (1.6, 2.25), (0.0, 2.05)], 14), STONE)
    shape.surface(*lathe([(0.2, 2.0), (0.15, 2.9), (0.7, 3.1), (0.0, 3.2)], 10), STONE)
    return shape.mesh(name="fountain")


def statue(rng: np.random.Generator, *, color: tuple[float, ...], height: float = 2.2, pedestal: float = 1.2) -> Mesh:
    """Draped standing figure on a block."""
    shape = Shape()
    shape.boxes((-0.55, -0.45, 0.0), (0.55, 0.45, pedestal), NO_BOTTOM, STONE)
    shape.boxes((-0.65, -0.55, pedestal - 0.15), (0.65, 0.55, pedestal), color=STONE)
    profile = np.array(
        [
            (0.19, 0.0),
            (0.20, 0.04),
            (0.16, 0.25),
            (0.135, 0.45),
            (0.15, 0.56),
            (0.12, 0.63),
            (0.155, 0.76),
            (0.14, 0.82),
            (0.05, 0.85),
            (0.045, 0.88),
        ]
    )
    points, faces = lathe(profile * height, 16, flute=0.10, turn=rng.uniform(0, 1))
    points *= (1.0, 0.72, 1.0)
    points[:, 0] += 0.02 * height * np.sin(points[:, 2] / height * 5 + rng.uniform(0, 6))
    figure = Shape().surface(points, faces)
    head, faces = icosphere(1)
    figure.surface(head * (0.058 * height, 0.066 * height, 0.078 * height) + (0.0, 0.0, 0.93 * height), faces)
    raised = rng.random() < 0.5
    for side in (-1, 1):
        end = np.array([side * 0.33, -0.1, 1.0 if raised and side > 0 else 0.5]) * height
        start = np.array([side * 0.14, 0.0, 0.79]) * height
        arm, faces = lathe([(0.035 * height, 0.0), (0.025 * height, 1.0), (0.0, 1.02)], 6)
        axis = end - start
        across = np.cross(axis, (0.0, 1.0, 0.0))
        across /= np.linalg.norm(across)
        other = np.cross(axis, across) / np.linalg.norm(axis)
        figure.surface(start + arm[:, :1] * across + arm[:, 1:2] * other + arm[:, 2:] * axis, faces)
    lift = np.eye(4)
    lift[2, 3] = pedestal
    shape.add(figure, color, lift)
    return shape.mesh(name="statue", smooth=True)
