"""The pattern of OpenGL's tessellator, and the bound of what Phong tessellation bends."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenegraph.kernels.tessellation import (
    edge_phong_points,
    face_phong_error,
    face_phong_points,
    face_tessellation,
    face_tessellation_count,
)

LEVELS = range(1, 23)


def by_the_rings(level: int) -> int:
    """Triangles by the text of the specification: a strip per side and ring, then a triangle, six of them, or none."""
    if level < 2:
        return level
    return 3 * (level + level - 2) + by_the_rings(level - 2)


@pytest.mark.parametrize("level", LEVELS)
class TestPattern:
    def test_count(self, level):
        weights, faces = face_tessellation(level)
        assert len(faces) == face_tessellation_count(level) == by_the_rings(level)
        # Euler: a disk whose rim has 3 x level points
        assert 2 * len(weights) == len(faces) + 3 * level + 2

    def test_it_fills_the_triangle_once(self, level):
        weights, faces = face_tessellation(level)
        assert (weights >= 0).all()
        np.testing.assert_allclose(weights.sum(axis=1), 1)
        area = np.linalg.det(weights[faces])
        assert (area > 0).all(), "counterclockwise, none flat"
        assert area.sum() == pytest.approx(1)
        runs = Counter(map(tuple, np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).tolist()))
        assert set(runs.values()) == {1}
        rim = [run for run in runs if run[::-1] not in runs]
        assert len(rim) == 3 * level

    def test_the_rim_is_in_order(self, level):
        weights, _ = face_tessellation(level)
        np.testing.assert_array_equal(weights[:3], np.eye(3))
        step = np.arange(1, level) / level
        for side in range(3):
            points = weights[3 + side * (level - 1) : 3 + (side + 1) * (level - 1)]
            expected = np.zeros((level - 1, 3))
            expected[:, side], expected[:, (side + 1) % 3] = 1 - step, step
            np.testing.assert_allclose(points, expected, atol=1e-15)

    def test_inner_points_lie_across_from_those_of_the_rim(self, level):
        if level < 3:
            return
        weights, _ = face_tessellation(level)
        equilateral = weights @ np.array([[0, 0], [1, 0], [0.5, 0.75**0.5]])
        inner = equilateral[3 * level]
        assert inner == pytest.approx([1 / level, 1 / level / 3**0.5]), "over the first point of either side"


def test_level_20_as_the_thesis_counts():
    assert 98 * face_tessellation_count(20) * 5001 == 294_058_800
    assert 98 * face_tessellation_count(20) * 10_001 == 588_058_800


def test_levels_below_one_are_refused():
    with pytest.raises(ValueError, match="below 1"):
        face_tessellation(0)


def random_faces(rng: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray]:
    normals = rng.normal(size=(count, 3, 3))
    return rng.normal(size=(count, 3, 3)), normals / np.linalg.norm(normals, axis=2, keepdims=True)


@given(st.integers(0, 10**6), st.floats(0, 1))
def test_a_side_depends_on_its_ends_only(seed, shape):
    rng = np.random.default_rng(seed)
    corners, normals = random_faces(rng, 4)
    share = rng.random(5)
    weights = np.stack([1 - share, share, 0 * share], axis=1)
    side = face_phong_points(corners, normals, weights, shape=shape)
    np.testing.assert_allclose(edge_phong_points(corners[:, :2], normals[:, :2], share, shape=shape), side, atol=1e-12)
    corners[:, 2], normals[:, 2] = rng.normal(size=(4, 3)), 0
    np.testing.assert_array_equal(face_phong_points(corners, normals, weights, shape=shape), side)


@given(st.integers(0, 10**6))
def test_points_are_projected_as_the_paper_says(seed):
    rng = np.random.default_rng(seed)
    corners, normals = random_faces(rng, 1)
    weights = rng.dirichlet(np.ones(3), 4)
    for w, point in zip(weights, face_phong_points(corners, normals, weights)[0], strict=True):
        flat = w @ corners[0]
        onto = [flat - ((flat - p) @ n) * n for p, n in zip(corners[0], normals[0], strict=True)]
        np.testing.assert_allclose(point, 0.25 * flat + 0.75 * (w @ np.array(onto)), atol=1e-12)


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 9))
def test_no_part_is_farther_from_the_surface_than_the_bound(seed, level):
    rng = np.random.default_rng(seed)
    corners, normals = random_faces(rng, 3)
    bound = face_phong_error(corners, normals, level)
    weights, faces = face_tessellation(level)
    inside = rng.dirichlet(np.ones(3), 20)
    there = np.einsum("mk,fkc->fmc", inside, weights[faces]).reshape(-1, 3)
    bent = face_phong_points(corners, normals, there)
    parts = np.einsum("mk,xfkc->xfmc", inside, face_phong_points(corners, normals, weights)[:, faces])
    away = np.linalg.norm(bent - parts.reshape(3, -1, 3), axis=2).max(axis=1)
    assert (away <= bound * (1 + 1e-9)).all()
    assert (away > 0.2 * bound).all(), "the bound says something"
