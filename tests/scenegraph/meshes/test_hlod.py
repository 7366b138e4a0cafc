"""HLOD trees: what their docstring promises, by properties; the cache; and hostile input."""

from __future__ import annotations

from threading import Lock
from time import sleep

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from level_shapes import brute_distance, random_points
from scenegraph import Geode, Group, Mesh, Scene, Transform
from scenegraph.meshes import DiskCache, Hlod, hlod_of
from scenegraph.meshes.octree import octree
from scenegraph.meshes.soup import rows_for_soup, soup_of
from scenegraph.scenes.shapes import bumps, icosphere, vertex_normals
from scenegraph.testing import box_at, hostile_scene


def bumpy(seed: int = 0, levels: int = 3, *, smooth: bool = True, color: tuple[float, ...] | None = None) -> Mesh:
    points, faces = icosphere(levels)
    points = points * (1 + 0.15 * bumps(points, np.random.default_rng(seed), waves=12, roughness=4.0))[:, None]
    return Mesh(points, faces, normals=vertex_normals(points, faces) if smooth else None, color=color)


def crowd(count: int = 4, levels: int = 3) -> Scene:
    nodes = [
        Transform(
            Geode(bumpy(i, levels, smooth=i % 2 == 0), color=(0.2 * i, 0.5, 0.5), name=f"body {i}"),
            translation=(2.5 * i, 0, 0),
            scale=(-1, 1, 1) if i == 1 else 1,
        )
        for i in range(count)
    ]
    return Scene(Group(*nodes, name="crowd"))


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Hlod:
    return hlod_of(crowd().snapshot(), triangles=200, cache=DiskCache(tmp_path_factory.mktemp("cache")))


# The octree


@settings(max_examples=30)
@given(st.integers(0, 400), st.integers(1, 60), st.integers(0, 2**32 - 1), st.sampled_from(["cube", "plane", "lumps"]))
def test_every_point_is_in_one_leaf_of_few(count, most, seed, kind):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3))
    if kind == "plane":
        points[:, 1] = 3.0
    elif kind == "lumps":
        points = np.round(points)
    made = octree(points, most)
    leaf = made.end == np.arange(1, len(made) + 1)
    held = np.concatenate([made.order[a:b] for a, b in zip(made.first[leaf], made.last[leaf], strict=True)])
    assert sorted(held.tolist()) == list(range(count))
    if kind != "lumps":
        assert (made.last[leaf] - made.first[leaf]).max(initial=0) <= most
    for node in range(1, len(made)):
        above = made.parent[node]
        assert above < node < made.end[above]
        assert made.first[above] <= made.first[node] <= made.last[node] <= made.last[above]


def test_points_at_one_place_end_the_splitting():
    made = octree(np.ones((1000, 3)), 10)
    assert made.last[0] == 1000
    assert len(made) <= 21


# What a tree promises


def test_leaves_are_the_original_triangles(tree):
    scene = crowd()
    soup = soup_of(scene.snapshot(), rows_for_soup(scene.snapshot()))
    expected = np.sort(soup.vertices[soup.faces].reshape(-1, 9) + np.tile(soup.origin, 3), axis=0)
    leaves = np.flatnonzero(tree.is_leaf)
    found = np.concatenate([m.vertices[m.faces].reshape(-1, 9) for m in (tree.table.meshes[i] for i in leaves)])
    assert np.allclose(np.sort(found, axis=0), expected, atol=1e-12)
    assert (tree.errors[leaves] == 0).all()


def test_errors_never_fall_toward_the_root_and_boxes_are_nested(tree):
    inner = np.flatnonzero(tree.parent >= 0)
    above = tree.parent[inner]
    assert (tree.errors[above] >= tree.errors[inner]).all()
    assert tree.errors[0] > 0
    low, high = tree.boxes[:3] - tree.boxes[3:], tree.boxes[:3] + tree.boxes[3:]
    # centers and half extents are rounded
    assert (low[:, above] <= low[:, inner] + 1e-14).all()
    assert (high[:, above] >= high[:, inner] - 1e-14).all()
    for node, mesh in enumerate(tree.table.meshes):
        assert (mesh.bounds[0] >= low[:, node]).all()
        assert (mesh.bounds[1] <= high[:, node]).all()


