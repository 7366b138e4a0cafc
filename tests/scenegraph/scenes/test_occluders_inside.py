"""What the scenes declare as occluders lies inside what they draw: points of it have odd parity in a closed piece.

Parity is counted here by an own ray test on closed, connected pieces of the meshes, so that neither the builders nor a
library is believed. Occluders that share a shape under the same meshes are tested once.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scenegraph import Geode, Group, Mesh, Occluder, Scene, Transform
from scenegraph.scenes import city, olympia, scatter

Floats = NDArray[np.float64]

#: No face of a scene lies along it.
DIRECTION = np.array([0.36, 0.48, 0.80]) + np.array([0.0123, -0.0217, 0.0071])

SCENES = {
    "city": lambda: city.build(buildings=150),
    "city 0": lambda: city.build(buildings=100, detail=0),
    "city 2": lambda: city.build(buildings=40, detail=2),
    "olympia": lambda: olympia.build(trees=10),
    "scatter": lambda: scatter.build(count=30),
}


@pytest.fixture(scope="module", params=SCENES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return SCENES[request.param]()


def closed_pieces(mesh: Mesh, matrix: Floats) -> list[Floats]:
    """Triangles (f, 3, 3) of the connected pieces in which every edge is shared by two faces."""
    corners = mesh.vertices[mesh.faces] @ matrix[:3, :3].T + matrix[:3, 3]
    _, index = np.unique(np.round(corners.reshape(-1, 3), 7), axis=0, return_inverse=True)
    faces = index.reshape(-1, 3)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    size = int(faces.max()) + 1
    _, label = connected_components(coo_array((np.ones(len(edges)), edges.T), shape=(size, size)), directed=False)
    pieces = []
    for which in np.unique(label[faces[:, 0]]):
        mine = label[faces[:, 0]] == which
        _, uses = np.unique(edges[np.repeat(mine, 3)], axis=0, return_counts=True)
        if (uses % 2 == 0).all():
            pieces.append(corners[mine])
    return pieces


def crossings(points: Floats, triangles: Floats, direction: Floats) -> NDArray[np.int64]:
    """(p,) number of triangles (f, 3, 3) that rays from points (p, 3) meet (Möller and Trumbore 1997)."""
    a, u, v = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    h = np.cross(direction, v)
    scale = (u * h).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        s = points[:, None] - a
        x = (s * h).sum(axis=2) / scale
        q = np.cross(s, u)
        y = (q @ direction) / scale
        t = (q * v).sum(axis=2) / scale
        hit = (x >= 0) & (y >= 0) & (x + y <= 1) & (t > 0)
    return hit.sum(axis=1)


def inside(points: Floats, pieces: list[Floats]) -> NDArray[np.bool_]:
    found = np.zeros(len(points), bool)
    for piece in pieces:
        found |= crossings(points, piece, DIRECTION) % 2 == 1
    return found


def owned(node: Group, matrix: Floats) -> Iterator[tuple[Geode, Floats]]:
    for child in node:
        if isinstance(child, Geode):
            yield child, matrix
        elif isinstance(child, Transform):
            yield from owned(child, matrix @ child.matrix)
        elif isinstance(child, Group):
            yield from owned(child, matrix)


def distinct(scene: Scene, kind: str) -> Iterator[tuple[Occluder, list[tuple[Geode, Floats]]]]:
    """Occluders of a kind with the drawables around them, each combination of shapes once."""
    seen = set()
    for node in scene.root.walk():
        if isinstance(node, Occluder) and node.kind == kind:
            assert isinstance(node.parent, Group)
            around = [(g, m) for g, m in owned(node.parent, np.eye(4)) if g.mesh.name != "column"]
            key = (node.vertices.tobytes(), *(id(g.mesh) for g, _ in around))
            if key not in seen:
                seen.add(key)
                yield node, around


def mixtures(corners: Floats, rng: np.random.Generator, count: int = 60) -> Floats:
    """The corners, hardly drawn in, and random convex combinations of them, most of them near a few corners."""
    weights = rng.dirichlet(np.full(len(corners), 0.25), count)
    middle = corners.mean(axis=0)
    return np.concatenate([corners + 1e-6 * (middle - corners), weights @ corners])


@pytest.mark.parametrize("kind", ["solid", "planar"])
def test_occluders_lie_inside_closed_pieces(scene: Scene, kind: str, rng: np.random.Generator) -> None:
    tested = 0
    for occluder, around in distinct(scene, kind):
        points = mixtures(occluder.vertices, rng)
        if occluder.parent is not None and occluder.parent.name == "hill":
            # the ground is open: below it is inside, so a ray straight up meets it an odd number of times
            (hill, _), *_ = around
            up = np.array([0.0, 0.0, 1.0])
            is_in = crossings(points, hill.mesh.vertices[hill.mesh.faces], up) % 2 == 1
        else:
            is_in = inside(points, [p for g, m in around for p in closed_pieces(g.mesh, m)])
        assert is_in.all(), (occluder.path(), points[~is_in][:3])
        tested += 1
    assert tested or (scene.name == "scatter" and kind == "planar")


def test_solids_lie_within_the_bounds_of_what_owns_them(scene: Scene) -> None:
    snapshot = scene.snapshot()
    table = snapshot.occluders
    low, high = snapshot.boxes[:3] - snapshot.boxes[3:], snapshot.boxes[:3] + snapshot.boxes[3:]
    for i in range(len(table)):
        first, end = table.owner[i]
        assert end > first, table.nodes[i].path()
        corners = table.vertices[table.vertex_first[i] : table.vertex_first[i + 1]].T
        assert (corners > low[:, first:end].min(axis=1, keepdims=True) - 1e-9).all(), table.nodes[i].path()
        assert (corners < high[:, first:end].max(axis=1, keepdims=True) + 1e-9).all(), table.nodes[i].path()


@pytest.mark.parametrize("build", [SCENES["city"], SCENES["city 0"]])
def test_facades_lie_just_behind_the_faces_that_they_stand_for(build: object) -> None:
    scene = build()  # type: ignore[operator]
    rng = np.random.default_rng(0)
    for occluder, around in distinct(scene, "planar"):
        assert not occluder.two_sided
        p = occluder.vertices
        outward = np.cross(p[1] - p[0], p[2] - p[1])
        outward /= np.linalg.norm(outward)
        points = mixtures(p, rng, 20)
        pieces = [piece for g, m in around for piece in closed_pieces(g.mesh, m) if g.name in ("body", "box")]
        covered = inside(points, pieces)
        gone = ~inside(points + 0.05 * outward, pieces)
        assert covered.all()
        # a shaft's facade goes on behind the podium; everything else has its wall directly before it
        assert gone.mean() > 0.6 or "tower" in {g.mesh.name for g, _ in around}


def test_shared_shapes_are_equal_to_checked_ones(scene: Scene) -> None:
    """Copies skip the checks of `Occluder.planar` and `Occluder.solid`; making them anew gives the same polygons."""
    for kind in ("solid", "planar"):
        for node, _ in distinct(scene, kind):
            if kind == "planar":
                again = Occluder.planar(node.vertices, two_sided=node.two_sided)
                assert np.array_equal(again.vertices, node.vertices)
            else:
                again = Occluder.solid(node.vertices)
                assert len(again.faces) == len(node.faces)
                center = node.vertices.mean(axis=0)
                for face in node.faces:
                    corners = node.vertices[list(face)]
                    normal = np.cross(corners[1] - corners[0], corners[2] - corners[1])
                    assert normal @ (corners[0] - center) > 0
