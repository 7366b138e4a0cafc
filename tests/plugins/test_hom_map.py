"""The map in NumPy against rays: a closed texel is closed to every ray through it, no farther than the map says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import scenegraph as sg
from scenegraph.testing import box_at, exact_visible_sets
from scenegraph_hom import Hom, OcclusionMap
from scenegraph_hom.shapes import occluder_shapes

F64 = NDArray[np.float64]


def rays_of(view: sg.View, size: tuple[int, int], x: F64, y: F64) -> tuple[F64, F64]:
    """(3,) or (k, 3) origins and (k, 3) directions, of one unit of depth, through map coordinates."""
    left, right, bottom, top = view.window
    u, v = left + x / size[0] * (right - left), bottom + y / size[1] * (top - bottom)
    right_axis, up_axis, _ = view.axes
    across = u[:, None] * right_axis + v[:, None] * up_axis
    if view.is_parallel:
        return np.asarray(view.eye) + across, np.broadcast_to(view.forward, across.shape)
    return np.broadcast_to(np.asarray(view.eye, float), across.shape), across + view.forward


def first_hits(triangles: F64, origin: F64, direction: F64, near: float) -> F64:
    """(k,) depth of the first triangle of (t, 3, 3) behind the near plane that each ray meets; ∞ if none."""
    best = np.full(len(direction), np.inf)
    for a, b, c in triangles:
        p, q = b - a, c - a
        normal = np.cross(p, q)
        away = direction @ normal
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            t = ((a - origin) @ normal) / away
            point = origin + t[:, None] * direction - a
            scale = normal @ normal
            u = np.cross(point, q) @ normal / scale
            v = np.cross(p, point) @ normal / scale
            inside = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (t >= near)
        best = np.where(inside & (t < best), t, best)
    return best


def random_mesh(rng: np.random.Generator, kinds: int = 6) -> sg.Mesh:
    """A box, a convex hull, a two-sided sheet, a box with missing sides, a soup, or a folded strip."""
    box = sg.Mesh.box((-1, -1, -1), (1, 1, 1))
    kind = rng.integers(kinds)
    if kind == 0:
        return box
    if kind == 1:
        from scipy.spatial import ConvexHull

        points = rng.uniform(-1, 1, (int(rng.integers(4, 20)), 3))
        return sg.Mesh(points, ConvexHull(points).simplices)
    if kind == 3:
        return sg.Mesh(box.vertices, rng.permutation(box.faces)[: rng.integers(6, 12)])
    if kind == 4:
        return sg.Mesh(rng.uniform(-1, 1, (9, 3)), [rng.permutation(9)[:3] for _ in range(6)])
    if kind == 5:
        x = np.linspace(-1, 1, 6)
        bend = rng.uniform(-0.6, 0.6, 6)
        points = np.array([(a, b, z) for a, b in zip(x, bend, strict=True) for z in (-1, 1)])
        strips = [(2 * i, 2 * i + 2, 2 * i + 1) for i in range(5)] + [
            (2 * i + 1, 2 * i + 2, 2 * i + 3) for i in range(5)
        ]
        return sg.Mesh(points, strips)
    square = [(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)]
    return sg.Mesh(square, [(0, 1, 2), (0, 2, 3), (2, 1, 0), (3, 2, 0)])


def random_scene(rng: np.random.Generator, count: int, kinds: int = 6) -> sg.Scene:
    nodes = []
    for _ in range(count):
        matrix = np.eye(4)
        matrix[:3, :3] = rng.standard_normal((3, 3)) * rng.uniform(0.5, 3)
        matrix[:3, 3] = rng.uniform(-6, 6, 3)
        nodes.append(sg.Transform(sg.Geode(random_mesh(rng, kinds)), matrix=matrix))
    return sg.Scene().add(*nodes)


def random_view(rng: np.random.Generator) -> sg.View:
    eye = rng.uniform(-9, 9, 3)
    return sg.View(
        eye,
        rng.uniform(-3, 3, 3),
        fov=rng.uniform(20, 120),
        width=int(rng.integers(100, 400)),
        height=int(rng.integers(100, 400)),
        near=float(rng.choice([0.05, 1.0, 5.0])),
        far=100.0,
        parallel_scale=rng.uniform(2, 9) if rng.random() < 0.3 else None,
    )


def triangles_of(snapshot: sg.Snapshot, rows: NDArray[np.integer]) -> F64:
    """(t, 3, 3) world corners."""
    parts = [np.zeros((0, 3, 3))]
    for row in rows.tolist():
        mesh = snapshot.meshes[int(snapshot.mesh_index[row])]
        matrix = snapshot.transforms[int(snapshot.transform_index[row])]
        parts.append((mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])[mesh.faces])
    return np.concatenate(parts)


def run(snapshot: sg.Snapshot, view: sg.View, stage: Hom) -> sg.Frame:
    with sg.Pipeline([stage]).open(snapshot) as pipeline:
        return pipeline.run(view)


def samples(rng: np.random.Generator, occlusion: OcclusionMap, count: int) -> Iterator[tuple[int, F64, F64]]:
    """Points in closed texels: their corners, a hair inside, and random ones."""
    closed = np.argwhere(occlusion.covered)
    if len(closed):
        picked = closed[rng.integers(0, len(closed), count)]
        inset = 1e-6
        for dx, dy in ((inset, inset), (1 - inset, inset), (inset, 1 - inset), (1 - inset, 1 - inset), rng.random(2)):
            yield 0, picked[:, 1] + dx, picked[:, 0] + dy


@given(seed=st.integers(0, 2**32 - 1))
def test_no_ray_gets_through_a_closed_texel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    snapshot, view = random_scene(rng, int(rng.integers(1, 9))).snapshot(), random_view(rng)
    size = int(rng.integers(1, 60)), int(rng.integers(1, 60))
    occlusion = run(snapshot, view, Hom(least=1, width=size[0], height=size[1])).get(OcclusionMap)
    triangles, depth = triangles_of(snapshot, occlusion.rows), occlusion.depth()
    for _, x, y in samples(rng, occlusion, 40):
        hit = first_hits(triangles, *rays_of(view, size, x, y), view.near)
        assert np.isfinite(hit).all()
        assert (hit <= depth[y.astype(int), x.astype(int)] * (1 + 1e-9) + 1e-9).all()


@given(seed=st.integers(0, 2**32 - 1))
def test_centers_are_covered_where_rays_through_them_end(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = int(rng.choice([3, 6]))
    snapshot, view = random_scene(rng, int(rng.integers(1, 9)), kinds).snapshot(), random_view(rng)
    size = int(rng.integers(1, 30)), int(rng.integers(1, 30))
    stage = Hom(least=1, width=size[0], height=size[1], strict=False)
    occlusion = run(snapshot, view, stage).get(OcclusionMap)
    y, x = (a.ravel() + 0.5 for a in np.indices(size[::-1]))
    triangles = triangles_of(snapshot, occlusion.rows)
    hits = [
        np.isfinite(first_hits(triangles, *rays_of(view, size, x + dx, y + dy), view.near))
        for dx, dy in ((0, 0), (1e-5, 1e-5), (-1e-5, 1e-5), (1e-5, -1e-5), (-1e-5, -1e-5))
    ]
    clear = np.all([h == hits[0] for h in hits], axis=0)
    covered = occlusion.covered.ravel()
    assert not (covered & ~hits[0])[clear].any()
    depth = (triangles.reshape(-1, 3) - view.eye) @ view.forward
    if kinds == 3 and (depth > view.near).all():
        # of shapes that are open or that the near plane cuts, a rasterizer draws the inside as well
        assert not (hits[0] & ~covered)[clear].any()


def box_scene(rng: np.random.Generator) -> sg.Scene:
    """Walls, boards and small things between them: much is hidden, by one thing or by several together."""
    scene = sg.Scene()
    for _ in range(int(rng.integers(2, 14))):
        scene.add(box_at(rng.uniform(-8, 8, 3), rng.uniform(0.2, 12, 3) * rng.choice([0.05, 1], 3), name="large"))
    for _ in range(60):
        scene.add(box_at(rng.uniform(-9, 9, 3), rng.uniform(0.05, 1.5, 3), name="small"))
    return scene


def seen_by_rays(snapshot: sg.Snapshot, view: sg.View, x: F64, y: F64, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(n,) boxes that are the first behind the near plane on some ray, or hold its start; slabs (Kay & Kajiya)."""
    origin, direction = rays_of(view, size, x, y)
    best, who = np.full(len(x), np.inf), np.full(len(x), -1)
    for row in range(snapshot.n):
        low, high = (snapshot.boxes[:3, row] + s * snapshot.boxes[3:, row] for s in (-1, 1))
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = (low - origin) / direction, (high - origin) / direction
        enter, leave = np.fmin(a, b).max(axis=1), np.fmax(a, b).min(axis=1)
        hit = (leave >= np.maximum(enter, view.near)) & (leave <= view.far)
        # a box that the near plane cuts shows its far side
        at = np.where(enter >= view.near, enter, leave)
        nearer = hit & (at < best)
        best[nearer], who[nearer] = at[nearer], row
    seen = np.zeros(snapshot.n, bool)
    seen[who[who >= 0]] = True
    return seen


