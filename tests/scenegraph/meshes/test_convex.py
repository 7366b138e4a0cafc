"""Meshes that are convex solids are their own occluder; nothing else is taken for one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mesh_proofs import assert_hidden, assert_within_convex, hull, rotation, torus, turned, without
from scenegraph import Mesh
from scenegraph.meshes.convex import upright_box
from scenegraph.meshes.fitting import fit_convex

CUBE = Mesh.box((0, 0, 0), (1, 1, 1))


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(4, 8), scale=st.sampled_from([1e-3, 1.0, 1e4]))
def test_hulls_of_few_points(seed: int, count: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    mesh = hull(rng.normal(size=(count, 3)) * rng.uniform(0.1, 1, 3) * scale)
    found = fit_convex(mesh)
    assert found is not None
    assert_within_convex(mesh, found)
    assert_hidden(mesh, found, rng)


def test_a_turned_box_is_a_box(rng: np.random.Generator) -> None:
    for side in ((1, 1, 1), (1, 20, 0.02)):
        mesh = turned(Mesh.box((0, 0, 0), side), rotation(rng), rng.normal(size=3) * 100)
        found = fit_convex(mesh)
        assert found is not None
        (box,) = found.occluders
        assert box.kind == "box"
        assert len(box.points) == 8
        assert box.node().kind == "solid"
        assert_within_convex(mesh, found)


def dented(depth: float) -> Mesh:
    """A cube with the middle of one side pushed in."""
    top = np.isclose(CUBE.vertices[CUBE.faces][:, :, 2], 1).all(axis=1)
    ring = [4, 5, 7, 6]
    assert np.allclose(CUBE.vertices[ring][:, 2], 1)
    fan = [[ring[i], ring[(i + 1) % 4], 8] for i in range(4)]
    return Mesh(np.vstack([CUBE.vertices, [[0.5, 0.5, 1 - depth]]]), np.vstack([CUBE.faces[~top], fan]))


@pytest.mark.parametrize("depth", [0.3, 1e-3, 1e-5])
def test_dents_are_seen(depth: float) -> None:
    assert fit_convex(dented(depth)) is None
    assert fit_convex(dented(0.0)) is not None


def test_what_is_no_convex_solid() -> None:
    two = Mesh(np.vstack([CUBE.vertices, CUBE.vertices + 3]), np.vstack([CUBE.faces, CUBE.faces + 8]))
    inner = Mesh(np.vstack([CUBE.vertices, CUBE.vertices * 0.5 + 0.25]), np.vstack([CUBE.faces, CUBE.faces + 8]))
    sheet = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    for mesh in (torus(1, 0.3), without(CUBE, (0, 0, 1)), two, inner, sheet, Mesh(np.zeros((0, 3)), np.zeros((0, 3)))):
        assert fit_convex(mesh) is None
    ball = np.random.default_rng(1).normal(size=(60, 3))
    assert fit_convex(hull(ball / np.linalg.norm(ball, axis=1)[:, None])) is None, "of too many sides"


def test_turned_inside_out_it_is_as_closed() -> None:
    found = fit_convex(Mesh(CUBE.vertices, CUBE.faces[:, ::-1]))
    assert found is not None
    assert_within_convex(CUBE, found)


def test_boxes_along_the_axes_are_seen_at_once(rng: np.random.Generator) -> None:
    soup = Mesh(CUBE.vertices[CUBE.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3))
    for mesh in (CUBE, soup, Mesh.box((-1e6, 5, 0), (-1e6 + 3, 5.25, 1e3)), Mesh(CUBE.vertices, CUBE.faces[:, ::-1])):
        corners = upright_box(mesh)
        assert corners is not None
        low, high = mesh.bounds
        assert (corners > low).all()
        assert (corners < high).all()
        assert np.abs([corners.min(axis=0) - low, corners.max(axis=0) - high]).max() <= 1e-5 * (high - low).max()
        found = fit_convex(mesh)
        assert found is not None
        assert np.array_equal(found.occluders[0].points, corners)
        assert_hidden(mesh, found, rng)


@pytest.mark.parametrize("seed", range(20))
def test_what_only_looks_like_a_box(seed: int) -> None:
    """Twelve triangles between corners of a box, with one of them turned, doubled, or laid across its inside."""
    rng = np.random.default_rng(seed)
    faces = CUBE.faces.copy()
    change = rng.integers(3)
    i, j = rng.choice(12, 2, replace=False)
    if change == 0:
        faces[i] = faces[i][::-1]
    elif change == 1:
        faces[i] = faces[j]
    else:
        faces[i] = [0, 3, 6]
    assert upright_box(Mesh(CUBE.vertices, faces)) is None
    bent = CUBE.vertices.copy()
    bent[rng.integers(8), rng.integers(3)] += 1e-9
    assert upright_box(Mesh(bent, CUBE.faces)) is None
    assert upright_box(turned(CUBE, rotation(rng))) is None
