"""Outcodes of points against the planes of a view."""

from __future__ import annotations

import numpy as np
import pytest

from scenegraph import View
from scenegraph.kernels.windows import point_outcodes


@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e11])
@pytest.mark.parametrize("parallel", [None, 3.0])
def test_one_bit_per_plane(rng, scale, parallel):
    view = View((0, 0, 0), (0, 0, -1), near=scale, far=9 * scale, parallel_scale=parallel and parallel * scale)
    planes = view.planes(view.eye)
    points = rng.uniform(-10, 10, (3, 4, 100)) * scale
    codes = point_outcodes(points, planes, size=10 * scale)
    assert codes.shape == (4, 100)
    distance = np.einsum("pi,ijk->pjk", planes[:, :3], points) + planes[:, 3][:, None, None]
    for bit in range(6):
        assert np.array_equal((codes >> bit) & 1, distance[bit] < 0)
    assert len(set(codes.ravel().tolist())) > 10


def test_border_and_nan_count_as_inside():
    planes = np.array([[1.0, 0, 0, -2.0]])
    points = np.array([[2.0, 2 - 1e-15, np.nan, 1.0], [7.0] * 4, [-7.0] * 4])
    assert point_outcodes(points, planes, size=7.0).tolist() == [0, 0, 0, 1]
