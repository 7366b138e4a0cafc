"""Houses of the city: plastered bodies under tiled roofs, the one pattern whose solid is not a box."""

from __future__ import annotations

import numpy as np

from ..mesh import Mesh
from ..occluder import Occluder
from .buildings import BAY, DOOR, FOUNDATION, INSET, Pattern, box_body, box_occluders, half_size, open_sides
from .relief import Half, Wall
from .shapes import NO_BOTTOM, Shape, shrunk

TRIM = (0.91, 0.89, 0.84)
PANE = (0.22, 0.28, 0.33)
SHUTTER = (0.35, 0.44, 0.38)


def _windows(half: Half, floors: int, storey: float, corner: int, detail: int) -> Mesh:
    shape, sills = Shape(), Shape()
    for side in open_sides(corner):
        wall = Wall(side, half)
        count = round(2 * wall.half_width / BAY["house"])
        u, z = np.meshgrid(wall.bays(count), 1.3 + storey * np.arange(floors))
        door = np.zeros(u.shape, bool)
        door[0, count // 2] = side == "-y"
        for grow, v, color in ((0.15, 0.03, TRIM), (0.0, 0.06, DOOR)):
            wall.panels(shape, (u[door] - 0.6 - grow, u[door] + 0.6 + grow), v, (0.0, 2.4 + grow), color)
        u, z = u[~door], z[~door]
        if side != "+y" or detail > 1:
            wall.panels(shape, (u - 0.8, u + 0.8), 0.03, (z - 0.1, z + 1.6), TRIM)
        # panes with a bar between them only where the street is
        panes = ((-0.68, 1.36),) if detail < 2 and side != "-y" else ((-0.68, 0.65), (0.03, 0.65))
        for left, width in panes:
            wall.panels(shape, (u + left, u + left + width), 0.06, (z, z + 1.5), PANE)
        if side == "-y" or detail > 1:
            faces = "olrtb" if detail > 1 else "ob"
            wall.boxes(sills, (u - 0.92, u + 0.92), (0.0, 0.16), (z - 0.22, z - 0.1), faces)
        if detail > 1:
            for left in (-1.36, 0.84):
                wall.panels(shape, (u + left, u + left + 0.52), 0.05, (z - 0.05, z + 1.55), SHUTTER)
    return shape.add(sills, TRIM).mesh(name="windows")


def _tiled_roof(half: Half, height: float, rise: float, hipped: bool) -> Mesh:
    w, d = half
    eave, shape = 0.45, Shape()
    if hipped:
        x, y, low, ridge = w + eave, d + eave, height - 0.05, max(w - d, 0.3)
        rim = np.array([[-x, -y, low], [x, -y, low], [x, y, low], [-x, y, low]])
        top = np.array([[-ridge, 0.0, low + rise], [ridge, 0.0, low + rise]])
        center = (0.0, 0.0, low + 0.3 * rise)
        shape.polygons([[rim[0], rim[1], top[1], top[0]], [rim[2], rim[3], top[0], top[1]]], away_from=center)
        shape.polygons([[rim[1], rim[2], top[1]], [rim[3], rim[0], top[0]]], away_from=center)
        shape.polygons([rim], away_from=center)
    else:
        x, slope = w + 0.1, rise / d
        for sign in (-1.0, 1.0):
            section = np.array([[sign * (d + eave), height - eave * slope], [0.0, height + rise]])
            section = np.vstack([section + (0.0, 0.2), section[::-1] + (0.0, 0.03)])
            shape.prism(np.insert(section, 0, -x, axis=1), np.insert(section, 0, x, axis=1))
    stacks = np.array([[-0.55 * w, 0.3 * d, height], [0.5 * w, 0.2 * d, height]])
    shape.boxes(stacks, stacks + (0.8, 0.8, rise + 0.8), NO_BOTTOM)
    return shape.mesh(name="tiled roof")


def house(bays: tuple[int, int], floors: int, corner: int, detail: int) -> Pattern:
    """Plastered house with a tiled roof: framed windows and sills to the street, plain windows to the yard.

    A house between two others has a gabled body; a house at a corner a hipped roof on a box. `corner` is -1 or 1 for
    the side, -x or +x, that faces a second street, 0 for none.
    """
    half, storey = half_size("house", bays), 3.1
    w, d = half
    height, rise = storey * floors + 0.5, min(0.7 * d, 4.5)
    occluders = box_occluders(half, height)
    if corner:
        body = box_body(half, height)
    else:
        section = np.array([[-d, -FOUNDATION], [d, -FOUNDATION], [d, height], [0.0, height + rise], [-d, height]])
        body = Shape().prism(np.insert(section, 0, -w, axis=1), np.insert(section, 0, w, axis=1))
        inner = shrunk(section, INSET)
        ends = [np.insert(inner, 0, x, axis=1) for x in (INSET - w, w - INSET)]
        occluders[0] = Occluder.solid(np.vstack(ends), name="solid")
    return Pattern(
        (2 * w, 2 * d, height),
        body.mesh(name="house"),
        _windows(half, floors, storey, corner, detail),
        _tiled_roof(half, height, rise, corner != 0),
        tuple(occluders),
    )
