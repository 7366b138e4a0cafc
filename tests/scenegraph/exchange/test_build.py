"""Offsets, welding, validation of raw arrays, and remarks."""

from __future__ import annotations

import logging
import sys
import warnings

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays

from scenegraph.exchange.build import (
    FLAT_FAR,
    MESH_FAR,
    Builder,
    bounds_of,
    common_offset,
    far_offset,
    weld,
    world_bounds,
)
from scenegraph.exchange.materials import Look
from scenegraph.exchange.problems import Problems, quiet_trimesh
from scenegraph.mesh import Mesh
from scenegraph.nodes import Geode, Group, Transform

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])


@given(
    points=arrays(np.float64, (5, 3), elements=st.floats(-1, 1)),
    away=arrays(np.float64, 3, elements=st.floats(-1e11, 1e11)),
    size=st.floats(1e-9, 1e6),
    limit=st.sampled_from([FLAT_FAR, MESH_FAR]),
)
def test_moving_to_the_origin_and_back_is_exact(
    points: np.ndarray, away: np.ndarray, size: float, limit: float
) -> None:
    vertices = points * size + away
    bounds = bounds_of(vertices)
    offset = far_offset(bounds, limit)
    if offset is None:
        half = max(np.ptp(bounds, axis=0).max() / 2, np.abs(bounds).max() * 2.0**-30)
        # of numbers that are almost too small to be told from 0 nothing is far
        assert np.abs(bounds).max() <= limit * half or half < 1e-300
        return
    local = vertices - offset
    np.testing.assert_array_equal(local + offset, vertices)
    extent = max(np.ptp(bounds, axis=0).max(), np.abs(bounds).max() * 2.0**-29)
    assert np.abs(local).max() <= 2.5 * extent


def test_what_is_near_or_unknown_gets_no_offset() -> None:
    assert far_offset([[-1, -1, -1], [1, 1, 1]], FLAT_FAR) is None
    assert far_offset([[0, 0, 0], [0, 0, 0]], FLAT_FAR) is None
    assert far_offset([[1e-314] * 3, [1e-314 + 2e-323] * 3], FLAT_FAR) is None
    assert far_offset([[2e-320] * 3] * 2, FLAT_FAR) is None
    assert far_offset(np.full((2, 3), np.nan), FLAT_FAR) is None
    assert far_offset([[np.inf] * 3] * 2, FLAT_FAR) is None
    assert far_offset([[-1.7e308] * 3, [1.7e308] * 3], FLAT_FAR) is None


def test_a_stray_does_not_move_the_common_offset() -> None:
    city = np.array([[[5.4e6 + i, 0, 0], [5.4e6 + i + 10, 10, 10]] for i in range(50)])
    marker = np.array([[[0.0, 0, 0], [1, 1, 1]]])
    unknown = np.full((1, 2, 3), np.nan)
    offset = common_offset(np.concatenate([city, marker, unknown]))
    assert offset is not None
    assert abs(offset[0] - 5.4e6) < 1000


@given(
    arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.sampled_from([0.0, -0.0, 1e-300, 1.0]))
)
def test_welding_is_exact_and_complete(vertices: np.ndarray) -> None:
    kept, index = weld(vertices)
    np.testing.assert_array_equal(kept[index], vertices)
    assert len(kept) == len({tuple(v) for v in vertices.tolist()})
    assert (np.diff([np.flatnonzero(index == i)[0] for i in range(len(kept))]) > 0).all(), "in order of first use"


def test_welding_keeps_vertices_that_differ_in_the_last_bit() -> None:
    vertices = np.array([[1.0, 0, 0], [np.nextafter(1.0, 2), 0, 0], [1.0, 0, 0], [np.nan, 0, 0]])
    kept, index = weld(vertices)
    assert index.tolist() == [0, 1, 0, 2]
    assert len(kept) == 3


def test_only_soups_are_welded() -> None:
    problems = Problems()
    soup = np.concatenate([TRIANGLE, TRIANGLE + [1, 0, 0]])
    welded = Builder(problems).part(soup, [[0, 1, 2], [3, 4, 5]], name="soup")
    assert welded is not None
    assert len(welded.mesh.vertices) == 5
    shared = np.concatenate([soup, soup[:1]])
    kept = Builder(problems).part(shared, [[0, 1, 2], [3, 4, 5]], name="kept")
    assert kept is not None
    assert len(kept.mesh.vertices) == 7
    smooth = Builder(problems).part(soup, [[0, 1, 2], [3, 4, 5]], name="smooth", normals=np.ones((6, 3)))
    assert smooth is not None
    assert len(smooth.mesh.vertices) == 6


