"""Buildings of a Greek sanctuary, each a transform with its drawables and the occluders that it owns.

Local origin on the ground in the middle of the building, long axis and front along +x before it is turned.
"""

from __future__ import annotations

import numpy as np

from ..mesh import Mesh
from ..nodes import Geode, Node, Transform
from ..occluder import Occluder
from .furniture import STONE
from .shapes import NO_BOTTOM, Shape, face_occluders, lathe
from .temple_parts import (
    BLUE,
    BOTTOM,
    GOLD,
    INSET,
    LIMESTONE,
    MARBLE,
    MARBLE_TILES,
    SHADE,
    TERRACOTTA,
    attic_section,
    colonnade,
    doric_column,
    entablature,
    gabled_roof,
    gabled_section,
    prism_occluders,
    room,
    rows,
    steps,
)

Place = tuple[float, float, float]


def placed(name: str, place: Place, *children: Node, lift: float = 0.0) -> Transform:
    """Children at (x, y) turned by an angle in degrees, `lift` meters above the ground."""
    x, y, angle = place
    return Transform(*children, translation=(x, y, lift), rotation=(angle, (0, 0, 1)), name=name)


def temple(
    name: str,
    place: Place,
    *,
    length: float,
    width: float,
    front: int,
    flank: int,
    column: float,
    marble_tiles: bool = False,
    figure: Mesh | None = None,
) -> Transform:
    """Peripteral temple.

    Parameters
    ----------
    length, width : float
        Between the axes of the corner columns, in meters.
    front, flank : int
        Columns on the short and on the long sides, corners counted twice.
    column : float
        Height of the columns in meters.
    figure : Mesh, optional
        Stands in the gables, in several sizes.
    """
    half = (length / 2, width / 2)
    radius, rise = 0.105 * column, 0.05 * column
    floor, bay = 3 * rise, length / (flank - 1)
    outer = (half[0] + 1.2 * radius, half[1] + 1.2 * radius)
    beam = 0.26 * column
    top = floor + column + beam
    platform = steps((outer[0] + 0.3, outer[1] + 0.3), 3, rise, 0.9 * rise)
    cella = (half[0] - 1.55 * bay - 0.08 * length, half[1] - 1.15 * width / (front - 1))
    walls = room(cella, floor, top, color=LIMESTONE, ceiling=floor + column)
    gable = 0.27 * width
    tiles = MARBLE_TILES if marble_tiles else TERRACOTTA
    roof = gabled_roof((outer[0] + 0.5, outer[1]), top, gable, tiles=tiles, gable=BLUE, recess=0.9)
    attic = outer[0] - 0.4
    order = doric_column(column, radius)
    sides = rows(half, front, flank, floor)
    porch = np.array([[s * (cella[0] + 0.9 * bay), y, floor] for s in (-1, 1) for y in (-cella[1] / 3, cella[1] / 3)])
    node = placed(
        name, place,
        Geode(platform.mesh(name="steps", color=MARBLE)),
        Geode(walls, name="cella"),
        *(colonnade(order, at, name=side) for side, at in sides.items()),
        colonnade(order, porch, name="porches"),
        Geode(entablature(outer, floor + column, beam, bay, thick=2.3 * radius).mesh(name="entablature")),
        Geode(roof),
        *prism_occluders(gabled_section(cella[1], top, gable), -cella[0], cella[0]),
        *prism_occluders(attic_section(outer[1], top, gable), -attic, attic),
    )  # fmt: skip
    if figure is not None:
        tall = 0.2 * width
        y = np.linspace(-0.36 * width, 0.36 * width, 9)
        size = tall * (1 - 0.85 * np.abs(y) / (0.42 * width)) / 2.2
        for x in (-(outer[0] + 0.1), outer[0] + 0.1):
            node.add(*(Transform(Geode(figure, name="figure"), scale=float(s), translation=(x, float(v), top))
                       for v, s in zip(y, size, strict=True)))  # fmt: skip
    crown = Shape().surface(
        *lathe(0.065 * width * np.array([(0.1, 0.0), (0.4, 0.2), (0.25, 0.6), (0.0, 1.0)]), 8), GOLD
    )
    ornament = crown.mesh(name="acroterion")
    ridge = top + gable + 0.3
    node.add(*(Transform(Geode(ornament), translation=(x, 0.0, ridge)) for x in (-outer[0], outer[0])))
    return node


