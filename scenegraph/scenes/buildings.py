"""Patterns of buildings for the city: a closed body, the relief of its facades, a roof, and what they hide.

A pattern stands centered on the origin with its front towards -y and is placed by a matrix, so a handful of patterns
serve any number of buildings. The body is closed and everything else lies outside it; the occluders are the body,
drawn in by `INSET`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..mesh import Mesh
from ..occluder import Occluder
from .relief import Half, Wall, ring
from .shapes import NO_BOTTOM, Shape, face_occluders, lathe

#: Meters by which an occluder lies inside the body that it stands for.
INSET = 0.02
#: Meters that a body reaches below the pavement, so that no bottom face lies in its plane.
FOUNDATION = 0.3

#: Meters between windows, by style.
BAY = {"house": 4.4, "apartments": 4.4, "offices": 5.2, "tower": 5.2}

DOOR = (0.36, 0.24, 0.17)
CURTAIN = ((0.80, 0.75, 0.64), (0.55, 0.60, 0.63), (0.88, 0.80, 0.60))
GLASS = ((0.24, 0.32, 0.38), (0.20, 0.28, 0.30), (0.29, 0.30, 0.31))

AROUND = ("-y", "+x", "+y", "-x")


@dataclass(frozen=True)
class Pattern:
    """One building, ready to be placed.

    Attributes
    ----------
    size : 3 floats
        Width along the street, depth and height of the body in meters.
    body, facade, roof : Mesh
        Three drawables.
    occluders : tuple of Occluder
        To be copied under every instance.
    """

    size: tuple[float, float, float]
    body: Mesh
    facade: Mesh
    roof: Mesh
    occluders: tuple[Occluder, ...]

    def only(self, *kinds: str) -> Pattern:
        """The same building with only these kinds of occluders."""
        return replace(self, occluders=tuple(o for o in self.occluders if o.kind in kinds))


def box_occluders(half: Half, height: float) -> list[Occluder]:
    """A solid and its four upright faces, just inside a box that stands on its foundation."""
    low = (INSET - half[0], INSET - half[1], INSET - FOUNDATION)
    high = (half[0] - INSET, half[1] - INSET, height - INSET)
    solid = Occluder.box(low, high, name="solid")
    return [solid, *face_occluders(solid)]


def box_body(half: Half, height: float, color: tuple[float, ...] | None = None, bottom: float = -FOUNDATION) -> Shape:
    """Closed box that stands on its foundation, or at `bottom`."""
    return Shape().boxes((-half[0], -half[1], bottom), (half[0], half[1], height), color=color)


def open_sides(corner: int) -> tuple[str, ...]:
    """Front and back, and at a corner the side that faces the other street (-1: -x, 1: +x)."""
    return ("-y", "+y", *(("-x", "+x")[corner > 0 : (corner > 0) + 1] if corner else ()))


def half_size(style: str, bays: tuple[int, int]) -> Half:
    """Half width and half depth of a building with so many bays."""
    return BAY[style] * bays[0] / 2, BAY[style] * bays[1] / 2


def _flat_roof(half: Half, height: float, rng: np.random.Generator, mast: float = 0.0) -> Mesh:
    w, d, z = half[0], half[1], height + 0.06
    shape = Shape().boxes((-w, -d, height), (w, d, z), ["+z"])
    shape.boxes((0.1 * w, -0.1 * d, z), (0.1 * w + 3.4, -0.1 * d + 2.8, z + 2.7), NO_BOTTOM)
    at = rng.uniform((-0.75 * w, -0.7 * d), (-0.1 * w, 0.5 * d), (2, 2))
    low = np.column_stack([at, np.full(2, z)])
    shape.boxes(low, low + rng.uniform((1.2, 1.2, 0.8), (2.6, 2.2, 1.6), (2, 3)), NO_BOTTOM)
    if rng.random() < 0.4:
        center = np.array([0.45 * w, 0.5 * d, z])
        points, faces = lathe([(1.2, 2.0), (1.2, 4.4), (0.0, 5.2)], 8)
        shape.surface(points + center, faces)
        shape.boxes(center - (0.7, 0.7, 0.0), center + (0.7, 0.7, 2.0), AROUND)
    if mast:
        points, faces = lathe([(0.35, z), (0.06, z + mast)], 4)
        shape.surface(points + (-0.2 * w, 0.3 * d, 0.0), faces)
    return shape.mesh(name="flat roof")


def _glass_body(
    half: Half,
    height: float,
    storey: float,
    floors: range,
    bay: float,
    rng: np.random.Generator,
    bottom: float = -FOUNDATION,
) -> Shape:
    """Closed box of dark glass with curtains drawn on some floors, and a door: what shows between piers and bands."""
    shape = box_body(half, height, GLASS[rng.integers(len(GLASS))], bottom)
    curtain = CURTAIN[rng.integers(len(CURTAIN))]
    for side in AROUND:
        wall = Wall(side, half)
        count = max(round(2 * wall.half_width / bay), 1)
        width = 2 * wall.half_width / count
        u, z = np.meshgrid(wall.bays(count), storey * np.array(floors))
        drawn = rng.random(u.shape) < 0.12
        top = z[drawn] + storey - 0.3
        low = top - 1.6 * rng.uniform(0.4, 1.0, len(top))
        wall.panels(shape, (u[drawn] - 0.36 * width, u[drawn] + 0.36 * width), 0.03, (low, top), curtain)
        if side == "-y" and bottom < 0:
            middle = u[0, count // 2]
            wall.panels(shape, (middle - 0.9, middle + 0.9), 0.04, (0.0, 2.6), DOOR)
    return shape


def _piers(
    shape: Shape, half: Half, sides: tuple[str, ...], bay: float, width: float, out: float, z: tuple[float, float]
) -> None:
    """Upright piers between the bays of the sides, and one around each corner."""
    for side in sides:
        wall = Wall(side, half)
        count = max(round(2 * wall.half_width / bay), 1)
        u = np.linspace(-wall.half_width, wall.half_width, count + 1)[1:-1]
        wall.boxes(shape, (u - width / 2, u + width / 2), (0.0, out), z, "olr")
    corner = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    a, b = corner * (np.array(half) + out), corner * (np.array(half) - 0.75 * width)
    low, high = np.minimum(a, b), np.maximum(a, b)
    shape.boxes(np.insert(low, 2, z[0], axis=1), np.insert(high, 2, z[1], axis=1), AROUND)


def apartments(bays: tuple[int, int], floors: int, corner: int, detail: int, rng: np.random.Generator) -> Pattern:
    """Masonry block: pilasters, spandrels, deep windows and a cornice."""
    half, storey = half_size("apartments", bays), 3.3
    height = storey * floors + 1.0
    facade = Shape()
    sides = open_sides(corner)
    _piers(facade, half, sides, BAY["apartments"], 1.5, 0.30, (-FOUNDATION, height))
    band = storey * np.arange(1, floors) + 1.0
    for side in sides:
        wall = Wall(side, half)
        span = (-wall.half_width, wall.half_width)
        wall.boxes(facade, span, (0.0, 0.24), (band - 0.6, band + 0.75), "otb" if side == "-y" or detail > 1 else "ot")
        wall.boxes(facade, span, (0.0, 0.24), (height - 0.9, height), "ob")
        if detail > 1:
            wall.boxes(facade, span, (0.24, 0.36), (band + 0.65, band + 0.8), "otb")
    for side in [s for s in AROUND if s not in sides]:
        Wall(side, half).boxes(facade, (-half[1], half[1]), (0.0, 0.2), (-FOUNDATION, height), "olrt")
    ring(facade, half, (height - 0.35, height + 0.75), 0.55, "otbi", inner=-0.3)
    return Pattern(
        (2 * half[0], 2 * half[1], height),
        _glass_body(half, height, storey, range(1, floors), BAY["apartments"], rng).mesh(name="apartments"),
        facade.mesh(name="masonry"),
        _flat_roof(half, height, rng),
        tuple(box_occluders(half, height)),
    )


def offices(bays: tuple[int, int], floors: int, detail: int, rng: np.random.Generator) -> Pattern:
    """Office slab with ribbon windows above an open ground floor."""
    half, storey = half_size("offices", bays), 3.6
    height = storey * floors + 1.2
    facade = Shape()
    band = storey * np.arange(1, floors) + 1.2
    ring(facade, half, (band - 0.5, band + 0.8), 0.35)
    ring(facade, half, (height - 0.6, height + 0.8), 0.45, "otbi", inner=-0.2)
    _piers(facade, half, AROUND, BAY["offices"], 0.5, 0.30, (-FOUNDATION, storey + 0.7))
    if detail > 1:
        _piers(facade, half, AROUND, BAY["offices"] / 3, 0.08, 0.12, (storey, height))
    return Pattern(
        (2 * half[0], 2 * half[1], height),
        _glass_body(half, height, storey, range(1, floors), BAY["offices"] / 2, rng).mesh(name="offices"),
        facade.mesh(name="ribbons"),
        _flat_roof(half, height, rng),
        tuple(box_occluders(half, height)),
    )


def tower(bays: tuple[int, int], floors: int, detail: int, rng: np.random.Generator) -> Pattern:
    """High-rise: a podium that fills the lot and a shaft with fins, set back on all sides."""
    half, storey = half_size("tower", bays), 3.6
    shaft = (half[0] - 2.0, half[1] - 1.6)
    podium, height = 3 * storey + 1.2, storey * floors + 1.2
    body = box_body(half, podium, GLASS[0])
    body.add(_glass_body(shaft, height, storey, range(4, floors), BAY["tower"] / 2, rng, podium))
    facade = Shape()
    band = storey * np.arange(1, 3) + 1.2
    ring(facade, half, (band - 0.5, band + 0.8), 0.30)
    ring(facade, half, (podium - 0.5, podium + 0.9), 0.40, "otbi", inner=-0.3)
    _piers(facade, half, AROUND, BAY["tower"], 0.6, 0.45, (-FOUNDATION, podium))
    facade.boxes((-half[0], -half[1], podium), (half[0], half[1], podium + 0.05), ["+z"])
    _piers(facade, shaft, AROUND, BAY["tower"] / (3 if detail > 1 else 2), 0.3, 0.4, (podium, height + 1.2))
    step = 1 if detail > 1 else 3
    band = np.arange(podium + step * storey, height - 1.5 * storey, step * storey)
    if len(band):
        ring(facade, shaft, (band - 0.5, band + 0.5), 0.22)
    ring(facade, shaft, (height - 0.8, height + 1.0), 0.25, "otbi", inner=-0.2)
    return Pattern(
        (2 * half[0], 2 * half[1], height),
        body.mesh(name="tower"),
        facade.mesh(name="fins"),
        _flat_roof(shaft, height, rng, mast=0.16 * height if floors > 20 else 0.0),
        (*box_occluders(shaft, height), *box_occluders(half, podium)),
    )


def plain() -> Pattern:
    """Unit box on z = 0: 12 triangles, one solid and the facade to the street."""
    i = 0.001
    low, high = (i - 0.5, i - 0.5, i), (0.5 - i, 0.5 - i, 1 - i)
    box, solid = Mesh.box((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0), name="box"), Occluder.box(low, high, name="solid")
    front = next(o for o in face_occluders(solid) if (o.vertices[:, 1] < 0).all())
    return Pattern((1.0, 1.0, 1.0), box, box, box, (solid, front))
