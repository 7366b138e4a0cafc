"""A dense city of any size: perimeter blocks around yards, houses at its edge and towers in its middle.

The dense test scene of Papaioannou et al. (2006, section 4) is a model city of about 500 000 triangles in which "each
building is associated with a single though sub-optimal occluder"; here a building has one solid (a tower two) and its
facades as planar occluders, so that the two kinds can be compared on the same camera path.
"""

from __future__ import annotations

from collections import defaultdict

import numpy as np

from ..errors import SceneError
from ..mesh import Mesh
from ..nodes import Geode, Group, Node, Transform
from ..scene import Scene
from . import furniture
from .city_layout import BLOCK, PITCH, ROAD, ROW, SIDEWALK, Layout, lay_out, street_walk
from .city_stock import Occluders, place_buildings
from .paths import closest, distance_to_line, orbit, walk
from .shapes import NO_BOTTOM, Floats, Shape, placements

#: Height of a curb in meters.
CURB = 0.15
#: Blocks along the edge of a district.
DISTRICT = 4

PAINT = ((0.75, 0.76, 0.77), (0.20, 0.23, 0.27), (0.60, 0.16, 0.14), (0.18, 0.30, 0.48), (0.86, 0.84, 0.78))
GREEN = ((0.36, 0.50, 0.25), (0.42, 0.53, 0.27), (0.30, 0.45, 0.26))
ASPHALT, PAVEMENT, LAWN = (0.37, 0.37, 0.37), (0.66, 0.65, 0.63), (0.47, 0.58, 0.33)
FIELDS, MARKING = (0.55, 0.62, 0.42), (0.87, 0.87, 0.84)


def build(
    *, buildings: int = 2000, seed: int = 1, detail: int = 1, occluders: Occluders = "both", views: int = 72
) -> Scene:
    """Dense city with streets, perimeter blocks, trees, lamps and cars.

    Parameters
    ----------
    buildings : int
        At least 1. 2000 make about 500 000 triangles at detail 1.
    seed : int
        The same seed gives the same city, vertex for vertex.
    detail : int
        0: plain boxes of 12 triangles on a bare ground; 1: facades, roofs and street furniture; 2: finer ones.
    occluders : {"both", "solid", "planar", "none"}
        Which occluders the buildings own.
    views : int
        Length of the path "street"; "overview" has 48 views.

    Returns
    -------
    Scene
        With the paths "street" (a walk with three close-ups) and "overview" (an orbit), and the close-ups "A", "B",
        "C" as single views.

    Raises
    ------
    SceneError
        An option out of range.
    """
    if buildings < 1:
        raise SceneError(f"city: buildings={buildings}; a city needs at least 1")
    if detail not in (0, 1, 2):
        raise SceneError(f"city: detail={detail}; choose 0 (boxes), 1 or 2")
    if occluders not in ("both", "solid", "planar", "none"):
        raise SceneError(f"city: occluders={occluders!r}; choose both, solid, planar or none")
    if views < 2:
        raise SceneError(f"city: views={views}; a walk needs at least 2")
    rng = np.random.default_rng(seed)
    layout = lay_out(buildings, rng)
    route, moments = street_walk(layout)
    stock = place_buildings(layout, detail=detail, occluders=occluders, ground=CURB if detail else 0.0, rng=rng)
    blocks: dict[int, list[Node]] = defaultdict(list)
    for block, building in zip(layout.block.tolist(), stock, strict=True):
        blocks[block].append(building)
    if detail:
        _furnish(blocks, layout, route, detail, rng)
    scene = Scene(name="city").add(_ground(layout), *_districts(blocks, layout))

    street = walk(route, count=views, moments=moments, far=max(5000.0, 1.5 * float(layout.extent.max())))
    half = layout.extent / 2
    overview = orbit([(*-half, 0.0), (*half, 60.0)], elevation=20.0, margin=0.52, fov=45.0)
    scene.paths = {"street": street, "overview": overview}
    scene.views = {m.name: closest(street, m.at) for m in moments}
    return scene


