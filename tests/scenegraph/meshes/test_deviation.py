"""Bounds of how far surfaces lie apart: never too small, worth what they promise, and the short cuts they take."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from level_shapes import ball, brute_distance, random_points, sheet
from scenegraph import Mesh
from scenegraph.meshes import simplify
from scenegraph.meshes.deviation import FLOOR, Surface, _cut, is_among, surface_deviation
from scenegraph.meshes.hlod_nodes import TOLERANCE, NodeMesh, _distance, _farthest, simplified


def triangles_of(mesh: Mesh) -> np.ndarray:
    return np.asarray(mesh.vertices[mesh.faces])


def mesh_of(triangles: np.ndarray) -> Mesh:
    return Mesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


def sampled(mesh: Mesh, other: Mesh, rng: np.random.Generator, count: int = 60_000) -> float:
    """Greatest distance found from points of a mesh to another one: never more than the true one."""
    points = [random_points(mesh, count, rng), mesh.vertices, triangles_of(mesh).mean(axis=1)]
    return float(brute_distance(np.concatenate(points), other).max())


@pytest.mark.parametrize("tolerance", [0.02, 0.1, TOLERANCE, 1.0])
@pytest.mark.parametrize("which", ["ball", "sheet", "kept border", "moved"])
def test_dense_samples_are_within_the_bound_and_the_bound_within_the_tolerance(which, tolerance, rng):
    mesh = ball(14, 0.2) if which == "ball" else sheet(24, 0.1)
    if which == "moved":
        # one vertex of many: all other triangles are the same
        points = mesh.vertices.copy()
        points[300, 2] += 0.07
        other = Mesh(points, mesh.faces)
    else:
        other = simplify(mesh, mesh.triangles // 5, preserve_border=which == "kept border", cache=None)[0]
    found = surface_deviation(triangles_of(mesh), Surface(triangles_of(other)), tolerance=tolerance)
    farthest = sampled(mesh, other, rng)
    assert 0 < farthest <= found.bound * (1 + 1e-6)
    size = np.ptp(other.vertices, axis=0).max()
    assert found.bound <= max((1 + tolerance) * found.found, found.found + FLOOR * size)
    # as far as the samples are dense enough to come near it
    assert found.found <= farthest * 1.1, "a far point was found, not made up"


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.integers(1, 30), st.integers(0, 30))
def test_what_both_surfaces_have_hides_nothing_of_the_rest(seed, m, n, common):
    rng = np.random.default_rng(seed)
    a, b, both = (rng.normal(size=(k, 3, 3)) for k in (m, n, common))
    a, b = np.concatenate([both, a]), np.concatenate([b, np.roll(both, 1, axis=1)])
    found = surface_deviation(a, Surface(b), tolerance=TOLERANCE)
    assert sampled(mesh_of(a), mesh_of(b), rng, 3000) <= found.bound * (1 + 1e-6)
    alone = surface_deviation(a[common:], Surface(b), tolerance=TOLERANCE)
    assert alone == found


def test_the_same_triangles_are_no_distance_apart_in_any_order_of_their_corners(rng):
    triangles = rng.normal(size=(200, 3, 3))
    assert is_among(triangles, np.stack([t[rng.permutation(3)] for t in triangles])).all()
    assert surface_deviation(triangles, Surface(triangles[::-1, ::-1])) == (0.0, 0.0)
    # as many bits as can be close to it are not it
    near = triangles.copy()
    near[:, 1, 2] = np.nextafter(near[:, 1, 2], np.inf)
    assert not is_among(near, triangles).any()
    # nor are corners of several triangles one of them
    assert not is_among(np.stack([triangles[:-1, 0], triangles[:-1, 1], triangles[1:, 2]], axis=1), triangles).any()


def test_zeros_are_the_same_whatever_their_sign():
    triangles = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]])
    assert is_among(-0.0 - triangles * 0.0 + triangles, triangles).all()
    assert is_among(np.where(triangles == 0, -0.0, triangles), triangles).all()


def test_marks_that_meet_by_chance_make_nothing_the_same(monkeypatch, rng):
    a, b = rng.normal(size=(2, 20, 3, 3))
    b[:, 0] = a[0, 1]
    monkeypatch.setattr("scenegraph.meshes.deviation._marks", lambda sets: np.zeros(len(sets), np.uint64))
    assert not is_among(a, b).any()


@pytest.mark.parametrize("flat", ["point", "line"])
def test_surfaces_without_area_have_distances_too(flat):
    other = np.zeros((1, 3, 3))
    if flat == "line":
        other[0, 1] = (1, 0, 0)
    asked = np.array([[[0.0, 0, 3], [1, 0, 3], [0, 1, 3]]])
    farthest = np.sqrt(10)
    found = surface_deviation(asked, Surface(other))
    assert farthest * (1 - 1e-9) <= found.bound <= 1.1 * farthest


@pytest.mark.parametrize("least", [0.0, 0.01, 10.0])
def test_the_farthest_point_is_found_by_middles_and_where_they_mislead(least, rng):
    # one triangle as large as a thousand small ones: points over it are nearer to the middles of small ones
    small = triangles_of(sheet(20))
    large = np.array([[[1.0, 0, 0], [21, 0, 0], [1, 20, 0]]])
    triangles = np.concatenate([small, large])
    points = np.array([[1.2, 0.3, 0.004], [3.0, 1.0, 0.02], [0.4, 0.4, 0.015], [0.2, 0.2, 0.0]])
    assert _farthest(points, triangles, least) == pytest.approx(max(least, 0.02))
    assert _farthest(points[:0], triangles, least) == least


def test_what_only_the_coarser_mesh_has_counts_by_its_corners_and_middles():
    before = sheet(8)
    far = np.array([[0.3, 0.3, 0.5], [0.6, 0.3, 0.5], [0.3, 0.6, 0.5]])
    points = np.concatenate([before.vertices, far])
    faces = np.concatenate([before.faces, [np.arange(3) + len(before.vertices)]])
    assert _distance(triangles_of(before), before.vertices, before.faces) == 0
    assert _distance(triangles_of(before), points, faces) == pytest.approx(0.5)
    bridge = np.concatenate([before.faces, [[0, 8, len(points) - 1]]])
    assert _distance(triangles_of(before), points, bridge) == pytest.approx(0.5)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_cut_triangles_are_whole(seed):
    rng = np.random.default_rng(seed)
    whole, against = rng.normal(size=(2, 3, 3))
    pieces = _cut(whole[None], against[None], 1e-9)
    assert len(pieces) in (3, 4)
    sides = np.cross(pieces[:, 1] - pieces[:, 0], pieces[:, 2] - pieces[:, 0])
    side = np.cross(whole[1] - whole[0], whole[2] - whole[0])
    # their areas add up, all facing the same way: no part is missing, and none lies over another
    assert (sides @ side >= -1e-9 * (side @ side)).all()
    assert np.allclose(sides.sum(axis=0), side, atol=1e-9)
    edges = (whole[1:] - whole[0]).T
    weights = np.linalg.lstsq(edges, (pieces.reshape(-1, 3) - whole[0]).T, rcond=None)[0]
    assert weights.min() > -1e-6
    assert weights.sum(axis=0).max() < 1 + 1e-6


def test_nodes_are_within_the_error_of_one_simplification(rng):
    mesh = sheet(40, 0.1)
    count = len(mesh.vertices)
    node = NodeMesh(mesh.vertices, np.zeros((count, 3), np.float32), np.zeros((count, 4), np.uint8), mesh.faces)
    made, step = simplified(node, 700)
    after = Mesh(made.vertices, made.faces)
    same = int(is_among(made.corners, node.corners).sum())
    assert 0 < same < len(made.faces), "some triangles are as they were, some are not"
    farthest = sampled(mesh, after, rng)
    assert 0 < farthest <= step.error * (1 + 1e-6)
    assert step.error <= 2 * farthest
    back = np.concatenate([made.vertices, made.corners.mean(axis=1)])
    assert brute_distance(back, mesh).max() <= step.error * (1 + 1e-6)