def treasury(
    name: str, place: Place, *, length: float, width: float, column: float, tiles: tuple[float, ...], lift: float = 0.0
) -> Transform:
    """Small house with two columns between the ends of its walls."""
    half = (length / 2, width / 2)
    porch = 0.3 * length
    floor, radius = 0.6, 0.11 * column
    top = floor + column + 0.3 * column
    body = (half[0] - porch / 2, half[1])
    walls = room(body, floor, top, color=LIMESTONE, ceiling=floor + column)
    antae = Shape().boxes(
        [[half[0] - porch, y, floor] for y in (-half[1], half[1] - 0.5)],
        [[half[0], y + 0.5, floor + column] for y in (-half[1], half[1] - 0.5)],
        ("-y", "+y", "+x"), LIMESTONE,
    )  # fmt: skip
    at = np.array([[half[0] - 0.4, y, floor] for y in (-half[1] / 3, half[1] / 3)])
    gable = 0.28 * width
    roof = gabled_roof((half[0] + 0.5, half[1] + 0.1), top, gable, tiles=tiles, gable=BLUE, ribs=0.0, recess=0.5)
    return placed(
        name, place,
        Geode(steps((half[0] + 0.2, half[1] + 0.2), 2, floor / 2, 0.35).mesh(name="steps", color=MARBLE)),
        Transform(Geode(walls, name="naos"), translation=(-porch / 2, 0.0, 0.0)),
        Geode(antae.mesh(name="antae")),
        colonnade(doric_column(column, radius, flutes=10), at, name="porch"),
        Geode(entablature(half, floor + column, 0.3 * column, 2.4).mesh(name="entablature")),
        Geode(roof),
        *prism_occluders(gabled_section(half[1], top, gable), -half[0], half[0] - porch),
        *prism_occluders(attic_section(half[1] + 0.1, top, gable), -half[0], half[0]),
        lift=lift,
    )  # fmt: skip