def _districts(blocks: dict[int, list[Node]], layout: Layout) -> list[Group]:
    """Groups of DISTRICT x DISTRICT blocks; a block is a transform to its middle."""
    members: dict[tuple[int, int], list[Node]] = defaultdict(list)
    for block, nodes in sorted(blocks.items()):
        i, j = divmod(block, layout.blocks[1])
        place = np.append(layout.block_center(block), 0.0)
        node = Transform(*nodes, translation=place, name=f"block {i}-{j}")
        members[i // DISTRICT, j // DISTRICT].append(node)
    return [Group(*nodes, name=f"district {i}-{j}") for (i, j), nodes in members.items()]


# -- ground ----------------------------------------------------------------------------------------------------------


def _ground(layout: Layout) -> Group:
    """Asphalt in tiles as large as districts, and fields around the city to the horizon."""
    group = Group(name="ground")
    edge = layout.extent / 2 + ROAD + SIDEWALK
    x, y = (np.append(np.arange(0, b, DISTRICT), b) * PITCH - b * PITCH / 2 for b in layout.blocks)
    x[[0, -1]], y[[0, -1]] = (-edge[0], edge[0]), (-edge[1], edge[1])
    for i, j in np.ndindex(len(x) - 1, len(y) - 1):
        tile = Shape().boxes(np.array([x[i], y[j], -1.0]), np.array([x[i + 1], y[j + 1], 0.0]), ["+z"])
        group.add(Geode(tile.mesh(name="asphalt", color=ASPHALT)))
    outer = edge + 1.5 * float(layout.extent.max()) + 400.0
    u, v = (np.array([-o, -e, e, o]) for o, e in zip(outer, edge, strict=True))
    ring = [(i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    low = np.array([(u[i], v[j], -1.0) for i, j in ring])
    high = np.array([(u[i + 1], v[j + 1], 0.0) for i, j in ring])
    return group.add(Geode(Shape().boxes(low, high, ["+z"]).mesh(name="fields", color=FIELDS)))


def _slab(yard: float) -> Mesh:
    """Pavement of a block with a lawn in its middle that reaches `yard` meters from there."""
    shape, edge = Shape(), BLOCK + SIDEWALK
    shape.boxes((-edge, -edge, 0.0), (edge, edge, CURB), NO_BOTTOM, PAVEMENT)
    shape.boxes((-yard, -yard, CURB), (yard, yard, CURB + 0.08), NO_BOTTOM, LAWN)
    return shape.mesh(name="pavement")


def _markings() -> Mesh:
    """Center lines and crossings of the two streets south and west of a block."""
    dashes = np.arange(-BLOCK + 4, BLOCK - 2, 10.0)
    stripes = np.arange(-ROAD + 1.2, ROAD - 0.5, 1.6)
    # low corners and sizes along a street that runs in x, relative to its middle
    along = [np.column_stack([dashes, np.full(len(dashes), -0.08)])]
    along += [np.column_stack([np.full(len(stripes), end - 1.5), stripes - 0.3]) for end in (-BLOCK - 1, BLOCK + 1)]
    lows = np.concatenate(along) + (0.0, -PITCH / 2)
    highs = lows + np.repeat([(3.0, 0.16), (3.0, 0.6)], [len(dashes), 2 * len(stripes)], axis=0)
    shape = Shape()
    for turn in (1, -1):
        low, high = np.insert(lows[:, ::turn], 2, 0.0, axis=1), np.insert(highs[:, ::turn], 2, 0.02, axis=1)
        shape.boxes(low, high, ["+z"])
    return shape.mesh(name="markings", color=MARKING)


# -- street furniture ------------------------------------------------------------------------------------------------


def _furnish(
    blocks: dict[int, list[Node]], layout: Layout, route: Floats, detail: int, rng: np.random.Generator
) -> None:
    """Add pavement, markings, trees, lamps and cars to every block; what stands in the way of the walk is left out."""
    slab, green, markings = _slab(BLOCK - ROW - 2.0), _slab(BLOCK - 2.0), _markings()
    trees = [furniture.broadleaf(rng, green=g, levels=detail - 1) for g in GREEN]
    lamp, cars, fountain = furniture.street_lamp(detail), [furniture.car(c) for c in PAINT], furniture.fountain()
    pits, pit_angle = _along_curbs(np.array([-36.0, -12.0, 12.0, 36.0]), BLOCK + 2.5)
    posts, post_angle = _along_curbs(np.array([-24.0]), BLOCK + 3.0)
    bays, bay_angle = _along_curbs(np.arange(-37.0, 38.0, 6.0), BLOCK + SIDEWALK + 1.2)
    for block in range(layout.blocks[0] * layout.blocks[1]):
        nodes = blocks[block]
        is_park = not nodes
        line = route[:, :2] - layout.block_center(block)
        planted, parked = rng.random(len(pits)) < 0.22, rng.random(len(bays)) < 0.06
        lawn = (
            rng.uniform(-1, 1, (20, 2)) * (BLOCK - 5.0) if is_park else rng.uniform(-1, 1, (2, 2)) * (BLOCK - ROW - 6)
        )
        lawn = lawn[np.hypot(*lawn.T) > 7.0]
        reverse = 180.0 * (rng.random(len(bays)) < 0.5)
        things = [
            *_stood(trees, pits[planted], pit_angle[planted], 1.4, line, rng, (0.75, 1.15)),
            *_stood([lamp], posts, post_angle, 0.8, line, rng),
            *_stood(cars, bays[parked], (bay_angle + reverse)[parked], 3.0, line, rng),
            *_stood(trees, lawn, np.zeros(len(lawn)), 1.4, line, rng, (0.8, 1.5)),
        ]
        if is_park:
            things.append(Transform(Geode(fountain), translation=(0.0, 0.0, CURB)))
        nodes += [Geode(green if is_park else slab), Geode(markings), Group(*things, name="street")]


def _stood(
    meshes: list[Mesh],
    at: Floats,
    angle: Floats,
    room: float,
    line: Floats,
    rng: np.random.Generator,
    size: tuple[float, float] = (1.0, 1.0),
) -> list[Node]:
    """One of the meshes at each place (k, 2) that is farther than `room` from a line of footsteps."""
    picks, scale = rng.integers(0, len(meshes), len(at)), rng.uniform(*size, (len(at), 1))
    free = distance_to_line(at, line) > room
    matrices = placements(np.insert(at, 2, 0.0, axis=1), angle=angle, scale=scale)[free]
    return [Transform(Geode(meshes[k]), matrix=m) for k, m in zip(picks[free].tolist(), matrices, strict=True)]


def _along_curbs(along: Floats, out: float) -> tuple[Floats, Floats]:
    """Places (4k, 2) on the four sides of a block, `out` meters from its middle, and in degrees what faces outward."""
    turn = np.radians([0.0, 90.0, 180.0, 270.0])
    c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
    x, y = np.broadcast_to(along, (4, len(along))), -out
    at = np.stack([c * x - s * y, s * x + c * y], axis=-1)
    return at.reshape(-1, 2), np.repeat(np.degrees(turn), len(along))
