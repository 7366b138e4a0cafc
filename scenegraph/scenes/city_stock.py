"""What stands on the lots of the city: a style, a size and colors for every building."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..nodes import Geode, Transform
from . import buildings as patterns
from .buildings import BAY, Pattern
from .city_layout import ROW, SETBACK, Layout
from .houses import house
from .shapes import Floats, occluder_copy, placements

Occluders = Literal["both", "solid", "planar", "none"]

#: Floors for which there are patterns; other heights are stretched from the nearest.
FLOORS = np.array([2, 3, 4, 5, 6, 7, 9, 11, 14, 18, 23, 30])

PLASTER = (
    (0.89, 0.79, 0.60),
    (0.93, 0.89, 0.79),
    (0.86, 0.69, 0.59),
    (0.77, 0.80, 0.81),
    (0.79, 0.80, 0.69),
    (0.95, 0.94, 0.91),
    (0.83, 0.72, 0.62),
)
MASONRY = (
    (0.64, 0.39, 0.31),
    (0.73, 0.52, 0.41),
    (0.82, 0.74, 0.60),
    (0.52, 0.40, 0.34),
    (0.87, 0.83, 0.75),
    (0.72, 0.67, 0.61),
)
PANELS = ((0.79, 0.78, 0.75), (0.91, 0.91, 0.89), (0.40, 0.42, 0.45), (0.62, 0.57, 0.51), (0.71, 0.75, 0.78))
TILES = ((0.68, 0.36, 0.26), (0.60, 0.31, 0.23), (0.72, 0.43, 0.31), (0.42, 0.41, 0.43))
GRAVEL = ((0.63, 0.62, 0.60), (0.54, 0.54, 0.54), (0.70, 0.67, 0.62), (0.58, 0.59, 0.57))


class Style(NamedTuple):
    """What two buildings must have in common to share a pattern."""

    kind: str
    across: int = 0
    deep: int = 0
    floors: int = 0
    corner: int = 0


def place_buildings(
    layout: Layout, *, detail: int, occluders: Occluders, ground: float, rng: np.random.Generator
) -> list[Transform]:
    """One transform per lot, in the coordinates of its block; buildings stand at the height `ground`."""
    n = len(layout.block)
    width = layout.size[:, 0] - np.where(layout.corner != 0, 1.3, 0.7)
    depth = np.where(layout.corner != 0, 1.0, rng.uniform(0.78, 1.0, n)) * (ROW - SETBACK)
    floors = np.exp(rng.normal(np.log(2.3 + 7.6 * layout.density), 0.38)).clip(1.7, 34.0)
    # fronts stay in line: what a building lacks in depth is missing at its back
    turn = np.radians(layout.angle)
    forward = (layout.size[:, 1] - depth) / 2 - SETBACK
    middle = layout.center + forward[:, None] * np.column_stack([np.sin(turn), -np.cos(turn)])

    styles = _styles(layout, width, depth, floors, rng) if detail else [Style("plain")] * n
    known = {style: _pattern(style, detail, occluders) for style in dict.fromkeys(styles)}
    height = floors * np.where(floors > 5.5, 3.6, 3.2) + 0.8
    size = np.column_stack([width, depth, height])
    matrices = placements(
        np.insert(middle, 2, ground, axis=1),
        angle=layout.angle,
        scale=size / np.array([known[style].size for style in styles]),
    )
    paint = rng.integers(0, 1 << 16, (n, 2)).tolist()
    return [
        _building(style.kind, known[style], matrix, dice, f"building {i}")
        for i, (style, matrix, dice) in enumerate(zip(styles, matrices, paint, strict=True))
    ]


def _styles(layout: Layout, width: Floats, depth: Floats, floors: Floats, rng: np.random.Generator) -> list[Style]:
    step = FLOORS[np.argmin(np.abs(np.log(floors[:, None] / FLOORS)), axis=1)]
    luck = rng.random(len(step))
    kind = np.where(step <= 3, "house", np.where(step >= 14, "tower", "apartments")).astype("<U10")
    kind[(step == 4) & (luck < 0.3)] = "house"
    kind[(step >= 6) & (step <= 11) & (luck < 0.55)] = "offices"
    pitch = np.array([BAY[k] for k in kind.tolist()])
    bays: NDArray[np.int64] = np.maximum(np.round(np.column_stack([width, depth]) / pitch[:, None]), 2).astype(int)
    columns = (kind.tolist(), bays[:, 0].tolist(), bays[:, 1].tolist(), step.tolist(), layout.corner.tolist())
    return [Style(*values) for values in zip(*columns, strict=True)]


def _pattern(style: Style, detail: int, occluders: Occluders) -> Pattern:
    """The pattern of a style; whatever is random about it follows from the style alone, so that it can be shared."""
    rng = np.random.default_rng([style.across, style.deep, style.floors, style.corner + 1])
    bays = (style.across, style.deep)
    match style.kind:
        case "house":
            made = house(bays, style.floors, style.corner, detail)
        case "apartments":
            made = patterns.apartments(bays, style.floors, style.corner, detail, rng)
        case "offices":
            made = patterns.offices(bays, style.floors, detail, rng)
        case "tower":
            made = patterns.tower(bays, style.floors, detail, rng)
        case _:
            made = patterns.plain()
    return made.only(*(("planar", "solid") if occluders == "both" else (occluders,)))


def _building(kind: str, pattern: Pattern, matrix: Floats, dice: list[int], name: str) -> Transform:
    wall = {"house": PLASTER, "plain": PLASTER, "apartments": MASONRY}.get(kind, PANELS)
    color = wall[dice[0] % len(wall)]
    children = [occluder_copy(o) for o in pattern.occluders]
    if kind == "plain":
        return Transform(Geode(pattern.body, color=color), *children, matrix=matrix, name=name)
    cover = TILES if kind == "house" else GRAVEL
    return Transform(
        Geode(pattern.body, name="body", color=color if kind == "house" else None),
        Geode(pattern.facade, name="facade", color=None if kind == "house" else color),
        Geode(pattern.roof, name="roof", color=cover[dice[1] % len(cover)]),
        *children,
        matrix=matrix,
        name=name,
    )
