"""Cells that a surface touches, and cells that it encloses."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenegraph.meshes.cells import cells_touched

N = 5
Point = tuple[Fraction, ...]


def clipped(polygon: list[Point], axis: int, limit: Fraction, side: int) -> list[Point]:
    """A convex polygon cut by a plane, in exact arithmetic; side * x <= side * limit stays."""
    out: list[Point] = []
    for a, b in zip(polygon, polygon[1:] + polygon[:1], strict=True):
        da, db = side * (limit - a[axis]), side * (limit - b[axis])
        if da >= 0:
            out.append(a)
        if (da > 0 > db) or (da < 0 < db):
            share = da / (da - db)
            out.append(tuple(x + share * (y - x) for x, y in zip(a, b, strict=True)))
    return out


def overlaps(corners: np.ndarray, cell: tuple[int, ...], margin: float) -> bool:  # type: ignore[type-arg]
    polygon = [tuple(Fraction(float(x)) for x in corner) for corner in corners]
    for axis, start in enumerate(cell):
        polygon = clipped(polygon, axis, start - Fraction(margin), -1)
        polygon = clipped(polygon, axis, start + 1 + Fraction(margin), 1)
    return bool(polygon)


@pytest.mark.parametrize("dimension", [2, 3])
@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), kind=st.sampled_from(["any", "on the lattice", "thin", "point"]))
def test_touched_cells_are_those_of_exact_arithmetic_up_to_the_margin(dimension: int, seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0, N, size=(2, dimension, dimension))
    if kind == "on the lattice":
        corners = np.round(corners)
    elif kind == "thin":
        corners[:, -1] = corners[:, 0] + 1e-7 * rng.normal(size=(2, dimension)) * (corners[:, 1] != 0)
        corners = np.clip(corners, 0, N)
    elif kind == "point":
        corners[:] = corners[:, :1]
    margin = 1e-6
    touched = cells_touched(corners, (N,) * dimension, np.full(dimension, margin))
    for cell in itertools.product(range(N), repeat=dimension):
        if any(overlaps(c, cell, 0) for c in corners):
            assert touched[cell]
        elif touched[cell]:
            assert any(overlaps(c, cell, 2 * margin) for c in corners)


@given(seed=st.integers(0, 2**32 - 1))
def test_points_of_triangles_lie_in_touched_cells_of_oblong_grids(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(int(n) for n in rng.integers(3, 70, size=3))
    corners = rng.uniform(0, 1, size=(30, 3, 3)) * shape
    corners[10:] = corners[10:, :1] + 0.02 * (corners[10:] - corners[10:, :1])
    touched = cells_touched(corners, shape, np.full(3, 1e-6))
    points = np.einsum("nk,mkd->nmd", rng.dirichlet((0.5, 0.5, 0.5), 200), corners).reshape(-1, 3)
    assert touched[tuple(np.minimum(points.astype(int), np.array(shape) - 1).T)].all()


def test_nothing_touches_nothing() -> None:
    assert not cells_touched(np.zeros((0, 3, 3)), (4, 4, 4), np.full(3, 1e-6)).any()
