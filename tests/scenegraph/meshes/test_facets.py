"""Flat parts of meshes, and polygons inside them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mesh_proofs import rotation
from scenegraph.meshes.facets import FLATNESS, SLOPE, Facet, facets, polygons
from scenegraph.meshes.frames import main_axes
from scenegraph.meshes.topology import weld

F64 = np.ndarray


def grid(mask: F64) -> tuple[F64, F64]:  # type: ignore[type-arg]
    """Unit squares where a mask (x, y) is True, as triangles in the plane z = 0, scaled to fit into a unit square."""
    cells = np.argwhere(mask)
    corner = cells[:, None] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    points = np.concatenate([corner, np.zeros((*corner.shape[:2], 1))], axis=2).reshape(-1, 3) / max(mask.shape)
    quads = np.arange(4 * len(cells)).reshape(-1, 4)
    return points, quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def facets_of(points: F64, faces: F64, **options: bool) -> list[Facet]:  # type: ignore[type-arg]
    welded, kept, _ = weld(points, faces)
    return facets(welded, kept, one_sided=options.get("one_sided", False), least_area=0.01)


def cross(a: F64, b: F64) -> F64:  # type: ignore[type-arg]
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def area(polygon: F64) -> float:  # type: ignore[type-arg]
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32 - 1), share=st.sampled_from([0.6, 0.8, 0.95]))
def test_polygons_lie_in_the_triangles(seed: int, share: float) -> None:
    """Windows at random in a wall of 7 x 5 squares, turned at random in space."""
    rng = np.random.default_rng(seed)
    mask = rng.random((7, 5)) < share
    mask[1:4, 1:3] = True
    points, faces = grid(mask)
    # some triangles face the other way, and some are there twice
    faces = np.where(rng.random(len(faces))[:, None] < 0.3, faces[:, ::-1], faces)
    faces = np.concatenate([faces, faces[:4]])
    turn = rotation(rng)
    (facet,) = facets_of(points @ turn.T, faces)
    assert facet.roughness < 1e-12
    for polygon in polygons(facet, clearance=1e-6, corners=16, limit=4):
        assert area(polygon) > 0
        edge = np.roll(polygon, -1, axis=0) - polygon
        assert (cross(edge, np.roll(edge, -1, axis=0)) > -1e-12).all()
        inside = np.concatenate([rng.dirichlet(np.full(len(polygon), 0.3), 200) @ polygon, polygon])
        flat = (facet.points(inside, 0.0) @ turn)[:, :2] * 7
        # all corners of the squares around each point are full
        for shift in np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]]) * 1e-7:
            cell = np.floor(flat + shift).astype(int)
            assert (cell >= 0).all()
            assert (cell < mask.shape).all()
            assert mask[tuple(cell.T)].all()


def test_a_rectangle_is_filled_up_to_the_inset() -> None:
    points, faces = grid(np.ones((4, 2), bool))
    (facet,) = facets_of(points, faces)
    best = max(area(p) for p in polygons(facet, clearance=1e-6, corners=16, limit=4))
    assert best == pytest.approx((1 - 2e-6 / SLOPE) * (0.5 - 2e-6 / SLOPE), rel=1e-4)


def test_a_triangle_gets_more_than_a_rectangle() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0.4, 0.9, 0]])
    (facet,) = facets_of(points, np.array([[0, 1, 2]]))
    rectangles = polygons(facet, clearance=1e-6, corners=4, limit=4)
    convex = polygons(facet, clearance=1e-6, corners=8, limit=4)
    assert max(map(area, rectangles)) <= 0.5 * 0.45 + 1e-9
    assert max(map(area, convex)) > 0.98 * 0.45


def test_a_rough_wall_keeps_farther_from_its_border() -> None:
    rng = np.random.default_rng(4)
    mask = np.ones((6, 6), bool)
    points, faces = grid(mask)
    welded, faces, _ = weld(points, faces)
    rough = welded + np.outer(rng.uniform(-0.7, 0.7, len(welded)) * FLATNESS, (0, 0, 1))
    (facet,) = facets(rough, faces, one_sided=False, least_area=0.01)
    assert 0.3 * FLATNESS < facet.roughness <= FLATNESS
    inset = (2 * facet.roughness + 1e-6) / SLOPE
    for polygon in polygons(facet, clearance=1e-6, corners=4, limit=4):
        flat = facet.points(polygon, 0.0)[:, :2]
        assert flat.min() >= inset * 0.999
        assert flat.max() <= 1 - inset * 0.999


def test_triangles_off_the_plane_are_another_facet() -> None:
    points, faces = grid(np.ones((2, 2), bool))
    both = np.concatenate([points, points + (0, 0, 10 * FLATNESS)])
    found = facets_of(both, np.concatenate([faces, faces + len(points)]))
    assert len(found) == 2
    assert all(f.roughness < 1e-12 for f in found)


def test_opposite_sides_are_told_apart_only_on_request() -> None:
    points, faces = grid(np.ones((2, 1), bool))
    faces = np.concatenate([faces[:2], faces[2:, ::-1]])
    assert len(facets_of(points, faces)) == 1
    assert len(facets_of(points, faces, one_sided=True)) == 2


def test_curved_surfaces_have_none() -> None:
    u = np.linspace(0, np.pi, 40)
    arc = np.stack([np.cos(u), np.sin(u)], axis=1)
    points = np.concatenate([np.column_stack([arc, np.zeros(40)]), np.column_stack([arc, np.ones(40)])]) / 2
    a = np.arange(39)
    faces = np.concatenate([np.stack([a, a + 1, a + 41], 1), np.stack([a, a + 41, a + 40], 1)])
    assert facets(points, faces, one_sided=False, least_area=0.05) == []


@given(seed=st.integers(0, 2**32 - 1))
def test_main_axes_are_those_of_a_turned_box(seed: int) -> None:
    from scenegraph import Mesh

    rng = np.random.default_rng(seed)
    box, turn = Mesh.box((0, 0, 0), (1.0, 0.6, 0.3)), rotation(rng)
    axes = main_axes((box.vertices @ turn.T)[box.faces])
    assert np.allclose(axes @ axes.T, np.eye(3))
    if not np.array_equal(axes, np.eye(3)):
        match = np.abs(axes @ turn)
        assert np.allclose(np.sort(match, axis=1)[:, :2], 0, atol=1e-9)
