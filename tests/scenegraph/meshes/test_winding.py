"""Winding numbers."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mesh_proofs import hull, torus
from scenegraph import Mesh
from scenegraph.meshes.winding import winding_numbers


def surface(*meshes: Mesh) -> np.ndarray:  # type: ignore[type-arg]
    return np.concatenate([m.vertices[m.faces] for m in meshes])


def test_ring() -> None:
    points = np.array([[2.0, 0, 0], [0, 0, 0], [0, 0, 5], [-1.7, 0.1, 0.1]])
    assert winding_numbers(points, surface(torus(2, 0.6))).tolist() == [1, 0, 0, 1]


def test_shells_add_up_and_turned_ones_subtract() -> None:
    box, other = Mesh.box((0, 0, 0), (2, 2, 2)), Mesh.box((1, 1, 1), (3, 3, 3))
    points = np.array([[0.5, 0.5, 0.5], [1.5, 1.5, 1.5], [2.5, 2.5, 2.5], [2.5, 0.5, 0.5]])
    assert winding_numbers(points, surface(box, other)).tolist() == [1, 2, 1, 0]
    assert winding_numbers(points, surface(box, other)[:, ::-1]).tolist() == [-1, -2, -1, 0]


def test_no_answer_for_what_is_not_closed() -> None:
    box = surface(Mesh.box((0, 0, 0), (1, 1, 1)))
    assert winding_numbers(np.array([[0.5, 0.5, 0.5]]), box[:-1]).tolist() == [0]


@given(seed=st.integers(0, 2**32 - 1))
def test_convex_hulls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(30, 3))
    mesh = hull(points[:20])
    tri = mesh.vertices[mesh.faces]
    normal = np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0])
    depth = (np.einsum("kij,ij->ki", points[20:, None] - tri[:, 0], normal) / np.linalg.norm(normal, axis=1)).max(1)
    clear = np.abs(depth) > 1e-6
    assert (winding_numbers(points[20:], tri) == (depth < 0))[clear].all()


@given(seed=st.integers(0, 2**32 - 1))
def test_loops_in_the_plane(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = np.sort(rng.uniform(0, 2 * np.pi, 9))
    turn[:3] = 0.1, 2.2, 4.3  # goes around for sure
    ring = np.stack([np.cos(np.sort(turn)), np.sin(np.sort(turn))], axis=1) * rng.uniform(0.5, 1, size=(9, 1))
    loop = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
    assert winding_numbers(np.array([[0.0, 0.0], [1.5, 0.2]]), loop).tolist() == [1, 0]
    assert winding_numbers(np.array([[0.0, 0.0]]), np.concatenate([loop, loop])).tolist() == [2]