def stoa(name: str, place: Place, *, length: float, depth: float, columns: int, column: float) -> Transform:
    """Hall that is open to the front (-y) behind a row of columns and closed by a wall at the back and both ends."""
    half = (length / 2, depth / 2)
    floor = 0.5
    top = floor + column + 0.22 * column
    order = doric_column(column, 0.09 * column, flutes=10)
    x = np.linspace(-half[0] + 1.2, half[0] - 1.2, columns)
    inner = np.linspace(-half[0] + 4, half[0] - 4, columns // 3)
    front = np.column_stack(np.broadcast_arrays(x, -half[1] + 0.4, floor))
    middle = np.column_stack(np.broadcast_arrays(inner, 0.15 * depth, floor))
    thick = 0.9
    walls = [
        ((-half[0], half[1] - thick, BOTTOM), (half[0], half[1], top)),
        ((-half[0], -half[1] + 2.0, BOTTOM), (-half[0] + thick, half[1] - thick, top)),
        ((half[0] - thick, -half[1] + 2.0, BOTTOM), (half[0], half[1] - thick, top)),
    ]
    shape, hides = Shape(), []
    for k, (low, high) in enumerate(walls):
        shape.boxes(low, high)
        solid = Occluder.box(np.add(low, INSET), np.subtract(high, INSET), name=f"wall {k}")
        thin = int(np.argmin(np.subtract(high, low)[:2]))
        hides += [solid, *(f for f in face_occluders(solid, name=f"wall {k} face") if np.ptp(f.vertices[:, thin]) == 0)]
    gable = 0.2 * depth
    roof = gabled_roof((half[0] + 0.3, half[1] + 0.1), top, gable, tiles=TERRACOTTA, gable=LIMESTONE, ribs=1.6)
    return placed(
        name, place,
        Geode(steps(half, 2, floor / 2, 0.4).mesh(name="steps", color=MARBLE)),
        Geode(shape.mesh(name="walls", color=LIMESTONE)),
        colonnade(order, front, name="front"),
        colonnade(order, middle, name="inner row"),
        Geode(entablature(half, floor + column, 0.22 * column, 2.6).mesh(name="entablature")),
        Geode(roof),
        *hides,
        *prism_occluders(attic_section(half[1] + 0.1, top, gable), 0.6 - half[0], half[0] - 0.6),
    )  # fmt: skip


def house(name: str, place: Place, *, length: float, width: float, height: float) -> Transform:
    """Closed hall under a gabled roof."""
    half = (length / 2, width / 2)
    top, gable = height + 0.1, 0.26 * width
    walls = room(half, 0.1, top, color=LIMESTONE)
    roof = gabled_roof((half[0] + 0.3, half[1] + 0.1), top, gable, tiles=TERRACOTTA, gable=LIMESTONE, recess=0.3)
    return placed(
        name, place, Geode(walls), Geode(roof),
        *prism_occluders(gabled_section(half[1], top, gable), -half[0], half[0]),
    )  # fmt: skip


def court(
    name: str, place: Place, *, size: tuple[float, float], wing: float, height: float, bay: float, outer: bool
) -> Transform:
    """Four wings of closed rooms around a court with a peristyle; `outer` adds columns around the outside too."""
    half = (size[0] / 2, size[1] / 2)
    node = placed(name, place)
    for angle, (along, across) in zip((0, 90, 180, 270), (half, half[::-1]) * 2, strict=True):
        # each wing is as long as its side less its own width, so that the four close like a pinwheel
        long, out = along - wing / 2, across - wing / 2
        top, gable = height + 0.1, 0.22 * wing
        walls = room((long, wing / 2), 0.1, top, color=LIMESTONE, door="+y")
        roof = gabled_roof(
            (long + 0.2, wing / 2 + 0.1), top, gable, tiles=TERRACOTTA, gable=LIMESTONE, ribs=2.0, recess=0.2
        )
        hides = prism_occluders(gabled_section(wing / 2, top, gable), -long, long)
        turn = np.radians(angle)
        x, y = -wing / 2, -out
        at = (np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y)
        node.add(placed("wing", (*at, float(angle)), Geode(walls), Geode(roof), *hides))
    order = doric_column(height - 0.6, 0.075 * height, flutes=8)
    rings = [("peristyle", -wing - 2.2)] + ([("outer row", 2.6)] if outer else [])
    for label, grow in rings:
        rim = (half[0] + grow, half[1] + grow)
        counts = [max(round(2 * r / bay) + 1, 2) for r in rim]
        sides = rows(rim, counts[1], counts[0], 0.1)
        node.add(*(colonnade(order, at, name=f"{label} {side}", color=SHADE) for side, at in sides.items()))
        beam = entablature((rim[0] + 0.5, rim[1] + 0.5), height - 0.5, 0.7, 2 * bay, ceiling=False)
        node.add(Geode(beam.mesh(name=f"{label} beam")))
    return node


def tholos(name: str, place: Place, *, radius: float, column: float) -> Transform:
    """Round temple with 18 columns."""
    floor, inner, sides = 0.9, 0.62 * radius, 24
    base = Shape()
    for k in range(3):
        r = radius + 0.45 * (2 - k)
        base.surface(*lathe([(r, 0.3 * k - 0.3 * (k == 0)), (r, 0.3 * k + 0.3), (0.0, 0.3 * k + 0.3)], 36))
    top = floor + column
    cella = Shape().surface(*lathe([(0.0, BOTTOM), (inner, BOTTOM), (inner, top), (0.0, top)], sides), LIMESTONE)
    cella.surface(*lathe([(inner + 0.08, floor), (inner + 0.08, floor + 0.9), (inner, floor + 0.9)], sides), SHADE)
    beam, rise = top + 1.2, 0.55 * radius
    drum = [(inner, top), (radius - 0.9, top), (radius - 0.9, top - 0.02), (radius, top), (radius, beam - 0.3)]
    drum += [(radius + 0.5, beam - 0.3), (radius + 0.5, beam), (0.0, beam + rise)]
    roof = Shape().surface(*lathe(drum[:5], 36), MARBLE).surface(*lathe(drum[4:7], 36), MARBLE)
    roof.surface(*lathe(drum[6:], 36), TERRACOTTA)
    turn = 2 * np.pi * np.arange(18) / 18
    at = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(18)]) * (radius - 0.7) + (0, 0, floor)
    core, _ = lathe([(inner - INSET, BOTTOM + INSET), (inner - INSET, top - INSET)], sides)
    solid = Occluder.solid(core, name="solid")
    return placed(
        name, place,
        Geode(base.mesh(name="steps", color=MARBLE)),
        Geode(cella.mesh(name="cella")),
        colonnade(doric_column(column, 0.085 * column), at, name="ring"),
        Geode(roof.mesh(name="roof")),
        solid, *face_occluders(solid, name="wall"),
    )  # fmt: skip


