"""Frame and traversal: what stages may do, and what they may not."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import scenegraph as sg
from scenegraph.testing import box_at, grid_scene, hostile_scene

VIEW = sg.View((0, -40, 0), (0, 0, 0))
BOX = sg.Mesh.box((0, 0, 0), (1, 1, 1))


@pytest.fixture(scope="module")
def grid() -> sg.Snapshot:
    return grid_scene(8).snapshot()


def half_space(batch: sg.Batch, planes: np.ndarray) -> np.ndarray:
    verdict = np.where(batch.outside(planes), sg.OUT, sg.PARTIAL)
    if not batch.is_rows:
        verdict[batch.inside(planes)] = sg.IN
    return verdict


@given(seed=st.integers(0, 2**32 - 1), flat=st.booleans())
def test_traversals_compose_and_equal_a_loop_over_rows(grid: sg.Snapshot, seed: int, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    frame = sg.Frame(grid, VIEW)
    expected = np.ones(grid.n, bool)
    for step in range(4):
        normal = rng.standard_normal((2, 3))
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        planes = np.column_stack([normal, rng.uniform(-3, 9, 2)])
        frame.traverse(lambda batch, planes=planes: half_space(batch, planes), flat=flat)
        world = planes[:, 3] - planes[:, :3] @ grid.origin
        distance = planes[:, :3] @ grid.boxes[:3] + np.abs(planes[:, :3]) @ grid.boxes[3:] + world[:, None]
        expected &= (distance >= 0).all(axis=0)
        if step == 1:
            gone = rng.integers(0, grid.n, 30)
            frame.hide(gone)
            expected[gone] = False
        assert np.array_equal(frame.visible, expected)
        assert frame.visible_count == expected.sum()
        tree = grid.tree
        dead = np.array([not expected[a:b].any() for a, b in zip(tree.first, tree.end, strict=True)])
        assert not (frame.dead_nodes_now() & ~dead).any()


def test_a_walk_skips_what_is_hidden_and_asks_nothing_below_in(grid: sg.Snapshot) -> None:
    frame = sg.Frame(grid, VIEW)
    asked: list[tuple[bool, int]] = []

    def all_in(batch: sg.Batch) -> np.ndarray:
        asked.append((batch.is_rows, len(batch)))
        return np.full(len(batch), sg.IN)

    frame.traverse(all_in, flat=False)
    assert asked == [(False, 1)]
    frame.hide(np.arange(10, grid.n))
    asked.clear()

    def partial(batch: sg.Batch) -> np.ndarray:
        asked.append((batch.is_rows, len(batch)))
        return np.full(len(batch), sg.PARTIAL)

    frame.traverse(partial, flat=False)
    assert asked[-1] == (True, 10)
    assert sum(count for is_rows, count in asked if not is_rows) < 8
    frame.hide(np.arange(grid.n))
    asked.clear()
    frame.traverse(partial)
    assert asked == []


def test_carry_is_handed_down_and_can_be_changed(grid: sg.Snapshot) -> None:
    frame = sg.Frame(grid, VIEW)
    depth_seen: list[int] = []

    def classify(batch: sg.Batch) -> np.ndarray:
        assert batch.carry is not None
        assert batch.carry.shape == (len(batch), 2)
        depth_seen.append(int(batch.carry[0, 0]))
        batch.carry[:, 0] += 1
        # every node writes its number; a child finds its parent's
        if depth_seen[-1] and not batch.is_rows:
            assert np.array_equal(batch.carry[:, 1], grid.tree.parent[batch.index])
        batch.carry[:, 1] = batch.index
        return np.full(len(batch), sg.PARTIAL)

    frame.traverse(classify, carry=np.array([0, -1]), flat=False)
    assert depth_seen == list(range(grid.tree.levels + 1))


def test_rows_ascend_whatever_the_depth_of_their_leaves() -> None:
    rng = np.random.default_rng(4)
    root = sg.Group()
    # the leaves of the many lie deeper than those of the few, whose rows come after them
    for count in (4000, 20):
        root.add(sg.Group(*(box_at((x, y, 0.0)) for x, y in rng.uniform(0, 100, (count, 2)))))
    snapshot = sg.Scene(root).snapshot()
    tree = snapshot.tree
    assert len(np.unique(np.searchsorted(tree.level_start, np.flatnonzero(tree.is_leaf), side="right"))) > 1
    asked: list[np.ndarray] = []

    def classify(batch: sg.Batch) -> np.ndarray:
        if batch.is_rows:
            asked.append(batch.index)
            assert batch.carry is not None
            assert (tree.first[batch.carry] <= batch.index).all()
            assert (tree.end[batch.carry] > batch.index).all()
        else:
            assert batch.carry is not None
            batch.carry[:] = batch.index
        return np.full(len(batch), sg.PARTIAL, np.int8)

    sg.Frame(snapshot, sg.View((0, 0, 0), (1, 0, 0))).traverse(classify, carry=np.array(0), flat=False)
    (rows,) = asked
    assert np.array_equal(rows, np.arange(snapshot.n))


def test_hide_takes_masks_and_indices_and_spares_protected_rows() -> None:
    snapshot = hostile_scene().snapshot()
    for rows in (np.ones(snapshot.n, bool), np.arange(snapshot.n), list(range(snapshot.n))):
        frame = sg.Frame(snapshot, VIEW)
        frame.hide(rows)
        assert {snapshot.geodes[r].name for r in frame.candidates()} == {"nan", "empty", "endless", "kept"}
    with pytest.raises(ValueError, match="a mask of shape"):
        frame.hide(np.ones(3, bool))


def lod_snapshot() -> sg.Snapshot:
    flat = sg.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    return sg.Scene().add(sg.Lod(BOX, flat, name="lod"), sg.Geode(BOX, name="plain")).snapshot()


def test_coarsen_only_goes_coarser_and_stops_at_the_last_level() -> None:
    snapshot = lod_snapshot()
    frame = sg.Frame(snapshot, VIEW)
    lod = [g.name for g in snapshot.geodes].index("lod")
    assert frame.drawn_triangles() == 24
    frame.coarsen(np.arange(2), 5)
    assert frame.level[lod] == 1
    assert frame.level[1 - lod] == 0
    assert frame.drawn_triangles() == 13
    frame.coarsen([lod], 0)
    assert frame.level[lod] == 1
    assert frame.mesh_index()[lod] == snapshot.level_meshes[lod, 1]


def test_stand_ins_replace_whole_groups_and_count_their_triangles() -> None:
    group = sg.Group(box_at((0, 0, 0)), box_at((2, 0, 0)), name="pair")
    other = box_at((9, 0, 0))
    snapshot = sg.Scene().add(group, other).snapshot()
    frame = sg.Frame(snapshot, VIEW)
    proxy = sg.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    frame.replace(group, proxy)
    assert frame.visible_count == 1
    assert frame.drawn_triangles() == 13
    with pytest.raises(ValueError, match="without covering"):
        frame.replace([int(frame.standins[0].rows[0])], proxy)
    frame.replace(np.arange(snapshot.n), proxy)
    assert len(frame.standins) == 1
    assert frame.drawn_triangles() == 1


def test_many_meshes_of_a_table_stand_for_one_row() -> None:
    snapshot = sg.Scene().add(box_at((0, 0, 0)), box_at((2, 0, 0))).snapshot()
    frame = sg.Frame(snapshot, VIEW)
    table = sg.MeshTable([BOX, BOX, BOX])
    for chosen in ([3], [-1]):
        with pytest.raises(ValueError, match="of a table of 3"):
            frame.replace([0], table, chosen=chosen)
    frame.replace([0], table, chosen=[2, 0])
    assert (frame.visible_count, frame.drawn_objects, frame.drawn_triangles()) == (1, 3, 36)
    assert frame.kept().all()
    # rows that are not worth a triangle are kept, not hidden
    frame.replace([0], table, chosen=[])
    assert (frame.drawn_objects, frame.drawn_triangles()) == (1, 12)
    assert frame.kept().all()
    assert BOX.alone is BOX.alone


class Product:
    pass


def one_stage(work: Callable[[sg.Frame], object], **declared: object) -> sg.Pipeline:
    body = {"name": "work", "__doc__": "Works.", "run": lambda self, frame: work(frame), **declared}
    return sg.Pipeline([type("Work", (sg.Stage,), body)()])


@pytest.mark.parametrize(
    ("work", "what"),
    [
        (lambda f: f.hide([0]), "visible"),
        (lambda f: f.coarsen([0], 1), "level"),
        (lambda f: f.replace([0], BOX), "standins"),
        (lambda f: f.put(Product()), "Product"),
    ],
)
def test_undeclared_changes_raise_and_declared_ones_do_not(work: Callable[[sg.Frame], object], what: str) -> None:
    snapshot = lod_snapshot()
    with pytest.raises(TypeError, match=f"changes '{what}' but does not declare it"):
        one_stage(work, writes=()).open(snapshot).run(VIEW)
    one_stage(work, writes=("visible", "level", "standins", Product)).open(snapshot).run(VIEW)


def test_products_are_found_by_class() -> None:
    frame = sg.Frame(lod_snapshot(), VIEW)
    assert frame.find(Product) is None
    with pytest.raises(KeyError, match="no stage of this frame has put a Product"):
        frame.get(Product)
    product = Product()
    frame.put(product)
    assert frame.get(Product) is product
