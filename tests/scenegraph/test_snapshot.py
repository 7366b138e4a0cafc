"""Snapshot and hierarchy: flattening, following edits, memory."""

from __future__ import annotations

import gc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import scenegraph as sg
from scenegraph.testing import box_at, grid_scene, hostile_scene

BOX = sg.Mesh.box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))


def random_scene(rng: np.random.Generator, rows: int) -> sg.Scene:
    """Groups and transforms nested at random, boxes hung up anywhere in them."""
    root = sg.Group(name="root")
    groups: list[sg.Group] = [root]
    for i in range(int(rng.integers(0, 30))):
        parent = groups[int(rng.integers(0, len(groups)))]
        node: sg.Group = sg.Group(name=f"g{i}")
        if rng.random() < 0.6:
            axis = rng.standard_normal(3)
            node = sg.Transform(
                rotation=(float(rng.uniform(0, 360)), axis.tolist()),
                scale=rng.uniform(0.5, 2, 3),
                translation=rng.uniform(-9, 9, 3),
                name=f"t{i}",
            )
        parent.add(node)
        groups.append(node)
    for i in range(rows):
        groups[int(rng.integers(0, len(groups)))].add(box_at(rng.uniform(-9, 9, 3), 1.0, name=f"b{i}"))
    return sg.Scene(root)


def check_invariants(snapshot: sg.Snapshot) -> None:
    """Slices, boxes and single-precision copies agree with the rows, node by node."""
    tree = snapshot.tree
    if snapshot.n == 0:
        assert len(tree) == 0
        return
    assert (tree.first[0], tree.end[0], tree.parent[0]) == (0, snapshot.n, -1)
    low, high = snapshot.boxes[:3] - snapshot.boxes[3:], snapshot.boxes[:3] + snapshot.boxes[3:]
    covered = np.zeros(snapshot.n, int)
    for node in range(len(tree)):
        a, b = tree.first[node], tree.end[node]
        assert b > a
        children = range(tree.child_first[node], tree.child_end[node])
        assert len(children) <= snapshot.fanout
        if children:
            assert [tree.parent[c] for c in children] == [node] * len(children)
            assert tree.first[children[0]] == a
            assert tree.end[children[-1]] == b
            assert all(tree.end[c] == tree.first[c + 1] for c in children[:-1])
        else:
            covered[a:b] += 1
        box = tree.boxes[:, node]
        assert np.allclose(box[:3] - box[3:], low[:, a:b].min(axis=1), rtol=1e-12, atol=1e-12)
        assert np.allclose(box[:3] + box[3:], high[:, a:b].max(axis=1), rtol=1e-12, atol=1e-12)
    assert (covered == 1).all()
    for boxes, packed in ((snapshot.boxes, snapshot.packed), (tree.boxes, tree.packed)):
        exact = boxes[:3] - snapshot.origin[:, None]
        assert (packed[:, :3].T - packed[:, 3:6].T.astype(float) <= exact - boxes[3:]).all()
        assert (packed[:, :3].T + packed[:, 3:6].T.astype(float) >= exact + boxes[3:]).all()
        reach = np.linalg.norm(packed[:, :3], axis=1) + np.linalg.norm(packed[:, 3:6], axis=1)
        assert (reach <= snapshot.radius).all()


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(0, 300))
def test_rows_are_slices_of_every_node_and_group(seed: int, rows: int) -> None:
    scene = random_scene(np.random.default_rng(seed), rows)
    snapshot = scene.snapshot()
    check_invariants(snapshot)
    assert sorted(g.name for g in snapshot.geodes) == sorted(f"b{i}" for i in range(rows))
    for node in scene.root.walk():
        if isinstance(node, sg.Group):
            a, b = snapshot.rows_of(node)
            below = {n.name for n in node.walk() if isinstance(n, sg.Geode)}
            assert {g.name for g in snapshot.geodes[a:b]} == below


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 200))
def test_world_boxes_hold_the_world_vertices(seed: int, rows: int) -> None:
    snapshot = random_scene(np.random.default_rng(seed), rows).snapshot()
    for row in range(snapshot.n):
        matrix = snapshot.transforms[snapshot.transform_index[row]]
        world = snapshot.meshes[snapshot.mesh_index[row]].vertices @ matrix[:3, :3].T + matrix[:3, 3]
        slack = 1e-12 * (1 + np.abs(world).max())
        assert (np.abs(world - snapshot.boxes[:3, row]) <= snapshot.boxes[3:, row] + slack).all()


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 200))
def test_sync_after_moves_equals_a_new_snapshot(seed: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, rows)
    snapshot = scene.snapshot()
    moved = [n for n in scene.root.walk() if isinstance(n, sg.Transform) and rng.random() < 0.4]
    for node in moved:
        node.matrix = sg.Transform(translation=rng.uniform(-50, 50, 3), rotation=(30, (0, 1, 1))).matrix
    assert snapshot.sync() == ({"transforms", "boxes"} if moved else set())
    check_invariants(snapshot)
    fresh = scene.snapshot()
    order, other = np.argsort(snapshot.keys), np.argsort(fresh.keys)
    assert np.array_equal(snapshot.boxes[:, order], fresh.boxes[:, other])
    assert snapshot.sync() == set()