def wall(
    name: str, start: tuple[float, float], end: tuple[float, float], *, height: float, thick: float = 0.9
) -> Transform:
    """Free-standing wall with a coping between two points."""
    middle, leg = np.add(start, end) / 2, np.subtract(end, start)
    half = (float(np.hypot(*leg)) / 2, thick / 2)
    low, high = (-half[0], -half[1], BOTTOM), (half[0], half[1], height)
    shape = Shape().boxes(low, high, color=STONE)
    shape.boxes((-half[0] - 0.1, -half[1] - 0.15, height), (half[0] + 0.1, half[1] + 0.15, height + 0.2), color=SHADE)
    solid = Occluder.box(np.add(low, INSET), np.subtract(high, INSET), name="solid")
    # one two-sided polygon in the middle of the wall serves both of its faces
    x, bottom, top = half[0] - INSET, BOTTOM + INSET, height - INSET
    sheet = Occluder.planar([(-x, 0, bottom), (x, 0, bottom), (x, 0, top), (-x, 0, top)], name="sheet")
    angle = float(np.degrees(np.arctan2(leg[1], leg[0])))
    return placed(name, (float(middle[0]), float(middle[1]), angle), Geode(shape.mesh(name="wall")), solid, sheet)


def embankment(
    name: str, place: Place, *, length: float, foot: float, crown: float, height: float, color: tuple[float, ...]
) -> Transform:
    """Long mound of earth with sloping sides."""
    section = np.array([[-foot / 2, BOTTOM], [foot / 2, BOTTOM], [crown / 2, height], [-crown / 2, height]])

    shape = Shape().prism(np.insert(section, 0, -length / 2, axis=1), np.insert(section, 0, length / 2, axis=1))
    hides = prism_occluders(section, -length / 2, length / 2)
    return placed(name, place, Geode(shape.mesh(name="mound", color=color)), *hides)


def altar(name: str, place: Place, *, radius: float, height: float) -> Transform:
    """Mound of ashes on a round platform."""
    shape = Shape().surface(*lathe([(radius, 0.0), (radius, 1.1), (0.72 * radius, 1.1)], 28), STONE)
    ashes = [(0.7 * radius, 1.1), (0.6 * radius, 0.45 * height), (0.35 * radius, 0.8 * height), (0.0, height)]
    shape.surface(*lathe(ashes, 28, flute=0.04), (0.62, 0.60, 0.57))
    stairs = np.array([[radius - 0.2 + 0.4 * k, -1.6, 0.0] for k in range(3)])
    shape.boxes(stairs, stairs + [[0.4, 3.2, 1.1 - 0.36 * k] for k in range(3)], NO_BOTTOM, STONE)
    return placed(name, place, Geode(shape.mesh(name="altar")))
