"""How much of a silhouette occluders cover."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mesh_proofs import hull, torus
from scenegraph import Mesh
from scenegraph.meshes.silhouette import Silhouette, Tally, directions, shadows

CUBE = Mesh.box((0, 0, 0), (1, 1, 1))


def surface(mesh: Mesh) -> np.ndarray:  # type: ignore[type-arg]
    return np.asarray(mesh.vertices[mesh.faces])


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def tally(silhouette: Silhouette, shapes: list[np.ndarray], fronts: np.ndarray | None = None) -> Tally:  # type: ignore[type-arg]
    return Tally(silhouette, silhouette.covered(shapes), np.zeros((len(shapes), 3)) if fronts is None else fronts)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1))
def test_shadows_hold_the_pixels_whose_middle_lies_in_a_triangle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangles, groups, size = rng.uniform(-3, 13, size=(8, 3, 2)), rng.integers(0, 3, size=8), 10
    found = shadows(triangles, groups, 3, size)
    y, x = np.mgrid[:size, :size] + 0.5
    p = np.stack([x, y], axis=-1)
    for group in range(3):
        expected, doubt = np.zeros((size, size), bool), np.zeros((size, size), bool)
        for a, b, c in triangles[groups == group]:
            side = [cross(v - u, p - u) for u, v in ((a, b), (b, c), (c, a))]
            expected |= (np.array(side) > 1e-9).all(axis=0) | (np.array(side) < -1e-9).all(axis=0)
            doubt |= (np.abs(side) <= 1e-9).any(axis=0)
        assert (found[group] == expected)[~doubt].all()


def test_directions_are_unit_vectors_of_one_half_whose_opposites_fill_the_other() -> None:
    d = directions(200)
    assert np.allclose(np.linalg.norm(d, axis=1), 1)
    assert (d[:, 2] > 0).all()
    assert np.allclose(np.concatenate([d, -d]).T @ np.concatenate([d, -d]) / 400, np.eye(3) / 3, atol=0.01)


@pytest.mark.parametrize("mesh", [CUBE, torus(2, 0.5), hull(np.random.default_rng(3).normal(size=(50, 3)))])
def test_a_mesh_covers_itself(mesh: Mesh) -> None:
    silhouette = Silhouette.of(surface(mesh), views=16, size=64)
    assert tally(silhouette, [surface(mesh)]).gains(np.array([0]))[0] == pytest.approx(1)


def test_shares_are_those_of_areas() -> None:
    """A convex body's mean shadow is a quarter of its surface; here as a mean of ratios of similar bodies."""
    silhouette = Silhouette.of(surface(CUBE), views=32, size=128)
    half = surface(Mesh.box((0.25, 0.25, 0.25), (0.75, 0.75, 0.75)))
    assert tally(silhouette, [half]).gains(np.array([0]))[0] == pytest.approx(0.25, abs=0.003)


def test_a_plate_seen_from_its_edge_counts_like_any_other_view() -> None:
    plate = Mesh.box((0, 0, 0), (1, 1, 1e-5))
    silhouette = Silhouette.of(surface(plate), views=16, size=64)
    assert (silhouette.pixels > 0.2 * 64**2).all()
    part = surface(Mesh.box((0, 0, 0), (0.5, 1, 1e-5)))
    assert tally(silhouette, [part]).gains(np.array([0]))[0] == pytest.approx(0.5, abs=0.01)


def test_a_one_sided_face_covers_for_half_of_all_views() -> None:
    square = np.array([[[0, 0, 1], [1, 0, 1], [1, 1, 1]], [[0, 0, 1], [1, 1, 1], [0, 1, 1]]], float)
    silhouette = Silhouette.of(surface(CUBE), views=16, size=64)
    counted = tally(silhouette, [square, square, square], np.array([[0, 0, 0], [0, 0, 1], [0, 0, -1]], float))
    both, up, down = counted.gains(np.arange(3))
    assert up == pytest.approx(both / 2)
    assert down == pytest.approx(both / 2)


def test_choice_is_greedy_counts_nothing_twice_and_stops() -> None:
    silhouette = Silhouette.of(surface(CUBE), views=16, size=64)
    shapes = [
        surface(Mesh.box((0, 0, 0), (0.5, 1, 1))),
        surface(CUBE) * 0.999,
        surface(Mesh.box((0, 0, 0), (1, 1, 0.9))),
        surface(Mesh.box((0.8, 0, 0), (1, 1, 1))),
    ]
    taken = tally(silhouette, shapes).choose(9, 0.01, np.ones(4))
    assert [k for k, _ in taken] == [1]
    # without the one that covers all, the next ones add up to what they cover together
    taken = tally(silhouette, [shapes[0], shapes[3]]).choose(9, 0.001, np.ones(2))
    together = tally(silhouette, [np.concatenate([shapes[0], shapes[3]])]).gains(np.array([0]))[0]
    assert sum(gain for _, gain in taken) == pytest.approx(together)
    # worth decides between near equals
    assert tally(silhouette, shapes).choose(1, 0.01, np.array([1, 0.7, 1, 1]))[0][0] == 2


def test_no_candidates() -> None:
    silhouette = Silhouette.of(surface(CUBE), views=4, size=16)
    assert tally(silhouette, []).choose(4, 0.0, np.zeros(0)) == []
