"""The nearest point of a triangle, against a search that knows nothing of regions."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from scenegraph.kernels.triangles import point_triangle_distance, point_triangle_weights

coordinates = arrays(np.float64, (4, 3, 6), elements=st.integers(-4, 4).map(float))
places = st.sampled_from((1e-9, 1e-3, 1.0, 1e6, 1e11))


N = 60
GRID = np.array([(i, j, N - i - j) for i in range(N + 1) for j in range(N + 1 - i)]) / N


@given(coordinates, places)
def test_the_point_is_the_nearest_of_the_triangle(data, scale):
    p, a, b, c = data * scale
    distance = point_triangle_distance(p, a, b, c)
    corners = np.stack([a, b, c])
    searched = np.linalg.norm(np.einsum("gs,sck->gck", GRID, corners) - p, axis=1).min(axis=0)
    step = np.linalg.norm(corners - np.roll(corners, 1, axis=0), axis=1).max(axis=0) / N
    assert (distance <= searched + 1e-9 * scale).all()
    assert (distance >= searched - step - 1e-9 * scale).all()


@given(coordinates, places)
def test_weights_name_a_point_of_the_triangle(data, scale):
    p, a, b, c = data * scale
    weights = point_triangle_weights(p, a, b, c)
    assert (weights >= 0).all()
    np.testing.assert_allclose(weights.sum(axis=0), 1, atol=1e-12)
    point = weights[0] * a + weights[1] * b + weights[2] * c
    away = np.linalg.norm(p - point, axis=0)
    np.testing.assert_allclose(away, point_triangle_distance(p, a, b, c), atol=1e-9 * scale)


def test_triangles_without_area_are_lines_and_points():
    p = np.array([[0.0, 0.0], [1.0, 2.0], [0.0, 0.0]])
    a = np.zeros((3, 2))
    b = np.array([[2.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    c = np.array([[4.0, 0.0], [0.0, 0.0], [0.0, 0.0]])
    assert point_triangle_distance(p, a, b, c).tolist() == [1.0, 2.0]


def test_none():
    empty = np.zeros((3, 0))
    assert point_triangle_weights(empty, empty, empty, empty).shape == (3, 0)


def test_shapes_are_broadcast(rng):
    points, (a, b, c) = rng.normal(size=(3, 4, 1, 7)), rng.normal(size=(3, 3, 1, 5, 7))
    distance = point_triangle_distance(points, a, b, c)
    weights = point_triangle_weights(points, a, b, c)
    assert distance.shape == (4, 5, 7)
    assert weights.shape == (3, 4, 5, 7)
    flat = [np.broadcast_to(x, (3, 4, 5, 7)).reshape(3, -1) for x in (points, a, b, c)]
    assert np.array_equal(distance.ravel(), point_triangle_distance(*flat))
    assert np.array_equal(weights.reshape(3, -1), point_triangle_weights(*flat))
