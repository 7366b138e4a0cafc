"""Many copies of one mesh in a cube: nothing to follow, no large occluders, the hardest case for occlusion culling.

Kristmann (2022) scatters up to 10 000 bunnies in this way, looks at them from outside and then flies in; give
`model="bunny.ply"` for that. Without a model the copies are pebbles, whose round core is a declared occluder.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from ..errors import SceneError
from ..mesh import Mesh
from ..nodes import Geode, Group, Node, Transform
from ..occluder import Occluder
from ..scene import Scene
from .paths import enter, orbit
from .shapes import Floats, Shape, bumps, icosphere, occluder_copy, vertex_normals

#: Copies along the edge of a group's cell, roughly.
CELL = 4
#: Radius around the flight path, in largest half sizes of a copy, in which there are no copies.
CORRIDOR = 1.5
BACKGROUND = (0.90, 0.91, 0.93)

PALETTE = (
    (0.80, 0.42, 0.33),
    (0.88, 0.66, 0.38),
    (0.55, 0.66, 0.48),
    (0.38, 0.55, 0.65),
    (0.86, 0.82, 0.74),
    (0.56, 0.47, 0.62),
)


def build(*, count: int = 1000, model: str = "", mesh: str = "pebble", spacing: float = 10.0, seed: int = 1) -> Scene:
    """Copies of a mesh scattered in a cube.

    Parameters
    ----------
    count : int
        At least 1.
    model : str
        A model file; its triangles become the one mesh, scaled to the size of a pebble.
    mesh : {"pebble", "knot"}
        What is scattered when there is no model.
    spacing : float
        Edge of the cube that one copy has to itself on average, in meters; copies are 2 to 6 meters across.
    seed : int

    Returns
    -------
    Scene
        With the paths "orbit" (outside) and "enter" (from outside to the center, along a corridor that is kept free).

    Raises
    ------
    SceneError
        An option out of range, or a model that cannot be read.
    """
    if count < 1:
        raise SceneError(f"scatter: count={count}; it must be at least 1")
    if not (np.isfinite(spacing) and spacing > 0):
        raise SceneError(f"scatter: spacing={spacing}; it must be positive")
    if mesh not in ("pebble", "knot"):
        raise SceneError(f"scatter: mesh={mesh!r}; choose pebble or knot, or give a model")
    rng = np.random.default_rng(seed)
    core: Occluder | None = None
    if model:
        pattern = one_mesh(Scene.load(model))
    elif mesh == "pebble":
        pattern, core = pebble(rng)
    else:
        pattern = knot()

    edge = spacing * count ** (1 / 3)
    size = rng.uniform(1.0, 3.0, count)
    place = rng.uniform(-edge / 2, edge / 2, (count, 3))
    blocked = _in_corridor(place, size)
    while blocked.any():
        place[blocked] = rng.uniform(-edge / 2, edge / 2, (int(blocked.sum()), 3))
        blocked = _in_corridor(place, size)
    matrices = np.zeros((count, 4, 4))
    matrices[:, :3, :3] = _rotations(count, rng) * size[:, None, None]
    matrices[:, :3, 3], matrices[:, 3, 3] = place, 1.0
    paint = rng.integers(0, len(PALETTE), count)

    own = pattern.color is not None or pattern.vertex_colors is not None
    copies: list[Node] = []
    for matrix, color in zip(matrices, paint.tolist(), strict=True):
        hides = [] if core is None else [occluder_copy(core)]
        copies.append(Transform(Geode(pattern, color=None if own else PALETTE[color]), *hides, matrix=matrix))
    scene = Scene(name="scatter", background=BACKGROUND)
    scene.add(*in_cells(copies, place + edge / 2, CELL * spacing))
    bounds = np.array([[-edge / 2] * 3, [edge / 2] * 3])
    scene.paths = {"orbit": orbit(bounds, count=40, elevation=15.0, margin=0.85), "enter": enter(bounds)}
    return scene


def in_cells(nodes: Sequence[Node], place: Floats, width: float) -> list[Group]:
    """Nodes at places (k, 3), relative to a corner, in one group per cubic cell of a grid, ordered by cell."""
    cells: dict[tuple[int, ...], list[Node]] = defaultdict(list)
    keys = np.floor(place / width).astype(int)
    for key, node in zip(keys.tolist(), nodes, strict=True):
        cells[tuple(key)].append(node)
    return [Group(*below, name="cell {}-{}-{}".format(*key)) for key, below in sorted(cells.items())]


def _in_corridor(place: Floats, size: Floats) -> np.ndarray:
    """(k,) whether copies reach into the flight path, which runs from outside along +x to the center."""
    beside = np.hypot(place[:, 1], place[:, 2])
    off = np.where(place[:, 0] > 0, beside, np.linalg.norm(place, axis=1))
    return np.asarray(off < CORRIDOR * size + 0.5)


def _rotations(count: int, rng: np.random.Generator) -> Floats:
    """(k, 3, 3) uniformly random rotations, from unit quaternions."""
    q = rng.normal(size=(count, 4))
    w, x, y, z = (q / np.linalg.norm(q, axis=1, keepdims=True)).T
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)


def pebble(rng: np.random.Generator, levels: int = 3) -> tuple[Mesh, Occluder]:
    """Bumpy ball of about unit radius and 20·4^levels triangles, and a core inside it: an icosahedron."""
    directions, faces = icosphere(levels)
    points = directions * (1.0 + 0.14 * bumps(directions, rng))[:, None]
    # the surface is star-shaped: whatever is nearer to the center than every face plane lies inside
    a, b, c = (points[faces[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    inside = float(((normal * a).sum(axis=1) / np.linalg.norm(normal, axis=1)).min())
    corners, _ = icosphere(0)
    mesh = Mesh(points, faces, name="pebble", normals=vertex_normals(points, faces))
    return mesh, Occluder.solid(0.99 * inside * corners, name="core")


def knot(around: int = 96, across: int = 10) -> Mesh:
    """Trefoil-like torus knot within the unit sphere."""
    t = 2 * np.pi * np.arange(around) / around

    def line(t: Floats) -> Floats:
        r = 2 + np.cos(3 * t)
        return np.stack([r * np.cos(2 * t), r * np.sin(2 * t), np.sin(3 * t)], axis=1) * 0.27

    center, ahead = line(t), line(t + 1e-3) - line(t - 1e-3)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    side = np.cross(ahead, center)
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    over = np.cross(side, ahead)
    turn = 2 * np.pi * np.arange(across) / across
    tube = np.cos(turn)[:, None] * side[:, None] + np.sin(turn)[:, None] * over[:, None]
    points = (center[:, None] + 0.14 * tube).reshape(-1, 3)
    i, j = (a.ravel() for a in np.meshgrid(np.arange(around), np.arange(across), indexing="ij"))
    after, beside = (i + 1) % around * across, (j + 1) % across
    a, b, c, d = i * across + j, i * across + beside, after + beside, after + j
    faces = np.concatenate([np.stack([a, c, b], axis=1), np.stack([a, d, c], axis=1)])
    return Mesh(points, faces, name="knot", normals=vertex_normals(points, faces))


def one_mesh(scene: Scene) -> Mesh:
    """All drawables of a scene as one mesh, centered and within the unit sphere, colored as they were.

    Raises
    ------
    SceneError
        If nothing in the scene has finite bounds.
    """
    snapshot = scene.snapshot()
    rows = np.flatnonzero(~snapshot.unknown)
    if not len(rows):
        raise SceneError(f"scene {scene.name!r}: no drawable has finite bounds, so it cannot be scattered")
    meshes = [snapshot.meshes[k] for k in snapshot.level_meshes[rows, 0]]
    shape = Shape()
    for row, mesh in zip(rows.tolist(), meshes, strict=True):
        matrix = snapshot.transforms[snapshot.transform_index[row]]
        points = mesh.vertices @ matrix[:3, :3].T + (matrix[:3, 3] - snapshot.origin)
        shape.surface(points, mesh.faces, snapshot.colors[row].tolist() if len(meshes) > 1 else None)
    whole = shape.mesh(name=scene.name)
    used = whole.vertices[np.unique(whole.faces)]
    middle = (used.min(axis=0) + used.max(axis=0)) / 2
    radius = float(np.linalg.norm(used - middle, axis=1).max()) or 1.0
    points, faces = (whole.vertices - middle) / radius, whole.faces
    smooth = len(meshes) == 1 and meshes[0].normals is not None
    return Mesh(
        points,
        faces,
        name=scene.name,
        vertex_colors=whole.vertex_colors,
        normals=vertex_normals(points, faces.astype(np.int64)) if smooth else None,
    )
