"""Levels within an error and within a budget, against searches that try everything."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenegraph.kernels.levels import box_distance, mesh_level_budget, mesh_level_within


class TestDistance:
    @given(st.integers(0, 10**6))
    def test_against_the_clamped_point(self, seed):
        rng = np.random.default_rng(seed)
        center, half, point = rng.normal(size=(3, 9)), rng.random((3, 9)), rng.normal(size=3)
        nearest = np.clip(point[:, None], center - half, center + half)
        expected = np.linalg.norm(nearest - point[:, None], axis=0)
        np.testing.assert_allclose(box_distance(np.concatenate([center, half]), point), expected, atol=1e-12)

    def test_unknown_boxes_have_no_distance(self):
        boxes = np.zeros((6, 2))
        boxes[0, 1] = np.nan
        assert np.isnan(box_distance(boxes, np.zeros(3))).tolist() == [False, True]


class TestWithin:
    def test_the_coarsest_that_is_within(self):
        errors = np.array([[0, 0, 0, 0], [1, 1, 1, np.nan], [2, 2, np.nan, 0], [3, np.inf, 3, 0]], np.float32)
        assert mesh_level_within(errors, np.full(4, 9.0)).tolist() == [3, 2, 1, 0]
        assert mesh_level_within(errors, np.array([2.0, 0.9, 1.0, 9.0])).tolist() == [2, 0, 1, 0]
        assert mesh_level_within(errors, np.full(4, np.nan)).tolist() == [0, 0, 0, 0]
        assert mesh_level_within(errors[:1], np.full(4, 9.0)).tolist() == [0, 0, 0, 0]


def scene(seed: int, k: int, levels: int, *, lumpy: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Errors, triangles and levels to begin with, of drawables with different numbers of levels; ties are common."""
    rng = np.random.default_rng(seed)
    errors = np.cumsum(rng.integers(0, 5, (levels, k)), axis=0).astype(np.float32)
    errors[0] = 0
    triangles = rng.integers(1, 1000 if lumpy else 30, (levels, k))
    triangles[:, : k // 2] = -np.sort(-triangles[:, : k // 2], axis=0)
    count = rng.integers(1, levels + 1, k)
    errors[np.arange(levels)[:, None] >= count] = np.inf
    return errors, triangles, np.minimum(rng.integers(0, 3, k) // 2, count - 1)


def drawn(triangles: np.ndarray, levels: np.ndarray) -> int:
    return int(triangles[levels, np.arange(len(levels))].sum())


def largest(errors: np.ndarray, levels: np.ndarray, base: np.ndarray) -> float:
    """Largest error among drawables that were made coarser."""
    found = errors[levels, np.arange(len(levels))][levels > base]
    return float(found.max(initial=0))


class TestBudget:
    @settings(max_examples=200)
    @given(st.integers(0, 10**6), st.integers(0, 12), st.integers(1, 5), st.floats(0, 1.2))
    def test_within_the_budget_and_only_coarser(self, seed, k, levels, share):
        errors, triangles, base = scene(seed, k, levels)
        budget = int(share * drawn(triangles, base)) if k else 5
        chosen = mesh_level_budget(errors, triangles, base, budget=budget)
        assert (chosen >= base).all()
        assert np.isfinite(errors[chosen, np.arange(k)]).all()
        exists = np.isfinite(errors)
        last = exists.sum(axis=0) - 1
        if drawn(triangles, last) <= budget:
            assert drawn(triangles, chosen) <= budget
        if drawn(np.maximum.accumulate(np.where(exists, triangles, 0)[::-1])[::-1], base) <= budget:
            assert (chosen == base).all()

    @settings(max_examples=100)
    @given(st.integers(0, 10**6), st.integers(1, 5), st.integers(2, 4), st.floats(0, 1))
    def test_no_choice_has_a_smaller_largest_error(self, seed, k, levels, share):
        errors, triangles, base = scene(seed, k, levels)
        triangles = -np.sort(-triangles, axis=0)
        last = np.isfinite(errors).sum(axis=0) - 1
        low, high = drawn(triangles, last), drawn(triangles, base)
        budget = int(low + share * (high - low))
        chosen = mesh_level_budget(errors, triangles, base, budget=budget)
        best = min(
            largest(errors, np.array(tried), base)
            for tried in itertools.product(*(range(b, e + 1) for b, e in zip(base, last, strict=True)))
            if drawn(triangles, np.array(tried)) <= budget
        )
        assert largest(errors, chosen, base) == best

    @settings(max_examples=50)
    @given(st.integers(0, 10**6), st.booleans())
    def test_more_budget_never_gives_less(self, seed, lumpy):
        errors, triangles, base = scene(seed, 40, 5, lumpy=lumpy)
        triangles = -np.sort(-triangles, axis=0)
        high = drawn(triangles, base)
        used, worst = [], []
        for budget in np.linspace(0, 1.05 * high, 40).astype(int):
            chosen = mesh_level_budget(errors, triangles, base, budget=int(budget))
            used.append(drawn(triangles, chosen))
            worst.append(largest(errors, chosen, base))
        assert used == sorted(used)
        assert worst == sorted(worst, reverse=True)

    @settings(max_examples=50)
    @given(st.integers(0, 10**6), st.floats(0.01, 1))
    def test_the_budget_is_used(self, seed, share):
        errors, triangles, base = scene(seed, 3000, 5, lumpy=True)
        triangles = -np.sort(-triangles, axis=0)
        last = np.isfinite(errors).sum(axis=0) - 1
        low, high = drawn(triangles, last), drawn(triangles, base)
        budget = int(low + share * (high - low))
        used = drawn(triangles, mesh_level_budget(errors, triangles, base, budget=budget))
        assert 0.99 * budget <= used <= budget

    def test_one_huge_step_is_filled_up_by_small_ones(self):
        errors = np.tile(np.array([[0], [1], [2]], np.float32), 101)
        errors[1:, 0] = 5, 6
        triangles = np.repeat([[20], [10], [5]], 101, axis=1)
        triangles[:, 0] = 100_000, 1000, 100
        base = np.zeros(101, np.int64)
        chosen = mesh_level_budget(errors, triangles, base, budget=3000)
        assert drawn(triangles, chosen) == 3000
        assert chosen[0] == 1

    def test_coarsest_where_nothing_fits(self):
        errors, triangles, base = scene(3, 20, 4)
        chosen = mesh_level_budget(errors, triangles, base, budget=0)
        assert chosen.tolist() == (np.isfinite(errors).sum(axis=0) - 1).tolist()

    def test_many_equal_thresholds(self):
        k = 20_000
        errors = np.tile(np.array([[0], [1], [1]], np.float32), k)
        triangles = np.repeat([[7], [3], [1]], k, axis=1)
        base = np.zeros(k, np.int64)
        for budget in (k + 1, 3 * k, 5 * k + 3):
            chosen = mesh_level_budget(errors, triangles, base, budget=budget)
            assert 0.99 * budget <= drawn(triangles, chosen) <= budget
            assert (np.diff(chosen) <= 0).all(), "in the order of drawables"

    @pytest.mark.parametrize("scale", [1e-30, 1.0, 1e30])
    def test_scale_of_errors_does_not_matter(self, scale):
        errors, triangles, base = scene(5, 300, 5)
        expected = mesh_level_budget(errors, triangles, base, budget=1500)
        scaled = mesh_level_budget(errors * np.float32(scale), triangles, base, budget=1500)
        np.testing.assert_array_equal(scaled, expected)
