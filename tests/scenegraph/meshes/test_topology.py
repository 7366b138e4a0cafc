"""Welding, shells, and which of them are closed."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mesh_proofs import hull, torus, without
from scenegraph import Mesh
from scenegraph.meshes.topology import Shell, shells, weld

CUBE = Mesh.box((0, 0, 0), (1, 1, 1))


def taken_apart(vertices: np.ndarray, faces: np.ndarray) -> list[Shell]:  # type: ignore[type-arg]
    points, welded, times = weld(vertices, faces)
    return shells(points, np.repeat(welded, times, axis=0))[0]


def soup(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[type-arg]
    """Each triangle with corners of its own."""
    return mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(3 * mesh.triangles).reshape(-1, 3)


def test_weld_joins_equal_places_and_no_others() -> None:
    vertices, faces = soup(CUBE)
    vertices = np.where(vertices == 0, -0.0, vertices)
    points, welded, times = weld(np.concatenate([CUBE.vertices, vertices]), faces + 8)
    assert len(points) == 8
    assert len(welded) == 12
    assert (times == 1).all()
    vertices[0] = np.nextafter(0.0, 1.0)
    assert len(weld(vertices, faces)[0]) == 9
    (shell,) = taken_apart(vertices, faces)
    assert not shell.is_closed


def test_weld_drops_what_has_become_an_edge() -> None:
    faces = np.concatenate([CUBE.faces, [[0, 0, 1], [2, 3, 2]]])
    assert len(weld(CUBE.vertices, faces)[1]) == 12


def test_a_pair_of_opposite_faces_counts_for_nothing_but_a_mesh_made_of_such_pairs_does() -> None:
    sheet = np.array([[0, 1, 2], [2, 1, 0]])
    _, faces, times = weld(CUBE.vertices, np.concatenate([CUBE.faces, sheet]))
    assert len(faces) == 13
    assert sorted(times)[:2] == [0, 1]
    both = np.concatenate([CUBE.faces, CUBE.faces[:, ::-1]])
    (shell,) = taken_apart(CUBE.vertices, both)
    assert shell.is_closed
    assert abs(shell.volume) == pytest.approx(1)


def test_repeated_faces_count_once() -> None:
    (shell,) = taken_apart(CUBE.vertices, np.concatenate([CUBE.faces, CUBE.faces[3:5]]))
    assert shell.is_closed
    assert shell.volume == pytest.approx(1)


@pytest.mark.parametrize("mesh", [CUBE, torus(2, 0.5), hull(np.random.default_rng(1).normal(size=(40, 3)))])
def test_closed_shells(mesh: Mesh) -> None:
    (shell,) = taken_apart(*soup(mesh))
    assert shell.is_closed
    assert shell.volume > 0
    assert len(shell.triangles) == mesh.triangles


def test_an_open_cube_has_one_opening_whose_cover_closes_it() -> None:
    (shell,) = taken_apart(CUBE.vertices, without(CUBE, (0, 0, 1)).faces)
    assert [len(o) for o in shell.openings] == [4]
    closed = Shell(np.concatenate([shell.triangles, shell.covers]), (), np.zeros(0, np.int64))
    assert shell.volume == closed.volume == pytest.approx(1)


@given(seed=st.integers(0, 2**32 - 1))
def test_faces_turned_at_random_are_turned_back(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = torus(2, 0.5)
    faces = np.where(rng.random(mesh.triangles)[:, None] < 0.4, mesh.faces[:, ::-1], mesh.faces)
    (shell,) = taken_apart(mesh.vertices, rng.permutation(faces))
    assert shell.is_closed
    assert shell.volume == pytest.approx(taken_apart(mesh.vertices, mesh.faces)[0].volume)


def test_cubes_that_share_an_edge_are_closed_without_being_manifold() -> None:
    other = Mesh.box((1, 1, 0), (2, 2, 1))
    (shell,) = taken_apart(*soup(Mesh.merge([CUBE, other])))
    assert shell.is_closed
    assert shell.volume == pytest.approx(2)


def test_a_sail_on_a_hull_is_taken_off() -> None:
    vertices = np.concatenate([CUBE.vertices, [[0, -1, 0], [1, -1, 0], [0, -2, 0]]])
    sail = [[0, 1, 8], [1, 9, 8], [8, 9, 10]]
    (shell,) = taken_apart(vertices, np.concatenate([CUBE.faces, sail]))
    assert shell.is_closed
    assert len(shell.triangles) == 12


def test_a_wall_within_makes_the_mesh_open() -> None:
    wall = Mesh([[0, 0, 0], [1, 1, 0], [1, 1, 1], [0, 0, 1]], [[0, 1, 2], [0, 2, 3]])
    found = taken_apart(*soup(Mesh.merge([Mesh.box((0, 0, 0), (1, 1, 1)), wall])))
    # its upper and lower edge are diagonals of the cube: three faces meet there, or it is a sail
    assert all(s.is_closed == (len(s.triangles) == 12) for s in found)


def test_a_moebius_strip_is_open() -> None:
    k = 12
    turn = np.pi * np.arange(k) / k
    middle = np.stack([np.cos(2 * turn), np.sin(2 * turn), np.zeros(k)], axis=1)
    arm = 0.3 * np.stack([np.cos(turn) * np.cos(2 * turn), np.cos(turn) * np.sin(2 * turn), np.sin(turn)], axis=1)
    a, b = np.arange(k), np.arange(k) + k
    a_next, b_next = np.append(a[1:], b[0]), np.append(b[1:], a[0])
    faces = np.concatenate([np.stack([a, b, b_next], axis=1), np.stack([a, b_next, a_next], axis=1)])
    (shell,) = taken_apart(np.concatenate([middle - arm, middle + arm]), faces)
    assert not shell.is_closed


@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 60))
def test_openings_of_any_soup_are_loops(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.integers(0, 3, size=(12, 3)).astype(float)
    for shell in taken_apart(vertices, rng.integers(0, 12, size=(count, 3))):
        for opening in shell.openings:
            starts, ends = (opening[:, side].tolist() for side in (0, 1))
            assert sorted(starts) == sorted(ends)
