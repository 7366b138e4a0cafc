"""Largest cuboids of enclosed cells."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenegraph.meshes.cuboids import Sums, maximal_boxes, spread_out

CELL = np.array([1.0, 0.5, 2.0])


def surface(boxes: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    x, y, z = ((boxes[:, 1] - boxes[:, 0]) * CELL).T
    return np.asarray(2 * (x * y + y * z + z * x))


def full(mask: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    return np.asarray(Sums(mask).count(low, high) == (high - low).prod(axis=1))


def all_boxes(mask: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    """Every box of full cells, by brute force."""
    spans = [list(itertools.combinations(range(n + 1), 2)) for n in mask.shape]
    low, high = np.array(list(itertools.product(*spans)), np.int64).transpose(2, 0, 1)
    kept = full(mask, low, high)
    return np.stack([low[kept], high[kept]], axis=1)


@given(seed=st.integers(0, 2**32 - 1))
def test_sums_count(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mask = rng.random((5, 6, 7)) < 0.7
    low = rng.integers(0, mask.shape, size=(20, 3))
    high = np.minimum(low + rng.integers(0, 5, size=(20, 3)), mask.shape)
    expected = [
        mask[tuple(slice(a, b) for a, b in zip(x, y, strict=True))].sum() for x, y in zip(low, high, strict=True)
    ]
    assert Sums(mask).count(low, high).tolist() == expected


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.1, 0.5, 0.9, 0.99]), flat=st.booleans())
def test_boxes_are_full_and_cannot_grow_and_the_largest_is_found(seed: int, share: float, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    mask = rng.random((8, 7, 1 if flat else 6)) < share
    mask[2:6, 2:5] = True
    boxes = maximal_boxes(mask, cell=CELL)
    assert full(mask, boxes[:, 0], boxes[:, 1]).all()
    for axis in range(3):
        step = np.eye(3, dtype=np.int64)[axis]
        for low, high in ((boxes[:, 0] - step, boxes[:, 1]), (boxes[:, 0], boxes[:, 1] + step)):
            within = (low[:, axis] >= 0) & (high[:, axis] <= mask.shape[axis])
            assert not full(mask, low[within], high[within]).any()
    assert surface(boxes).max() >= 0.9 * surface(all_boxes(mask)).max()
    assert (np.diff(surface(boxes)) <= 1e-12).all()


def test_a_cross_gives_its_three_bars() -> None:
    mask = np.zeros((21, 21, 21), bool)
    mask[8:13, 8:13, :] = mask[8:13, :, 8:13] = mask[:, 8:13, 8:13] = True
    boxes = {tuple(b.reshape(-1).tolist()) for b in maximal_boxes(mask, cell=np.ones(3))}
    assert {(0, 8, 8, 21, 13, 13), (8, 0, 8, 13, 21, 13), (8, 8, 0, 13, 13, 21)} <= boxes


@pytest.mark.parametrize("shape", [(4, 4, 4), (1, 1, 1)])
def test_empty_and_full(shape: tuple[int, int, int]) -> None:
    assert len(maximal_boxes(np.zeros(shape, bool), cell=np.ones(3))) == 0
    assert maximal_boxes(np.ones(shape, bool), cell=np.ones(3)).tolist() == [[[0, 0, 0], list(shape)]]


def test_spread_out_drops_what_is_mostly_covered() -> None:
    boxes = np.array(
        [[[0, 0, 0], [4, 4, 4]], [[0, 0, 0], [4, 4, 3]], [[2, 0, 0], [7, 4, 4]], [[9, 9, 9], [10, 10, 10]]]
    )
    assert np.array_equal(spread_out(boxes, 9), boxes[[0, 2, 3]])
    assert np.array_equal(spread_out(boxes, 2), boxes[[0, 2]])
