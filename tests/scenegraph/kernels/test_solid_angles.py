"""Solid angles against closed forms, and the whole sphere around the eye."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegraph.kernels.solid_angles import angle_solid_triangles

FACES = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e11])
def test_an_octant_is_an_eighth_of_the_sphere(scale):
    """From the inside x, y, z run clockwise, so the sign is negative."""
    a, b, c = np.eye(3)[..., None] * scale
    assert angle_solid_triangles(a, b, c) == pytest.approx(-np.pi / 2, rel=1e-15)
    assert angle_solid_triangles(a, c, b) == pytest.approx(np.pi / 2, rel=1e-15)


@given(st.floats(1e-3, 30.0), st.floats(1e-3, 30.0), st.floats(0.5, 1e3))
def test_a_rectangle_before_the_eye(half_width, half_height, distance):
    """Counterclockwise as seen from the eye, which looks along -z."""
    corners = [
        (-half_width, -half_height),
        (half_width, -half_height),
        (half_width, half_height),
        (-half_width, half_height),
    ]
    points = np.array([(x, y, -distance) for x, y in corners]).T
    diagonal = np.sqrt(half_width**2 + half_height**2 + distance**2)
    truth = 4 * np.arctan(half_width * half_height / (distance * diagonal))
    for turned, sign in ((points, 1), (points[:, ::-1], -1)):
        fan = angle_solid_triangles(turned[:, [0, 0]], turned[:, [1, 2]], turned[:, [2, 3]])
        assert fan.sum() == pytest.approx(sign * truth, rel=1e-9)


def test_faces_of_a_tetrahedron_cover_the_sphere_or_cancel(rng):
    for _ in range(200):
        corners = rng.standard_normal((3, 4))
        weights = rng.dirichlet(np.ones(4))
        inside, outside = corners @ weights, corners @ np.array([1.0, 1.0, 1.0, -2.0])
        for eye, whole in ((inside, 4 * np.pi), (outside, 0.0)):
            a, b, c = np.moveaxis((corners - eye[:, None])[:, FACES], 2, 0)
            assert abs(angle_solid_triangles(a, b, c).sum()) == pytest.approx(whole, abs=1e-9)


def test_a_thin_triangle_keeps_its_digits():
    """Its area over the squared distance; a formula by arccosines loses it in 1 - 1."""
    a, b, c = np.array([[0, 0, -1e6], [1e-3, 0, -1e6], [0, 1e-3, -1e6]])[..., None]
    assert angle_solid_triangles(a, b, c) == pytest.approx(0.5e-6 / 1e12, rel=1e-6)


def test_a_corner_at_the_eye_is_not_a_number():
    assert np.isnan(angle_solid_triangles(*np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])[..., None]))