def test_structural_edits_rebuild_and_keep_keys() -> None:
    scene = grid_scene(3)
    snapshot = scene.snapshot()
    keys = set(snapshot.keys.tolist())
    scene.root.add(box_at((0, 0, 50), name="new"))
    scene.root.remove(scene.root.children[0])
    assert "structure" in snapshot.sync()
    assert snapshot.n == 27
    assert snapshot.structure_version == 1
    assert len(keys & set(snapshot.keys.tolist())) == 26


def test_a_snapshot_that_is_dropped_is_not_kept_alive_by_the_graph() -> None:
    scene = grid_scene(2)
    scene.snapshot()
    gc.collect()
    assert len(scene.root._listeners or ()) == 0


def test_unknown_rows_are_named_and_do_not_spoil_the_boxes_above() -> None:
    snapshot = hostile_scene().snapshot()
    unknown = {snapshot.geodes[r].name for r in np.flatnonzero(snapshot.unknown)}
    assert unknown == {"nan", "empty", "endless"}
    assert np.isfinite(snapshot.tree.boxes[:, 0]).all()
    assert np.isfinite(snapshot.origin).all()


def test_lod_rows_have_levels_errors_and_the_box_of_all_levels() -> None:
    fine, coarse = sg.Mesh.box((-1, -1, -1), (1, 1, 1)), sg.Mesh([[-3, 0, 0], [3, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    lod = sg.Lod(fine, coarse, errors=(0, 0.25), name="lod")
    snapshot = sg.Scene(sg.Group(sg.Transform(lod, scale=(2, 4, 2)), sg.Geode(BOX, name="plain"))).snapshot()
    row = [g.name for g in snapshot.geodes].index("lod")
    assert snapshot.level_count.tolist() == [2 if i == row else 1 for i in range(2)]
    assert snapshot.triangles[:, row].tolist() == [12, 1]
    assert snapshot.triangles[:, 1 - row].tolist() == [12, 0]
    assert np.allclose(snapshot.errors[:, row], [0, 1.0])
    assert np.allclose(snapshot.boxes[3:, row], [6, 4, 2])


def test_never_cull_is_inherited() -> None:
    scene = sg.Scene().add(sg.Group(box_at((0, 0, 0), name="in"), never_cull=True), box_at((3, 0, 0), name="out"))
    snapshot = scene.snapshot()
    assert {snapshot.geodes[r].name for r in np.flatnonzero(snapshot.never_cull)} == {"in"}


def test_memory_stays_below_the_promised_300_bytes_per_drawable() -> None:
    snapshot = sg.Scene(
        sg.Group(*(sg.Transform(sg.Geode(BOX), translation=(i % 100, i // 100, 0)) for i in range(10_000)))
    ).snapshot()
    assert snapshot.nbytes / snapshot.n < 300
    assert snapshot.nbytes == sum(snapshot.memory().values())


@pytest.mark.parametrize("fanout", [2, 3, 16, 64])
def test_any_fanout(fanout: int) -> None:
    check_invariants(sg.Snapshot(grid_scene(5), fanout=fanout))


def test_equal_centers_still_divide() -> None:
    snapshot = sg.Scene(sg.Group(*(sg.Geode(BOX) for _ in range(1000)))).snapshot()
    check_invariants(snapshot)
    assert snapshot.tree.levels <= 4


def test_painting_is_followed_without_a_rebuild() -> None:
    leaf = sg.Geode(BOX)
    textured = sg.Geode(sg.Mesh(BOX.vertices, BOX.faces, vertex_colors=np.full((8, 4), 9)), name="painted")
    snapshot = sg.Scene().add(leaf, textured).snapshot()
    row = snapshot.rows_of(leaf)[0]
    assert np.array_equal(snapshot.colors[snapshot.rows_of(textured)[0]], [1, 1, 1, 1])
    leaf.color = (1, 0, 0)
    assert snapshot.sync() == {"colors"}
    assert np.array_equal(snapshot.colors[row], [1, 0, 0, 1])
    assert snapshot.structure_version == 0
