"""Parts of Greek buildings: columns, steps, entablatures, roofs and rooms. Long axis along x, z up.

Rooms are closed boxes of stone and attics are closed prisms; their occluders are the same shapes drawn in by `INSET`.
Columns are drawables of their own that share one mesh per order.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..mesh import Mesh
from ..nodes import Geode, Group, Transform
from ..occluder import Occluder
from .relief import Half, Wall, ring
from .shapes import NO_BOTTOM, Floats, Shape, face_occluders, lathe, placements, shrunk

#: Meters by which an occluder lies inside the solid that it stands for.
INSET = 0.03
#: Where closed blocks begin: below the ground.
BOTTOM = -0.3

MARBLE, LIMESTONE, SHADE = (0.93, 0.90, 0.84), (0.86, 0.80, 0.69), (0.76, 0.70, 0.60)
BLUE, RED, GOLD = (0.27, 0.39, 0.56), (0.64, 0.29, 0.23), (0.80, 0.66, 0.36)
TERRACOTTA, MARBLE_TILES = (0.74, 0.45, 0.33), (0.84, 0.79, 0.71)
BRONZE_DOOR = (0.38, 0.31, 0.20)


def doric_column(height: float, radius: float, *, flutes: int = 20, name: str = "column") -> Mesh:
    """Fluted, tapering shaft with a slight swelling, echinus and abacus."""
    shape = Shape()
    neck = 0.93 * height
    shaft = np.array([(1.0, 0.0), (0.975, 0.35), (0.90, 0.70), (0.78, 1.0)]) * (radius, neck)
    shape.surface(*lathe(shaft, 2 * flutes, flute=0.085))
    shape.surface(*lathe([(0.78 * radius, neck), (1.10 * radius, 0.965 * height)], flutes))
    a = 1.14 * radius
    shape.boxes((-a, -a, 0.965 * height), (a, a, height))
    return shape.mesh(name=name)


def colonnade(column: Mesh, places: Floats, *, name: str, color: Sequence[float] = MARBLE) -> Group:
    """Columns on (k, 3) places."""
    nodes = [Transform(Geode(column, color=color), matrix=m) for m in placements(places)]
    return Group(*nodes, name=name)


def steps(half: Half, count: int, rise: float, tread: float) -> Shape:
    """Platform of `count` steps whose top is the rectangle."""
    shape = Shape()
    for k in range(count):
        grow = tread * (count - 1 - k)
        low = -0.5 if k == 0 else k * rise
        shape.boxes(
            (-half[0] - grow, -half[1] - grow, low), (half[0] + grow, half[1] + grow, (k + 1) * rise), NO_BOTTOM
        )
    return shape


def entablature(
    half: Half, floor: float, height: float, bay: float, *, thick: float = 0.9, ceiling: bool = True
) -> Shape:
    """Architrave, frieze of triglyphs and metopes and cornice above columns on a rectangle; a ceiling if wanted.

    Parameters
    ----------
    half : 2 floats
        Half sizes of the rectangle around the architrave, which is `thick` meters deep.
    floor, height : float
        Lower edge, and height of the whole.
    bay : float
        Meters between columns; there are two triglyphs to a bay.
    """
    shape, third = Shape(), height / 3
    beam = Shape()
    ring(beam, half, (floor, floor + 1.15 * third), 0.0, "obi", inner=-thick)
    shape.add(beam, MARBLE)
    frieze = Shape()
    ring(frieze, half, (floor + 1.15 * third, floor + 2.25 * third), -0.08, "o")
    shape.add(frieze, RED)
    triglyphs = Shape()
    for side in ("-y", "+x", "+y", "-x"):
        wall = Wall(side, half)
        count = 2 * max(round(2 * wall.half_width / bay), 1)
        u = np.linspace(-wall.half_width + 0.1 * bay, wall.half_width - 0.1 * bay, count + 1)
        width = 0.19 * bay
        wall.boxes(triglyphs, (u - width / 2, u + width / 2), (-0.08, 0.04),
                   (floor + 1.15 * third, floor + 2.25 * third), "olr")  # fmt: skip
    shape.add(triglyphs, BLUE)
    cornice = Shape()
    ring(cornice, half, (floor + 2.25 * third, floor + height), 0.55, "otbi", inner=-thick)
    if ceiling:
        cornice.boxes((-half[0], -half[1], floor + thick / 4), (half[0], half[1], floor + 1), ("-z",))
    return shape.add(cornice, MARBLE)


def gabled_roof(
    half: Half,
    floor: float,
    rise: float,
    *,
    tiles: Sequence[float],
    gable: Sequence[float],
    ribs: float = 1.2,
    recess: float = 0.9,
) -> Mesh:
    """Attic, a closed prism with its ridge along x, under two tiled slopes.

    Parameters
    ----------
    half : 2 floats
        Half length and half width of the attic at the height `floor`.
    ribs : float
        Meters between the rows of cover tiles; 0 for none.
    recess : float
        How far the gables stand back from the ends of the slopes.
    """
    a, b = half[0] - recess, half[1]
    section = attic_section(b, floor, rise)
    shape = Shape().prism(np.insert(section, 0, -a, axis=1), np.insert(section, 0, a, axis=1), gable)
    eave, slope = 0.7, rise / b
    cover = Shape()
    for sign in (-1.0, 1.0):
        run = np.array([[sign * (b + eave), floor - eave * slope], [0.0, floor + rise]])
        slab = np.vstack([run + (0.0, 0.3), run[::-1] + (0.0, 0.02)])
        shape.prism(np.insert(slab, 0, -half[0], axis=1), np.insert(slab, 0, half[0], axis=1), tiles)
        if ribs:
            x = np.arange(-half[0], half[0] + 0.01, 2 * half[0] / max(round(2 * half[0] / ribs), 1))
            low, high = (np.insert(np.tile(p + (0.0, 0.3), (len(x), 1)), 0, x, axis=1) for p in run)
            left, right, up = np.array([-0.14, 0, 0]), np.array([0.14, 0, 0]), np.array([0, 0, 0.16])
            for foot in (left, right):
                cover.polygons(np.stack([low + foot, low + up, high + up, high + foot], axis=1), away_from=(0, 0, -1e4))
    if ribs:
        shape.add(cover, tiles)
    return shape.mesh(name="roof")


def room(
    half: Half, floor: float, top: float, *, color: Sequence[float], door: str = "+x", ceiling: float | None = None
) -> Mesh:
    """Closed block with a base course, a door at the height `floor`, and a molding below `ceiling` (default: its top).

    It reaches down through the platform, so that its solid hides what stands on the ground behind.
    """
    shape = Shape().boxes((-half[0], -half[1], BOTTOM), (half[0], half[1], top), color=color)
    height = (top if ceiling is None else ceiling) - floor
    trim = Shape()
    ring(trim, half, (floor - 0.2, floor + 1.0), 0.08, "ot")
    ring(trim, half, (floor + 0.93 * height, floor + 0.97 * height), 0.1, "otb")
    shape.add(trim, SHADE)
    wall = Wall(door, half)
    wide, tall = 0.2 * wall.half_width + 0.5, 0.62 * height
    frame = Shape()
    wall.boxes(frame, (-wide - 0.3, wide + 0.3), (0.0, 0.12), (floor, floor + tall + 0.3), "olrt")
    shape.add(frame, MARBLE)
    wall.panels(shape, (np.array([-wide, 0.03]), np.array([-0.03, wide])), 0.15, (floor, floor + tall), BRONZE_DOOR)
    return shape.mesh(name="room")


def prism_occluders(section: ArrayLike, x0: float, x1: float) -> list[Occluder]:
    """A solid and its faces, just inside a prism whose section (m, 2) in y, z runs from x0 to x1."""
    inner = shrunk(section, INSET)
    ends = [np.insert(inner, 0, x, axis=1) for x in (x0 + INSET, x1 - INSET)]
    solid = Occluder.solid(np.vstack(ends), name="solid")
    return [solid, *face_occluders(solid)]


def attic_section(half_width: float, floor: float, rise: float) -> Floats:
    """(3, 2) section of the attic under a roof."""
    return np.array([[-half_width, floor], [half_width, floor], [0.0, floor + rise]])


def gabled_section(half_width: float, top: float, rise: float) -> Floats:
    """(5, 2) section of a room of some height together with what lies above it in the attic.

    Room and attic are one convex solid: it hides more than the two do one by one.
    """
    d = half_width
    return np.array([[-d, BOTTOM], [d, BOTTOM], [d, top], [0.0, top + rise], [-d, top]])


def rows(half: Half, front: int, flank: int, z: float) -> dict[str, Floats]:
    """Places of the columns of a peristyle, by side; the corner columns stand in the fronts."""
    x, y = np.linspace(-half[0], half[0], flank), np.linspace(-half[1], half[1], front)
    sides = {
        "east front": (np.full(front, half[0]), y),
        "west front": (np.full(front, -half[0]), y),
        "south flank": (x[1:-1], np.full(flank - 2, -half[1])),
        "north flank": (x[1:-1], np.full(flank - 2, half[1])),
    }
    return {side: np.column_stack([*at, np.full(len(at[0]), z)]) for side, at in sides.items()}