def test_inner_nodes_have_few_triangles_and_no_border_is_broken(tree):
    inner = ~tree.is_leaf
    assert inner.sum() > 5
    assert np.median(tree.triangles[inner]) <= 200
    assert tree.report.border_edges > 100
    assert tree.report.broken_edges == 0


def test_no_point_of_the_original_is_farther_from_a_node_than_its_error(tree):
    rng = np.random.default_rng(0)
    worth = []
    for node in np.flatnonzero(~tree.is_leaf).tolist():
        leaves = np.arange(node, tree.end[node])[tree.is_leaf[node : tree.end[node]]]
        coarse = tree.table.meshes[node]
        fine = [random_points(tree.table.meshes[i], 3000, rng) for i in leaves]
        fine += [tree.table.meshes[i].vertices for i in leaves]
        farthest = float(brute_distance(np.concatenate(fine), coarse).max())
        assert farthest <= tree.errors[node] * (1 + 1e-6) + 1e-12
        worth.append(farthest / tree.errors[node])
        # the way back, at the points that are measured
        parts = [tree.table.meshes[i] for i in leaves]
        starts = np.cumsum([0, *(len(m.vertices) for m in parts)])
        joint = np.concatenate([m.faces + s for m, s in zip(parts, starts[:-1], strict=True)])
        original = Mesh(np.concatenate([m.vertices for m in parts]), joint)
        # of simplified children, it is not measured from the leaves
        if tree.is_leaf[tree.children_of(np.array([node]))].all():
            points = np.concatenate([coarse.vertices, coarse.vertices[coarse.faces].mean(axis=1)])
            assert brute_distance(points, original).max() <= tree.errors[node] * (1 + 1e-6) + 1e-12
    assert np.median(worth) > 0.5, "the bounds say something"


@settings(max_examples=40)
@given(st.integers(0, 2**32 - 1), st.floats(0, 1))
def test_any_cut_stands_once_over_every_leaf_and_over_every_row(tree, seed, share):
    fine = np.random.default_rng(seed).random(len(tree)) < share
    cut = tree.cut(fine)
    assert (tree.leaves_of(cut) == 1).all()
    assert (np.diff(cut) > 0).all()
    assert tree.rows_of(cut, 4).all()
    # what is cut off takes its rows with it, unless another node shows a part of them
    some = cut[::2]
    shown = tree.rows_of(some, 4)
    for row in np.flatnonzero(~shown):
        leaves = [
            leaf
            for leaf in range(len(tree.leaf_row_start) - 1)
            if row in tree.leaf_rows[tree.leaf_row_start[leaf] : tree.leaf_row_start[leaf + 1]]
        ]
        assert (tree.leaves_of(some)[leaves] == 0).all()


def test_children_are_those_whose_parent_one_is(tree):
    for nodes in (np.array([0]), np.flatnonzero(~tree.is_leaf)[:4], np.zeros(0, np.int64)):
        assert sorted(tree.children_of(nodes).tolist()) == np.flatnonzero(np.isin(tree.parent, nodes)).tolist()


def test_colors_and_normals_are_carried(tree):
    for node, mesh in enumerate(tree.table.meshes):
        assert mesh.vertex_colors is not None
        rows = np.flatnonzero(tree.rows_of(np.array([node]), 4))
        known = {(round(0.2 * r * 255), 128, 128, 255) for r in rows}
        assert {tuple(c) for c in mesh.vertex_colors.tolist()} <= known
        if mesh.normals is not None:
            assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-3)
    # a node over smooth and flat rows shows the flat ones flat: a corner of its own for each triangle
    root = tree.table.meshes[0]
    assert root.normals is not None
    assert len(root.vertices) > root.triangles / 2


def test_faces_of_mirrored_rows_look_outward(tree):
    leaves = np.flatnonzero(tree.is_leaf)
    volume = sum(
        float(
            np.einsum(
                "fi,fi->", m.vertices[m.faces[:, 0]], np.cross(m.vertices[m.faces[:, 1]], m.vertices[m.faces[:, 2]])
            )
        )
        for m in (tree.table.meshes[i] for i in leaves)
    )
    assert volume / 6 > 4 * 3.0


# The cache, and hostile input