STRICT = (
    Hom(least=1),
    Hom(least=1, width=61, height=43, outlines=False),
    Hom(least=1, width=97, height=31, test="pyramid", ranking="distance"),
    Hom(least=1, width=30, height=200, active=6, ranking="visible"),
)


@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_nothing_that_a_ray_finds_is_hidden(seed: int) -> None:
    """Fusion, depth bounds and cut walls against 30 000 rays, in views from outside and from inside."""
    rng = np.random.default_rng(seed)
    snapshot = box_scene(rng).snapshot()
    for view in (random_view(rng), random_view(rng)):
        y, x = (a.ravel() + rng.random() for a in np.indices((150, 200), dtype=float))
        seen = seen_by_rays(snapshot, view, x, y, (200, 150))
        for stage in STRICT:
            assert not (seen & ~run(snapshot, view, stage).visible).any()


def test_much_is_hidden_all_the_same() -> None:
    """What stands behind a terrace of houses, by rays: at least 90 % of it is found at the default size."""
    scene = sg.Scene()
    rng = np.random.default_rng(5)
    for i in range(-20, 20):
        scene.add(box_at((6 * i + rng.uniform(-0.3, 0.3), 20, 0), (6.8, 8, rng.uniform(6, 14)), name="house"))
    for _ in range(600):
        x, y = rng.uniform(-80, 80), rng.uniform(30, 200)
        scene.add(box_at((x, y, 0), rng.uniform(1, 8, 3), name="thing"))
    snapshot, view = scene.snapshot(), sg.View((0, 0, 1.7), (10, 60, 1.7))
    y, x = (a.ravel() + 0.5 for a in np.indices((180, 320), dtype=float))
    seen = seen_by_rays(snapshot, view, x, y, (320, 180))
    frame = run(snapshot, view, Hom())
    assert not (seen & ~frame.visible).any()
    testable = frame.get(OcclusionMap).footprint(snapshot.boxes).testable
    unseen = testable & ~seen
    assert unseen.sum() > 150
    assert (unseen & ~frame.visible).sum() >= 0.9 * unseen.sum()