def test_faces_beyond_the_vertices_are_dropped_and_counted() -> None:
    problems = Problems()
    part = Builder(problems).part(TRIANGLE, [[0, 1, 2], [0, 1, 3], [-1, 0, 1]], name="broken")
    assert part is not None
    assert part.mesh.faces.tolist() == [[0, 1, 2]]
    assert Builder(problems).part(TRIANGLE, [[0, 1, 7]], name="lost") is None
    assert problems.sentences() == [
        "faces dropped because they name vertices that do not exist: 'broken' (2 of 3), 'lost' (1 of 1)",
        "meshes without faces left out: 'lost'",
    ]


def test_face_colors_become_vertex_colors_of_separate_triangles() -> None:
    colors = np.array([[255, 0, 0, 255], [0, 255, 0, 255]], np.uint8)
    quad = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    part = Builder(Problems()).part(quad, [[0, 1, 2], [0, 2, 3]], name="quad", look=Look(face_colors=colors))
    assert part is not None
    assert part.mesh.vertex_colors is not None
    np.testing.assert_array_equal(part.mesh.vertices[part.mesh.faces], quad[[[0, 1, 2], [0, 2, 3]]])
    np.testing.assert_array_equal(part.mesh.vertex_colors[part.mesh.faces[:, 0]], colors)


def test_a_mesh_far_from_its_origin_is_placed_below_a_transform() -> None:
    away = np.array([4.5e6, 5.1e6, 10.0])
    part = Builder(Problems()).part(TRIANGLE + away, [[0, 1, 2]], name="far")
    assert part is not None
    node = part.place("far")
    assert isinstance(node, Transform)
    assert np.abs(part.mesh.vertices).max() < 100
    np.testing.assert_array_equal(part.mesh.vertices + node.matrix[:3, 3], TRIANGLE + away)
    np.testing.assert_array_equal(world_bounds(node), [away, away + [1, 1, 0]])


def test_huge_and_singular_things_are_named() -> None:
    problems = Problems()
    builder = Builder(problems)
    part = builder.part(TRIANGLE * 1e200, [[0, 1, 2]], name="galaxy")
    assert part is not None
    flat, endless = np.diag([1.0, 1, 0, 1]), np.eye(4)
    endless[0, 3] = np.inf
    far = np.eye(4)
    far[0, 3] = 1e20
    root = Group(
        Transform(Geode(part.mesh), matrix=flat, name="flat"),
        Transform(Geode(part.mesh), matrix=endless, name="endless"),
        Transform(Geode(part.mesh), matrix=far, name="remote"),
        Transform(Geode(part.mesh), matrix=np.diag([1e-9, -1e9, 1, 1]), name="fine"),
        name="r",
    )
    builder.check(root)
    huge, singular = problems.sentences()
    assert "'galaxy' (1e+200)" in huge
    assert "'/r/remote' (1e+20)" in huge
    assert "'/r/flat', '/r/endless'" in singular
    assert "fine" not in huge + singular


def test_world_bounds_skip_what_is_unknown() -> None:
    box, broken = Mesh.box((0, 0, 0), (1, 2, 3)), Mesh(np.full((3, 3), np.nan), [[0, 1, 2]])
    root = Group(Transform(Geode(box), rotation=(90, (0, 0, 1)), translation=(10, 0, 0)), Geode(broken))
    np.testing.assert_allclose(world_bounds(root), [[8, 0, 0], [10, 1, 3]], atol=1e-12)
    assert np.isnan(world_bounds(Group(Geode(broken)))).all()
    assert np.isnan(world_bounds(Group())).all()


def test_many_names_are_cut_short() -> None:
    problems = Problems()
    for i in range(9):
        problems.note("odd", f"m{i}", str(i))
    problems.note("odd", "m0", "0")
    problems.say("Alone.")
    assert problems.sentences() == ["odd: 'm0' (0), 'm1' (1), 'm2' (2), 'm3' (3), 'm4' (4) and 4 more", "Alone."]


def test_what_trimesh_logs_and_warns_becomes_a_problem(capsys: pytest.CaptureFixture[str]) -> None:
    problems = Problems()
    logger = logging.getLogger("trimesh")
    before = (list(logger.handlers), logger.propagate)
    with quiet_trimesh(problems):
        logger.warning("strange %s", "thing")
        logger.info("quiet")
        warnings.warn("never seen", UserWarning, stacklevel=1)
    assert problems.sentences() == ["trimesh: strange thing"]
    assert (list(logger.handlers), logger.propagate) == before
    assert capsys.readouterr().err == ""
    assert "pyvista" not in dir(sys.modules["scenegraph.exchange.build"])