def test_second_time_it_is_read_from_disk_and_the_same(tmp_path):
    cache = DiskCache(tmp_path)
    seen: list[float] = []
    first = hlod_of(crowd(2).snapshot(), triangles=300, cache=cache, progress=lambda _, share: seen.append(share))
    assert seen[-1] == 1.0
    assert seen == sorted(seen)
    second = hlod_of(crowd(2).snapshot(), triangles=300, cache=cache)
    assert (first.report.from_cache, second.report.from_cache) == (False, True)
    assert np.array_equal(first.errors, second.errors)
    assert np.array_equal(first.boxes, second.boxes)
    for a, b in zip(first.table.meshes, second.table.meshes, strict=True):
        assert np.array_equal(a.vertices, b.vertices)
        assert np.array_equal(a.faces, b.faces)
    for text in (first.report.text, second.report.text):
        assert "0 of" in text
    # anything else is another tree
    for other in (crowd(1), Scene(Group(Transform(crowd(2).root, translation=(1, 0, 0))))):
        assert not hlod_of(other.snapshot(), triangles=2000, cache=cache).report.from_cache
    assert not hlod_of(crowd(2).snapshot(), triangles=2001, cache=cache).report.from_cache


def test_threads_change_no_bit_of_it(tmp_path, monkeypatch):
    trees = []
    for cores in (1, 2, 4):
        monkeypatch.setattr("scenegraph.threads.cores", lambda cores=cores: cores)
        cache = DiskCache(tmp_path / str(cores))
        hlod_of(crowd(3).snapshot(), triangles=150, levels=2, cache=cache)
        (entry,) = (tmp_path / str(cores)).glob("hlod trees/*.npz")
        trees.append(dict(np.load(entry)))
    for other in trees[1:]:
        assert other.keys() == trees[0].keys()
        assert all(np.array_equal(other[name], array, equal_nan=True) for name, array in trees[0].items())


def test_edges_are_collapsed_by_one_thread_at_a_time(tmp_path, monkeypatch):
    import fast_simplification

    original, alone, calls = fast_simplification.simplify, Lock(), []

    def watched(*args, **options):
        # the library keeps the mesh in global variables
        calls.append(alone.acquire(blocking=False))
        sleep(0.01)
        made = original(*args, **options)
        if calls[-1]:
            alone.release()
        return made

    monkeypatch.setattr("fast_simplification.simplify", watched)
    monkeypatch.setattr("scenegraph.threads.cores", lambda: 4)
    hlod_of(crowd(4).snapshot(), triangles=200, cache=DiskCache(tmp_path))
    assert len(calls) > 4
    assert all(calls)


def test_cancelling_is_possible_and_leaves_nothing_behind(tmp_path):
    def stop(what: str, share: float) -> None:
        if share > 0.5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        hlod_of(crowd(2).snapshot(), triangles=100, cache=DiskCache(tmp_path), progress=stop)
    assert not list(tmp_path.rglob("*.npz"))


def test_damaged_entries_are_built_again(tmp_path):
    cache = DiskCache(tmp_path)
    hlod_of(crowd(1).snapshot(), triangles=300, cache=cache)
    (entry,) = tmp_path.glob("hlod trees/*.npz")
    arrays = dict(np.load(entry))
    for change in ({"vertex_start": arrays["vertex_start"][:-1]}, {"covered": arrays["covered"][:0]}, {"faces": None}):
        np.savez(entry, **{k: v for k, v in (arrays | change).items() if v is not None})
        assert not hlod_of(crowd(1).snapshot(), triangles=300, cache=cache).report.from_cache


def test_what_cannot_be_merged_is_left_out(tmp_path):
    glass = box_at((9, 0, 0), color=(1, 1, 1, 0.5), name="glass")
    painted = Mesh(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], uv=np.zeros((3, 2)), texture=np.zeros((2, 2, 3), np.uint8)
    )
    kept = box_at((5, 0, 0), never_cull=True, name="kept")
    snapshot = Scene().add(box_at((0, 0, 0), name="box"), glass, Geode(painted, name="painted"), kept).snapshot()
    tree = hlod_of(snapshot, cache=DiskCache(tmp_path))
    assert {g.name for g, c in zip(snapshot.geodes, tree.covered, strict=True) if c} == {"box"}
    assert tree.report.left_out == 3
    assert tree.triangles.sum() == 12