# The city


def street_city(count: int = 100, seed: int = 7) -> tuple[sg.Scene, list[sg.View]]:
    """count² boxes on lots of 20 m with street corridors between, and cameras at eye level walking its streets."""
    rng = np.random.default_rng(seed)
    ix, iy = (a.ravel() for a in np.meshgrid(np.arange(count), np.arange(count), indexing="ij"))
    foot = rng.uniform(8, 16, (count**2, 2))
    shift = rng.uniform(-1, 1, (count**2, 2)) * (16 - foot) / 2
    height = np.clip(rng.lognormal(np.log(20.0), 0.65, count**2), 6, 120)
    middle = np.stack([(ix + 0.5) * 20, (iy + 0.5) * 20], axis=1) + shift
    scene = sg.Scene()
    for (x, y), (w, d), h in zip(middle, foot, height, strict=True):
        scene.add(sg.Geode(sg.Mesh.box((x - w / 2, y - d / 2, 0), (x + w / 2, y + d / 2, h))))
    views, at = [], np.array([round(count / 2 - 8) * 20.0, round(count / 2 - 4) * 20.0, 1.7])
    for k in range(64):
        along = np.array([(1, 0), (0, 1), (1, 0), (0, -1)][k // 16])
        yaw = np.arctan2(along[1], along[0]) + np.radians(25) * np.sin(2 * np.pi * k / 13)
        pitch = np.radians(5) * np.sin(2 * np.pi * k / 9)
        look = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
        views.append(sg.View(at, at + 100 * look))
        at = at + [*(10 * along), 0]
    return scene, views


@pytest.fixture(scope="module")
def city() -> tuple[sg.Snapshot, list[tuple[sg.View, NDArray[np.bool_]]]]:
    """Eight views along the path and what can be seen in each, with 4 × 4 samples a pixel."""
    scene, views = street_city()
    snapshot = scene.snapshot()
    views = views[2:64:8]
    return snapshot, list(zip(views, exact_visible_sets(snapshot, views, supersample=4), strict=True))


@pytest.mark.gl
@pytest.mark.parametrize("values", [{}, {"ranking": "distance"}, {"ranking": "visible"}, {"outlines": False}], ids=str)
def test_city_of_ten_thousand_boxes(city: Any, values: dict[str, Any]) -> None:
    """200 occluders at 512 × 256: nothing that can be seen is hidden, and 98 % of what cannot is."""
    snapshot, truths = city
    left, in_view, seen = 0, 0, 0
    with sg.Pipeline([Hom(**values)]).open(snapshot) as pipeline:
        for view, truth in truths:
            frame = pipeline.run(view)
            assert not (truth & ~frame.visible).any()
            testable = frame.get(OcclusionMap).footprint(snapshot.boxes).testable
            left += int((frame.visible & testable).sum())
            in_view += int(testable.sum())
            seen += int((truth & testable).sum())
    assert left / len(truths) <= 122
    assert in_view - left >= 0.98 * (in_view - seen)


# Shapes


def test_parts_of_a_mesh_are_shapes_of_their_own() -> None:
    cube, square = np.sqrt(3) / 2, np.sqrt(2) / 2
    boxes = [sg.Mesh.box((3 * i, 0, 0), (3 * i + 1, 1, 1)) for i in range(3)]
    sheet = sg.Mesh([(0, 0, 5), (1, 0, 5), (0, 1, 5), (1, 1, 5)], [(0, 1, 2), (2, 1, 3)])
    table = occluder_shapes([sg.Mesh.merge([*boxes, sheet]), sg.Mesh.box((0, 0, 0), (1, 1, 1)), sheet])
    assert table.mesh_first.tolist() == [0, 4, 5, 6]
    assert np.diff(table.face_first).tolist() == [12, 2, 12, 12, 12, 2]
    assert np.diff(table.facet_first).tolist() == [6, 1, 6, 6, 6, 1]
    assert table.has_planes.all()
    assert table.radius == pytest.approx([cube, square, cube, cube, cube, square])
    for s in range(len(table)):
        faces = table.faces[table.face_first[s] : table.face_first[s + 1]]
        assert faces.min() == table.vertex_first[s]
        assert faces.max() == table.vertex_first[s + 1] - 1


def test_kinds_of_shapes() -> None:
    box = sg.Mesh.box((-1, -1, -1), (1, 1, 1))
    inverted = sg.Mesh(box.vertices, box.faces[:, ::-1])
    dented = sg.Mesh(np.where(np.arange(8)[:, None] == 7, 0.2, box.vertices), box.faces)
    sheet = sg.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)], [(0, 1, 2), (2, 1, 3)])
    bent = sg.Mesh([(0, 0, 0), (1, 0, 0), (0, 1, 0.5), (1, 1, 0.9), (2, 0.3, 0)], [(0, 1, 2), (2, 1, 3), (1, 4, 3)])
    none = sg.Mesh([(0, 0, 0)] * 3, [(0, 1, 2)])
    table = occluder_shapes([box, inverted, dented, sheet, bent, none])
    first = table.outward[table.facet_first[:-1]]
    assert table.mesh_first.tolist() == [0, 1, 2, 3, 4, 5, 5]
    assert first.tolist() == [1, -1, 1, 0, 0]
    assert table.has_planes[[0, 1, 3]].all()
    assert not table.has_planes[2]


def test_an_empty_table() -> None:
    for table in (occluder_shapes([]), occluder_shapes([sg.Mesh(np.zeros((0, 3)), np.zeros((0, 3)))])):
        assert len(table) == 0
        assert table.nbytes > 0
