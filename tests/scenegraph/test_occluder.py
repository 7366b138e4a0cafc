"""Occluder nodes and their table."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import scenegraph as sg

SQUARE = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (SQUARE[:2], "three different points"),
        ([(0, 0, 0), (1, 0, 0), (2, 0, 0)], "no area"),
        (SQUARE + [[0, 0, 0], [0, 0, 0.1], [0, 0, 0], [0, 0, 0]], "not lie in one plane"),
        ([(0, 0, 0), (2, 0, 0), (1, 0.3, 0), (0, 2, 0)], "not convex"),
        ([(0, 0, 0), (1, 0, 0), (np.nan, 1, 0)], "1 points are not finite"),
        (np.zeros((3, 2)), r"shape \(3, 2\)"),
    ],
)
def test_planar_refuses_with_a_sentence(points: object, message: str) -> None:
    with pytest.raises(sg.SceneError, match=message):
        sg.Occluder.planar(points, name="wall")  # type: ignore[arg-type]


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_planar_keeps_polygons_of_any_size_and_drops_repeated_points(scale: float) -> None:
    doubled = np.repeat(SQUARE, 2, axis=0) * scale + 1e3 * scale
    assert len(sg.Occluder.planar(doubled).vertices) == 4


def test_solid_refuses_what_is_flat_or_not_convex() -> None:
    with pytest.raises(sg.SceneError, match="no volume"):
        sg.Occluder.solid(SQUARE)
    with pytest.raises(sg.SceneError, match="no volume"):
        sg.Occluder.box((0, 0, 0), (1, 1, 0))
    two = sg.Mesh.merge([sg.Mesh.box((0, 0, 0), (1, 1, 1)), sg.Mesh.box((0, 0, 0), (0.4, 3, 0.4))])
    with pytest.raises(sg.SceneError, match=r"not convex \(\d+ of its corners"):
        sg.Occluder.solid(two)


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_solid_merges_coplanar_triangles(scale: float) -> None:
    solid = sg.Occluder.solid(sg.Mesh.box((0, 0, 0), (scale, 2 * scale, 3 * scale)))
    assert sorted(map(len, solid.faces)) == [4] * 6


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(5, 30))
def test_table_of_random_hulls_obeys_euler_and_points_outward(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    hull = sg.Occluder.solid(rng.standard_normal((count, 3)), name="hull")
    turn = sg.Transform(hull, rotation=(40, (1, 2, 3)), scale=(1, -1, 1), translation=(5, 6, 7))
    table = sg.Scene(sg.Group(turn)).snapshot().occluders
    vertices, faces, edges = table.take(np.array([0]))
    assert len(vertices) - len(edges) + len(faces) == 2
    assert np.allclose(np.linalg.norm(table.normals, axis=1), 1)
    point = table.vertices[table.loop[table.loop_first[:-1]]]
    depth = (table.normals[:, None] * (table.vertices[None] - point[:, None])).sum(-1)
    assert (depth < 1e-9).all()
    assert (table.edge_faces >= 0).all()


def test_owner_is_the_group_that_holds_it_but_never_the_root() -> None:
    box = sg.Mesh.box((0, 0, 0), (1, 1, 1))
    inner = sg.Occluder.box((0, 0, 0), (1, 1, 1), name="inner")
    house = sg.Group(sg.Geode(box, name="a"), sg.Geode(box, name="b"), inner, name="house")
    loose = sg.Occluder.box((5, 0, 0), (6, 1, 1), name="loose")
    other = sg.Geode(box, name="c")
    given_owner = sg.Occluder.box((5, 0, 0), (6, 1, 1), owner=other)
    snapshot = sg.Scene(sg.Group(house, loose, other, given_owner)).snapshot()
    owned = [{snapshot.geodes[r].name for r in range(a, b)} for a, b in snapshot.occluders.owner]
    assert owned == [{"a", "b"}, set(), {"c"}]


def test_occluders_follow_their_transform() -> None:
    moving = sg.Transform(sg.Occluder.planar(SQUARE, holes=[SQUARE[:3] * 0.5]), name="moving")
    snapshot = sg.Scene(sg.Group(moving)).snapshot()
    before = snapshot.occluders.vertices.copy()
    moving.matrix = sg.Transform(translation=(0, 0, 4)).matrix
    snapshot.sync()
    assert np.array_equal(snapshot.occluders.vertices, before + (0, 0, 4))
    assert np.array_equal(snapshot.occluders.hole_vertices[:, 2], [4, 4, 4])
    assert np.array_equal(snapshot.occluders.normals, [(0, 0, 1)])


def test_adopted_occluders_belong_to_their_drawable_and_move_with_it() -> None:
    leaf = sg.Geode(sg.Mesh.box((0, 0, 0), (1, 1, 1)), name="house")
    place = sg.Transform(leaf, translation=(5, 0, 0))
    scene = sg.Scene(sg.Group(place, sg.Geode(sg.Mesh.box((9, 9, 9), (10, 10, 10)))))
    snapshot = scene.snapshot()
    snapshot.adopt_occluders({leaf: [sg.Occluder.box((0.1, 0.1, 0.1), (0.9, 0.9, 0.9))]})
    (owner,) = snapshot.occluders.owner
    assert tuple(owner) == snapshot.rows_of(leaf)
    assert np.allclose(snapshot.occluders.vertices.min(axis=0), (5.1, 0.1, 0.1))
    place.matrix = sg.Transform(translation=(0, 0, 7)).matrix
    snapshot.sync()
    assert np.allclose(snapshot.occluders.vertices.min(axis=0), (0.1, 0.1, 7.1))
    scene.root.remove(place)
    snapshot.sync()
    assert len(snapshot.occluders) == 0


def test_occluders_are_prepared_only_where_none_are_declared() -> None:
    build = sg.registry().preparations["occluders"].build
    plain = sg.Scene(sg.Group(sg.Geode(sg.Mesh.box((0, 0, 0), (4, 1, 4)), name="wall"))).snapshot()
    found = build(plain, lambda what, share: None)
    assert len(found) == len(plain.occluders) > 0
    low, high = plain.boxes[:3, 0] - plain.boxes[3:, 0], plain.boxes[:3, 0] + plain.boxes[3:, 0]
    assert (plain.occluders.vertices >= low).all()
    assert (plain.occluders.vertices <= high).all()
    declared = sg.Scene(sg.Group(sg.Occluder.planar(SQUARE))).snapshot()
    assert build(declared, lambda what, share: None) is None
    assert len(declared.occluders) == 1