@pytest.mark.parametrize("reach", [1e60, 1e160, 1e300])
@pytest.mark.filterwarnings("ignore:overflow")
def test_drawables_of_which_distances_overflow_are_left_out(reach, tmp_path):
    ball = bumpy()
    points = ball.vertices.copy()
    points[3] *= reach
    snapshot = Scene().add(Geode(Mesh(points, ball.faces), name="huge"), Geode(ball, name="near")).snapshot()
    tree = hlod_of(snapshot, triangles=60, cache=DiskCache(tmp_path))
    assert tree.report.left_out == 2, "seen from the center of the scene, the other one is as far away"
    assert not len(tree) or not tree.triangles.sum()


def test_hostile_and_empty_scenes_have_trees(tmp_path):
    cache = DiskCache(tmp_path)
    for scene in (Scene(), Scene().add(Geode(Mesh([], []))), hostile_scene()):
        snapshot = scene.snapshot()
        tree = hlod_of(snapshot, triangles=20, cache=cache)
        again = hlod_of(snapshot, triangles=20, cache=cache)
        assert len(tree) == len(again) >= 1
        assert not tree.covered[snapshot.protected].any()
    with pytest.raises(ValueError, match="at least 4"):
        hlod_of(Scene().snapshot(), triangles=3)


@pytest.mark.parametrize(("scale", "offset"), [(1e-9, 0.0), (1e6, 0.0), (1.0, 1e7)])
def test_scale_and_place_change_nothing_but_the_numbers(tmp_path, scale, offset):
    plain = hlod_of(crowd(1).snapshot(), triangles=300, cache=DiskCache(tmp_path))
    moved = Scene(Group(Transform(crowd(1).root, scale=scale, translation=(offset, offset, offset))))
    other = hlod_of(moved.snapshot(), triangles=300, cache=DiskCache(tmp_path))
    assert other.report.broken_edges == 0
    if not offset:
        assert len(other) == len(plain)
    assert other.errors[0] / scale == pytest.approx(plain.errors[0], rel=0.3)


def test_a_tree_is_stale_when_what_it_covers_has_moved_or_changed_color(tmp_path):
    scene = crowd(2)
    snapshot = scene.snapshot()
    tree = hlod_of(snapshot, triangles=300, cache=DiskCache(tmp_path))
    assert not tree.is_stale(snapshot)
    body = next(n for n in scene.root.walk() if isinstance(n, Geode))
    before = body.color
    body.color = (1, 0, 0)
    snapshot.sync()
    assert tree.is_stale(snapshot)
    body.color = before
    snapshot.sync()
    assert not tree.is_stale(snapshot)
    move = next(n for n in scene.root.walk() if isinstance(n, Transform))
    move.matrix = move.matrix @ np.diag([2.0, 1, 1, 1])
    snapshot.sync()
    assert tree.is_stale(snapshot)


def test_levels_within_nodes_are_coarser_farther_off_and_share_the_border(tmp_path):
    from scenegraph.meshes.hlod_nodes import _border

    tree = hlod_of(crowd(2).snapshot(), triangles=400, levels=3, cache=DiskCache(tmp_path))
    m = len(tree)
    assert np.array_equal(tree.level_mesh[0], np.arange(m))
    assert np.array_equal(tree.level_errors[0], tree.errors)
    some = tree.level_mesh >= 0
    assert sorted(tree.level_mesh[some].tolist()) == list(range(len(tree.table)))
    assert some[1].sum() > m / 2
    assert np.isinf(tree.level_errors[~some]).all()
    for level in (1, 2):
        nodes = np.flatnonzero(some[level])
        now, before = tree.level_mesh[level, nodes], tree.level_mesh[level - 1, nodes]
        assert (tree.table.triangles[now] <= 0.75 * tree.table.triangles[before]).all()
        assert (tree.level_errors[level, nodes] >= tree.level_errors[level - 1, nodes]).all()
    low, high = tree.boxes[:3] - tree.boxes[3:], tree.boxes[:3] + tree.boxes[3:]
    for node in np.flatnonzero(some[1]).tolist():
        fine, coarse = (tree.table.meshes[tree.level_mesh[k, node]] for k in (0, 1))
        assert (coarse.bounds[0] >= low[:, node]).all()
        assert (coarse.bounds[1] <= high[:, node]).all()
        # flat faces have corners of their own; by place, the border is the same
        assert _border(*welded(fine)) <= _border(*welded(coarse))


def welded(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    points, index = np.unique(mesh.vertices, axis=0, return_inverse=True)
    return points, index.reshape(-1)[mesh.faces]
