"""The arrays that are drawn: every row where the snapshot says, in batches that keep their order."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drawn_scenes import BOX, FAR, ball, town
from scenegraph import Geode, Group, Lod, Mesh, Scene, Transform
from scenegraph.render import geometry as module
from scenegraph.render.bake import normal_matrices, quantized
from scenegraph.render.geometry import Geometry
from scenegraph.render.layout import spread
from scenegraph.snapshot import Snapshot


def corners(geometry: Geometry, row: int, level: int = 0) -> np.ndarray:
    """(t, 3, 3) world corners of the triangles of a row, in float64, whatever it is laid out as."""
    for batch in geometry.batches:
        for item in np.flatnonzero((batch.rows == row) & (batch.levels == level)):
            faces = batch.faces[batch.first_triangle[item] : batch.first_triangle[item + 1]]
            return batch.vertices[faces].astype(float) + batch.origin
    for entry in geometry.instances:
        for item in np.flatnonzero((entry.rows == row) & (entry.levels == level)):
            matrix = entry.matrices[item]
            return (entry.vertices.astype(float) @ matrix[:3, :3].T + matrix[:3, 3])[entry.faces]
    raise AssertionError(f"row {row} is not drawn")


def expected(snapshot: Snapshot, row: int, level: int = 0) -> np.ndarray:
    mesh = snapshot.meshes[snapshot.level_meshes[row, level]]
    world = snapshot.transforms[snapshot.transform_index[row]]
    triangles = (mesh.vertices @ world[:3, :3].T + world[:3, 3])[mesh.faces]
    return triangles[:, ::-1] if np.linalg.det(world[:3, :3]) < 0 else triangles


@pytest.mark.parametrize("heavy", [1, 2000, 1 << 30])
@pytest.mark.parametrize("offset", [(0.0, 0.0, 0.0), FAR])
def test_every_row_is_where_the_snapshot_says(offset: tuple[float, float, float], heavy: int) -> None:
    snapshot = town(offset).snapshot()
    geometry = Geometry(snapshot, heavy=heavy)
    drawn = np.concatenate([x.rows for x in [*geometry.batches, *geometry.instances]])
    assert sorted(drawn) == list(range(snapshot.n))
    for row in range(snapshot.n):
        # a scene of 200 m keeps 1/50 millimeter at any distance from the origin of the world
        np.testing.assert_allclose(corners(geometry, row), expected(snapshot, row), rtol=0, atol=2e-5)


def test_batches_keep_rows_in_order_and_put_translucent_ones_last() -> None:
    geometry = Geometry(town().snapshot())
    for batch in geometry.batches:
        assert (np.diff(batch.rows) > 0).all()
    clear = [b.material.translucent for b in geometry.batches]
    assert clear == sorted(clear)
    assert any(clear)


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 6)), max_size=20))
def test_spread_is_a_concatenation_of_ranges(ranges: list[tuple[int, int]]) -> None:
    first = np.array([a for a, _ in ranges], np.int64)
    counts = np.array([b for _, b in ranges], np.int64)
    assert spread(first, counts).tolist() == [i for a, b in ranges for i in range(a, a + b)]


@given(st.integers(0, 2**30), st.sampled_from([0.0, 0.02, 0.3, 0.9, 1.0]))
def test_indices_are_the_faces_of_the_chosen_items(seed: int, share: float) -> None:
    batch = max(GEOMETRY.batches, key=lambda b: len(b.rows))
    chosen = np.random.default_rng(seed).random(len(batch.rows)) < share
    wanted = [batch.faces[batch.first_triangle[i] : batch.first_triangle[i + 1]] for i in np.flatnonzero(chosen)]
    flat = np.concatenate(wanted).reshape(-1) if wanted else np.zeros(0, np.int32)
    assert batch.indices(chosen).dtype == np.int32
    assert np.array_equal(batch.indices(chosen), flat)


GEOMETRY = Geometry(town().snapshot())


def test_a_large_scene_gets_cells_that_keep_precision(rng: np.random.Generator) -> None:
    places = rng.uniform(-6.4e6, 6.4e6, (300, 3))
    scene = Scene(Group(*[Transform(Geode(BOX), translation=p, scale=10.0) for p in places]))
    snapshot = scene.snapshot()
    geometry = Geometry(snapshot)
    assert 1 < len(geometry.batches) <= module._CELLS_AT_MOST
    worst = max(np.abs(corners(geometry, r) - expected(snapshot, r)).max() for r in range(snapshot.n))
    assert worst < 0.2  # one cell would be off by up to 0.5
    near = Scene(Group(*[Transform(Geode(BOX), translation=p * 1e-3, scale=10.0) for p in places])).snapshot()
    assert len(Geometry(near).batches) == 1


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e11])
def test_extremes_of_size(scale: float) -> None:
    scene = Scene(Group(*[Transform(Geode(BOX), translation=(2.0 * i * scale, 0, 0), scale=scale) for i in range(5)]))
    snapshot = scene.snapshot()
    geometry = Geometry(snapshot)
    for row in range(5):
        np.testing.assert_allclose(corners(geometry, row), expected(snapshot, row), rtol=0, atol=1e-6 * scale)


def test_levels_are_laid_out_and_chosen() -> None:
    scene = Scene(Group(*[Transform(Lod(ball(40, 40), ball(8, 8), BOX), translation=(3 * i, 0, 0)) for i in range(4)]))
    snapshot = scene.snapshot()
    geometry = Geometry(snapshot)
    for row in range(4):
        for level in range(3):
            np.testing.assert_allclose(corners(geometry, row, level), expected(snapshot, row, level), atol=1e-5)
    visible, level = np.array([True, True, False, True]), np.array([0, 1, 1, 2], np.uint8)
    drawn = []
    for part in [*geometry.batches, *geometry.instances]:
        chosen = part.chosen(visible, level)
        drawn += list(zip(part.rows[chosen].tolist(), part.levels[chosen].tolist(), strict=True))
    assert sorted(drawn) == [(0, 0), (1, 1), (3, 2)]


def test_corners_that_are_not_finite_are_not_drawn() -> None:
    vertices = BOX.vertices.copy()
    vertices[0] = np.nan
    lost = Transform(Geode(BOX), translation=(1e39, 0, 0))  # beyond float32, even relative to the origin
    scene = Scene(
        Group(Geode(Mesh(vertices, BOX.faces)), Geode(BOX), lost, Geode(Mesh(np.full((3, 3), np.inf), [[0, 1, 2]])))
    )
    snapshot = scene.snapshot()
    for heavy in (1, 1 << 30):
        geometry = Geometry(snapshot, heavy=heavy)
        for batch in geometry.batches:
            assert np.isfinite(batch.vertices).all()
        good = next(
            r
            for r in range(snapshot.n)
            if snapshot.names([r]) and snapshot.geodes[r].mesh is BOX and not snapshot.transform_index[r]
        )
        assert len(corners(geometry, good)) == 12


def test_empty_scenes_have_no_geometry() -> None:
    for scene in (Scene(), Scene(Group(Geode(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)))))):
        geometry = Geometry(scene.snapshot())
        assert geometry.batches == []
        assert geometry.instances == []
        assert geometry.nbytes == 0


def test_refresh_rewrites_only_what_moved() -> None:
    parts = [Transform(Geode(BOX), translation=(3.0 * i, 0, 0)) for i in range(50)]
    heavy = [Transform(Geode(ball(40, 40)), translation=(3.0 * i, 9, 0)) for i in range(3)]
    scene = Scene(Group(*parts, *heavy))
    snapshot = scene.snapshot()
    geometry = Geometry.shared(snapshot)
    assert Geometry.shared(snapshot) is geometry
    parts[7].matrix = Transform(translation=(0, 50, 0), scale=(2, -1, 1)).matrix
    heavy[1].matrix = Transform(translation=(0, -50, 0)).matrix
    snapshot.sync()
    assert Geometry.shared(snapshot) is geometry
    assert geometry.generation == 1
    changed = [r for x in [*geometry.batches, *geometry.instances] for r in x.rows[x.changed_at == 1].tolist()]
    moved = [r for r in range(snapshot.n) if snapshot.geodes[r].parent in (parts[7], heavy[1])]
    assert sorted(changed) == moved
    for row in range(snapshot.n):
        np.testing.assert_allclose(corners(geometry, row), expected(snapshot, row), atol=1e-5)


def test_refresh_refuses_what_it_cannot_follow() -> None:
    heavy = Transform(Geode(ball(40, 40)))
    scene = Scene(Group(heavy, Geode(BOX)))
    snapshot = scene.snapshot()
    geometry = Geometry.shared(snapshot)
    heavy.matrix = np.diag([1, 1, -1, 1])
    snapshot.sync()
    assert Geometry.shared(snapshot) is not geometry
    geometry = Geometry.shared(snapshot)
    scene.add(Geode(BOX))
    snapshot.sync()
    assert not geometry.refresh()
    assert sum(len(b.rows) for b in Geometry.shared(snapshot).batches) == 2


def test_shared_geometry_goes_with_its_last_user() -> None:
    snapshot = town().snapshot()
    geometry = Geometry.shared(snapshot)
    alive = weakref.ref(geometry)
    del geometry
    gc.collect()
    assert alive() is None


@given(st.integers(0, 2**30))
def test_normal_matrices_keep_normals_perpendicular_and_outside(seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix = rng.normal(size=(1, 3, 3))
    if rng.random() < 0.3:
        matrix[0, 2] = matrix[0, 1]  # singular
    along = rng.normal(size=3)
    normal = np.cross(along, rng.normal(size=3))
    turned = normal_matrices(matrix)[0] @ normal
    scale = np.linalg.norm(turned) * np.linalg.norm(matrix[0] @ along) + 1e-12
    assert abs(turned @ (matrix[0] @ along)) <= 1e-9 * scale + 1e-9
    if abs(np.linalg.det(matrix[0])) > 1e-3:
        # what points out of a body still does after the body was turned, stretched or mirrored
        assert turned @ (matrix[0] @ normal) > 0


def test_colors_are_rounded_to_bytes() -> None:
    assert quantized(np.array([0.0, 0.5, 1.0, 1.5, -1.0])).tolist() == [0, 128, 255, 255, 0]
