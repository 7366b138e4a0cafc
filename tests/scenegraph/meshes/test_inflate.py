"""Boxes and polytopes grown until they touch the surface."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull

from mesh_proofs import torus
from scenegraph.meshes.inflate import HalfSpaces, inflated, nearest_points


def cube(dimension: int, half: float) -> HalfSpaces:
    return HalfSpaces(np.concatenate([np.eye(dimension), -np.eye(dimension)]), np.full(2 * dimension, half))


def apart(a: np.ndarray, b: np.ndarray) -> bool:  # type: ignore[type-arg]
    """Whether the convex hulls of two point sets have no point in common: no combination of both is equal."""
    d = a.shape[1]
    equal = np.zeros((d + 2, len(a) + len(b)))
    equal[:d, : len(a)], equal[:d, len(a) :] = a.T, -b.T
    equal[d, : len(a)] = equal[d + 1, len(a) :] = 1
    return bool(linprog(np.zeros(equal.shape[1]), A_eq=equal, b_eq=[0.0] * d + [1.0, 1.0]).status == 2)


@pytest.mark.parametrize("dimension", [2, 3])
@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_polytopes_keep_clear_of_all_obstacles(dimension: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-4, 4, size=(60, 1, dimension)) + rng.normal(size=(60, dimension, dimension))
    half = np.full(dimension, 0.3)
    corners = corners[(np.sqrt((nearest_points(corners) ** 2).sum(axis=1)) > 0.8)]
    found = inflated(corners, -half, half, np.full(dimension, 1e-6), planes=20, within=cube(dimension, 5.0))
    assert found is not None
    assert np.abs(found).max() < 5
    assert all(apart(found, simplex) for simplex in corners)


def test_a_box_of_obstacles_is_filled() -> None:
    big = ConvexHull(np.array([[x, y, z] for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)], float))
    walls = big.points[big.simplices]
    found = inflated(walls, np.full(3, -0.2), np.full(3, 0.3), np.full(3, 1e-6), planes=8, within=cube(3, 10.0))
    assert found is not None
    assert ConvexHull(found).volume == pytest.approx(48, rel=1e-4)
    assert (np.abs(found) < [1, 2, 3]).all()


def test_few_planes_are_enough_about_a_curved_surface_or_there_is_no_answer() -> None:
    ring = torus(3, 1, 48, 24)
    walls = ring.vertices[ring.faces]
    low, high = np.array([2.8, -0.2, -0.2]), np.array([3.2, 0.2, 0.2])
    volume = []
    for planes in (8, 12, 20, 40):
        found = inflated(walls, low, high, np.full(3, 1e-6), planes=planes, within=cube(3, 5.0))
        assert found is not None
        volume.append(ConvexHull(found).volume)
    assert volume == sorted(volume)
    assert inflated(walls, low, high, np.full(3, 1e-6), planes=2, within=cube(3, 5.0)) is None


@given(seed=st.integers(0, 2**32 - 1))
def test_nearest_points(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for dimension in (2, 3):
        corners = rng.normal(size=(20, 1, dimension)) + rng.normal(size=(20, dimension, dimension))
        corners[:3] = corners[:3, :1]  # points
        near = nearest_points(corners)
        best = np.sqrt((near**2).sum(axis=1))
        samples = np.einsum("nk,mkd->nmd", rng.dirichlet(np.full(dimension, 0.5), 500), corners)
        distance = np.sqrt((samples**2).sum(axis=2)).min(axis=0)
        assert (best <= distance + 1e-12).all()
        # convex: all lies beyond the plane through the nearest point
        assert (np.einsum("mkd,md->mk", corners, near).min(axis=1) >= best**2 - 1e-9).all()
