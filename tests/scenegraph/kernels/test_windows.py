"""Points and edges against the planes of a view."""

from __future__ import annotations

import numpy as np
import pytest

from scenegraph import View
from scenegraph.kernels.windows import edge_enters, point_inside, point_outcodes, point_sides


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
    inside = point_inside(points, planes, size=10 * scale)
    assert np.array_equal(inside, codes == 0)
    assert inside.any()


def test_border_and_nan_count_as_inside():
    planes = np.array([[1.0, 0, 0, -2.0]])
    points = np.array([[2.0, 2 - 1e-15, np.nan, 1.0], [7.0] * 4, [-7.0] * 4])
    assert point_outcodes(points, planes, size=7.0).tolist() == [0, 0, 0, 1]
    assert not point_inside(points, planes, size=7.0).any()
    assert point_inside(points + 1e-9, planes, size=7.0).tolist() == [True, True, False, False]


@pytest.mark.parametrize("scale", [1.0, 1e-9, 1e11])
def test_segments_that_enter_have_points_inside(rng, scale):
    view = View((0, 0, 0), (0, 0, -1), fov=40.0, near=scale, far=9 * scale)
    planes = view.planes(view.eye)[:4]
    start, end = rng.uniform(-10, 10, (2, 3, 500)) * scale
    enters = edge_enters(start, end, planes, size=10 * scale)
    along = start + (end - start) * np.linspace(0, 1, 2001)[:, None, None]
    distance = np.einsum("pi,tik->tpk", planes[:, :3], along) + planes[:, 3][:, None]
    found = (distance > 0).all(axis=1)
    assert enters[found.sum(axis=0) > 1].all()
    # what is found between two samples only is a short part at the border
    assert (distance.min(axis=1).max(axis=0)[enters] > -0.05 * scale).all()
    assert 20 < enters.sum() < 480


def test_segments_at_the_border_do_not_enter():
    planes = np.array([[1.0, 0, 0, 0], [0, 1, 0, 0]])
    start = np.array([[-1.0, 0, -1, np.nan, -1], [1, 0, 0, 1, 1], [0, 0, 0, 0, 0]])
    end = np.array([[1.0, 1, 1, 1, 1], [-1, 0, 0, 1, 1], [0, 0, 0, 0, 0]])
    # through the corner, along a side, along a side from without, not a number, and truly
    assert edge_enters(start, end, planes, size=1.0).tolist() == [False, False, False, False, True]


def test_both_answers_at_once_are_those_of_each(rng):
    view = View((1.0, 2.0, 3.0), (4.0, 1.0, 2.0), near=1.0, far=50.0)
    points = rng.normal(size=(3, 20, 30)) * 30
    points[:, 0, 0] = np.nan
    planes = view.planes(view.eye)
    codes, inside = point_sides(points, planes, size=200.0, around=4)
    assert np.array_equal(codes, point_outcodes(points, planes, size=200.0))
    assert np.array_equal(inside, point_inside(points, planes[:4], size=200.0))
    assert inside.any()
    assert not (inside & ((codes & 0b1111) != 0)).any()
