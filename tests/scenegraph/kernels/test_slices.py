"""Index arithmetic against what a loop finds."""

from __future__ import annotations

import numpy as np
import pytest

from scenegraph.kernels.slices import slice_entries


@pytest.mark.parametrize("before", [(), (3,)])
@pytest.mark.parametrize("shape", [(4,), (2, 4)])
def test_one_index_for_all_columns_is_the_same_index_for_each(rng, before, shape):
    values = rng.normal(size=(*before, 6, 5))
    one = rng.integers(0, 6, (*shape, 1))
    for index in (one, rng.integers(0, 6, (*shape, 5))):
        found = slice_entries(values, index)
        assert found.shape == (*before, *shape, 5)
        for column in range(5):
            picked = index[..., min(column, index.shape[-1] - 1)]
            assert np.array_equal(found[..., column], values[..., column][..., picked])
    assert np.array_equal(slice_entries(values, one), slice_entries(values, np.broadcast_to(one, (*shape, 5))))
