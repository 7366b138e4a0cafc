"""A sparse site: temples, halls and groves of an ancient sanctuary on open ground below a hill.

The character is that of the "Ancient Olympia" test of Papaioannou et al. (2006, section 4): about 250 000 triangles,
most of them in columns and trees, few large structures, and a walk that comes close to buildings at three moments
A, B and C, where both visible sides of a building together hide what neither side hides alone. The plan follows the
excavated site loosely; nothing here is a reconstruction.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from itertools import pairwise

import numpy as np

from ..errors import SceneError
from ..mesh import Mesh
from ..nodes import Geode, Group, Node, Transform
from ..scene import Scene
from . import furniture, temples
from .landscape import Landscape, build_landscape
from .paths import Moment, closest, distance_to_line, orbit, walk
from .shapes import Floats, Shape, placements
from .temple_parts import LIMESTONE, MARBLE, TERRACOTTA

LAND = Landscape(
    level=(-200.0, -170.0, 370.0, 130.0), hill=(35.0, 225.0, 105.0, 58.0), river=-262.0, reach=900.0, seed=3
)
TILES = (TERRACOTTA, (0.70, 0.47, 0.36), (0.79, 0.53, 0.40), (0.62, 0.40, 0.32))
BRONZE, PAINTED = (0.44, 0.40, 0.28), (0.88, 0.80, 0.70)

#: Footsteps of the walk: from the gate past the great temple, the round temple, the hill's foot and the long stoa.
WALK = (
    (-92, -62), (-60, -57), (-22, -52), (14, -52), (36, -48), (40, -18), (10, 2), (2, 44), (-4, 58.5), (-28, 57),
    (-58, 53), (-66, 78), (-50, 88), (4, 90), (35, 88.5), (62, 90), (88, 78), (95, 52), (97, 20), (97, -12),
)  # fmt: skip
MOMENTS = (
    Moment("A", (14.0, -52.0, 1.7), (3.0, -40.0, 4.5), 14.0),
    Moment("B", (-4.0, 58.5, 1.7), (-15.0, 67.0, 4.0), 12.0),
    Moment("C", (35.0, 88.5, 1.7), (45.0, 80.0, 3.5), 12.0),
)


def build(*, seed: int = 1, trees: int = 1200, views: int = 72) -> Scene:
    """Sparse ancient site: temples, halls, statues and groves on open ground.

    Parameters
    ----------
    seed : int
        Where trees and statues stand; the buildings are always the same.
    trees : int
        How many trees there are; 1200 make about 250 000 triangles in all.
    views : int
        Length of the path "walk"; "overview" has 48 views.

    Returns
    -------
    Scene
        With the paths "walk" (three close-ups) and "overview" (an orbit), and the close-ups "A", "B", "C" as single
        views.

    Raises
    ------
    SceneError
        An option out of range.
    """
    if trees < 0:
        raise SceneError(f"olympia: trees={trees}; it cannot be negative")
    if views < 2:
        raise SceneError(f"olympia: views={views}; a walk needs at least 2")
    rng = np.random.default_rng(seed)
    ground, hill = build_landscape(LAND)
    scene = Scene(name="olympia", background=(0.74, 0.83, 0.91))
    scene.add(ground, hill, _altis(rng), _west(), _north(rng), _east(), _groves(trees, rng))
    path = walk(np.insert(np.array(WALK, np.float64), 2, 0.0, axis=1), count=views, moments=MOMENTS, swing=22.0)
    scene.paths = {
        "walk": path,
        "overview": orbit([(-150, -130, 0), (150, 130, 20)], elevation=22.0, margin=0.85, fov=45.0),
    }
    scene.views = {m.name: closest(path, m.at) for m in MOMENTS}
    return scene


def _altis(rng: np.random.Generator) -> Group:
    """The sacred precinct: three temples, altar, grove and statues within walls."""
    figure = furniture.statue(rng, color=PAINTED, pedestal=0.0)
    group = Group(
        temples.temple("temple of Zeus", (-10, -30, 0), length=61, width=25.5, front=6, flank=13, column=10.4,
                       marble_tiles=True, figure=figure),
        temples.temple("temple of Hera", (-35, 72, 0), length=47.5, width=16.5, front=6, flank=16, column=5.2),
        temples.temple("Metroon", (51, 76, 0), length=18.5, width=8.8, front=6, flank=11, column=4.6),
        temples.tholos("Philippeion", (-80, 62, 0), radius=7.6, column=6.2),
        temples.altar("altar of Zeus", (22, 32, 180), radius=10.5, height=6.5),
        name="altis",
    )  # fmt: skip
    corner = 2 * np.pi * (np.arange(6) + 0.5) / 6
    ring = np.column_stack([-28 + 17 * np.cos(corner), 18 + 17 * np.sin(corner)])
    # five sides of a hexagon: the gate is where the sixth would be
    sides = [temples.wall(f"side {k}", (*a,), (*b,), height=1.9) for k, (a, b) in enumerate(pairwise(ring.tolist()))]
    group.add(Group(*sides, name="Pelopion"))
    walls = [
        ((-97, -75), (-97, -66)),
        ((-97, -58), (-97, 30)),
        ((-97, 38), (-97, 100)),
        ((-97, -75), (-40, -75)),
        ((-28, -75), (62, -75)),
        ((74, -75), (112, -75)),
        ((112, -75), (112, -34)),
    ]
    group.add(Group(*(temples.wall(f"wall {k}", a, b, height=3.0) for k, (a, b) in enumerate(walls)), name="walls"))
    column = Shape().boxes((-1.2, -1.2, 0), (1.2, 1.2, 1.0), color=MARBLE)
    base = np.array([[1.0, 0.0], [-0.5, 0.87], [-0.5, -0.87]])
    low, high = np.insert(1.1 * base, 2, 1.0, axis=1), np.insert(0.8 * base, 2, 9.0, axis=1)
    column.prism(low, high, MARBLE)
    nike = furniture.statue(rng, color=PAINTED, height=2.9, pedestal=0.4)
    group.add(Transform(Geode(column.mesh(name="pillar")), Transform(Geode(nike), translation=(0, 0, 9.0)),
                        translation=(42, -38, 0), name="Nike"))  # fmt: skip
    figures = [furniture.statue(rng, color=c) for c in (BRONZE, MARBLE, PAINTED)]
    along = np.linspace(-40, 30, 15)
    rows = [
        np.column_stack([along, np.full(15, -64.0)]),
        np.column_stack([along, np.full(15, -5.5)]),
        rng.uniform((25, -30), (85, 20), (26, 2)),
        rng.uniform((-85, -40), (-50, 40), (14, 2)),
    ]
    return group.add(Group(*_standing(figures, _free(np.concatenate(rows), 0.0), rng), name="statues"))


def _west() -> Group:
    """Guest house, workshop and wrestling school beyond the wall."""
    return Group(
        temples.court("Leonidaion", (-150, -112, 0), size=(74, 68), wing=13, height=6.2, bay=2.6, outer=True),
        temples.house("workshop", (-140, -24, 90), length=32, width=14, height=9),
        temples.court("Theokoleon", (-145, 22, 0), size=(36, 34), wing=8, height=4.6, bay=2.6, outer=False),
        temples.court("Palaestra", (-155, 88, 0), size=(66, 66), wing=11, height=5.2, bay=2.8, outer=False),
        name="west",
    )


def _north(rng: np.random.Generator) -> Group:
    """Treasuries on a terrace at the foot of the hill, council house, and bronze statues before them."""
    terrace = temples.embankment("terrace", (92, 112, 0), length=136, foot=19, crown=16, height=2.4, color=LIMESTONE)
    group = Group(terrace, temples.court("Prytaneion", (-60, 112, 0), size=(33, 33), wing=8, height=4.4, bay=2.4,
                                         outer=False), name="north")  # fmt: skip
    for k in range(12):
        size = rng.uniform((7.0, 5.2, 3.4), (9.0, 6.8, 4.2))
        length, width, column = (float(s) for s in size)
        place = (30 + 11.2 * k, 112, -90)
        node = temples.treasury(
            f"treasury {k + 1}", place, length=length, width=width, column=column, tiles=TILES[k % 4], lift=2.4
        )
        group.add(node)
    figures = [furniture.statue(rng, color=BRONZE) for _ in range(2)]
    zanes = np.column_stack([np.linspace(66, 150, 16), np.full(16, 99.0)])
    return group.add(Group(*_standing(figures, _free(zanes, 0.0), rng), name="Zanes"))


def _east() -> Group:
    """Long stoas, council chambers and the stadium."""
    grass = (0.58, 0.60, 0.38)
    stadium = Group(
        temples.embankment("north bank", (250, 92, 0), length=215, foot=24, crown=5, height=4.5, color=grass),
        temples.embankment("south bank", (250, 30, 0), length=215, foot=24, crown=5, height=4.5, color=grass),
        temples.embankment("west bank", (133, 48, 90), length=50, foot=16, crown=5, height=4.0, color=grass),
        Geode(Shape().boxes((145, 45, -0.5), (352, 77, 0.05), ["+z"]).mesh(name="track", color=(0.78, 0.70, 0.53))),
        name="stadium",
    )
    return Group(
        temples.stoa("Echo stoa", (116, 20, -90), length=98, depth=12.5, columns=44, column=5.4),
        temples.stoa("south stoa", (2, -118, 0), length=80, depth=14, columns=34, column=5.4),
        temples.house("north hall", (36, -88, 0), length=30, width=13, height=6.5),
        temples.house("south hall", (36, -106, 0), length=30, width=13, height=6.5),
        stadium,
        name="east",
    )


# -- scattered things ------------------------------------------------------------------------------------------------

#: Rectangles x0, y0, x1, y1 that trees and statues keep out of.
BUILT = np.array([
    (-48, -50, 28, -10), (-64, 60, -6, 84), (38, 69, 64, 83), (-90, 52, -70, 72), (8, 18, 36, 46),
    (-195, -154, -106, -70), (-150, -44, -130, -4), (-166, 2, -124, 42), (-191, 52, -119, 124), (-80, 92, -40, 132),
    (20, 101.5, 164, 126), (108, -32, 124, 72), (-42, -128, 46, -78), (118, 14, 362, 108), (-100, -78, -94, 104),
    (-100, -78, 116, -72), (36, -42, 48, -32),
])  # fmt: skip


def _free(at: Floats, room: float) -> Floats:
    """Those of the places (k, 2) that keep clear of buildings and of the walk."""
    x, y = at[:, :1], at[:, 1:]
    x0, y0, x1, y1 = BUILT.T
    inside = (x > x0 - room) & (x < x1 + room) & (y > y0 - room) & (y < y1 + room)
    return np.asarray(at[~inside.any(axis=1) & (distance_to_line(at, WALK) > 2.2 + room)])


def _standing(
    meshes: list[Mesh], at: Floats, rng: np.random.Generator, size: tuple[float, float] = (1.0, 1.0)
) -> list[Node]:
    """One of the meshes on each place (k, 2), turned and scaled at random."""
    where = np.column_stack([at, LAND.height(*at.T) - 0.05])
    matrices = placements(where, angle=rng.uniform(0, 360, len(at)), scale=rng.uniform(*size, (len(at), 1)))
    picks = rng.integers(0, len(meshes), len(at))
    return [Transform(Geode(meshes[k]), matrix=m) for k, m in zip(picks.tolist(), matrices, strict=True)]


def _groves(count: int, rng: np.random.Generator) -> Group:
    """Olives and plane trees on the level ground, pines on the hill, cypresses and bushes by the river, in cells."""
    cx, cy, radius, _ = LAND.hill
    centers = rng.uniform((-235, -230), (330, 150), (40, 2))

    def clustered(k: int) -> Floats:
        return np.asarray(centers[rng.integers(0, len(centers), k)] + rng.normal(scale=13.0, size=(k, 2)))

    def hillside(k: int) -> Floats:
        turn, out = rng.uniform(0, 2 * np.pi, k), radius * np.sqrt(rng.uniform(0.02, 1.1, k))
        return np.column_stack([cx + out * np.cos(turn), cy + out * np.sin(turn)])

    def riverside(k: int) -> Floats:
        return np.column_stack([LAND.river + 34 + rng.exponential(8, k), rng.uniform(-320, 320, k)])

    kinds: list[tuple[float, list[Mesh], Callable[[int], Floats]]] = [
        (0.40, [furniture.olive(rng) for _ in range(3)], clustered),
        (0.14, [furniture.broadleaf(rng, height=h) for h in (8.0, 10.0)], clustered),
        (0.30, [furniture.conifer(rng, height=h) for h in (8.0, 11.0)], hillside),
        (0.08, [furniture.conifer(rng, height=11.0, slim=True)], riverside),
        (0.08, [furniture.bush(rng)], clustered),
    ]
    cells: dict[tuple[int, int], list[Node]] = defaultdict(list)
    for share, meshes, spread in kinds:
        wanted = round(share * count)
        at = np.empty((0, 2))
        while len(at) < wanted:
            at = np.concatenate([at, _free(spread(wanted), 3.0)])[:wanted]
        for place, tree in zip(at, _standing(meshes, at, rng, (0.7, 1.25)), strict=True):
            cells[int(place[0] // 90), int(place[1] // 90)].append(tree)
    return Group(*(Group(*nodes, name=f"grove {i} {j}") for (i, j), nodes in sorted(cells.items())), name="groves")
