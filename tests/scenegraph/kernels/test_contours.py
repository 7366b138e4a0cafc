"""Outlines of meshes: their winding number counts the faces that cover a point, whatever the mesh."""

from __future__ import annotations

import numpy as np
import pytest

from scenegraph import Mesh
from scenegraph.kernels.contours import face_turns, mesh_edges, mesh_outline

NEAR = 0.5


def random_soup(rng, vertices=9, faces=12):
    """Triangles between random points, many of them with a corner before the near plane."""
    points = rng.uniform(-1, 1, (3, vertices))
    points[2] = -rng.uniform(0.05, 2.0, vertices)
    corners = np.array([rng.permutation(vertices)[:3] for _ in range(faces)])
    return points, corners


def outline_of(points, faces, *, parallel=False, near=NEAR, turn=None):
    """Start and end points (2, k) on the screen, and weights."""
    edges, face_edges, signs = mesh_edges(faces)
    if turn is None:
        turn, _, _ = face_turns(points, faces, parallel=parallel)
    start, end, weight, cuts = mesh_outline(-points[2], edges, faces, face_edges, signs, turn, near=near)
    a, b = points[:, edges[cuts, 0]], points[:, edges[cuts, 1]]
    met = a + (b - a) * (-near - a[2]) / (b[2] - a[2])
    everything = np.concatenate([points, met], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        screen = everything[:2] if parallel else everything[:2] / -everything[2]
    return screen[:, start], screen[:, end], weight


def winding(start, end, weight, x, y):
    x0, y0, x1, y1 = *start, *end
    crosses = (y0 <= y) != (y1 <= y)
    with np.errstate(divide="ignore", invalid="ignore"):
        left = x0 + (x1 - x0) * (y - y0) / (y1 - y0) < x
    return int((weight * np.where(y1 < y0, 1, -1))[crosses & left].sum())


def layers(points, faces, x, y, *, parallel=False, near=NEAR):
    """How many faces a line of sight meets behind the near plane, one by one (Möller-Trumbore without the speed)."""
    count = 0
    for a, b, c in (points[:, f].T for f in faces):
        origin, ray = (
            (np.array([x, y, 0.0]), np.array([0, 0, -1.0])) if parallel else (np.zeros(3), np.array([x, y, -1.0]))
        )
        system = np.column_stack([b - a, c - a, -ray])
        if abs(np.linalg.det(system)) < 1e-12:
            continue
        u, v, t = np.linalg.solve(system, origin - a)
        count += u >= 0 and v >= 0 and u + v <= 1 and t >= near
    return count


@pytest.mark.parametrize("parallel", [False, True])
def test_winding_number_counts_the_layers_behind_the_near_plane(parallel, rng):
    seen = set()
    for _ in range(60):
        points, faces = random_soup(rng)
        outline = outline_of(points, faces, parallel=parallel)
        for x, y in rng.uniform(-1.5, 1.5, (25, 2)):
            expected = layers(points, faces, x, y, parallel=parallel)
            assert winding(*outline, x, y) == expected
            seen.add(expected)
    assert seen >= {0, 1, 2, 3}


def test_outlines_are_closed_at_the_near_plane(rng):
    """What goes into a point comes out of it, cut or not."""
    for _ in range(50):
        points, faces = random_soup(rng)
        edges, face_edges, signs = mesh_edges(faces)
        turn, _, _ = face_turns(points, faces, parallel=False)
        start, end, weight, cuts = mesh_outline(-points[2], edges, faces, face_edges, signs, turn, near=NEAR)
        count = points.shape[1] + len(cuts)
        assert np.array_equal(np.bincount(start, weight, count), np.bincount(end, weight, count))
        assert weight.all()
        assert (-points[2, np.concatenate([start, end])[np.concatenate([start, end]) < points.shape[1]]] >= NEAR).all()


def test_a_box_has_the_outline_of_its_visible_faces():
    """Diagonals and edges between two visible faces cancel: a hexagon, or a square seen face-on."""
    box = Mesh.box((-1, -1, -1), (1, 1, 1))
    faces = box.faces.astype(np.int64)
    corner = box.vertices.T + np.array([[0.3], [0.2], [-6.0]])
    turn, _, _ = face_turns(corner, faces, parallel=False)
    front = np.where(turn > 0, turn, np.int8(0))
    start, _, weight = outline_of(corner, faces, turn=front)
    assert (np.abs(weight) == 1).all()
    assert start.shape[1] == 4
    start, _, _ = outline_of(box.vertices.T + np.array([[3.0], [2.5], [-6.0]]), faces)
    assert start.shape[1] == 6


def test_inconsistent_orientation_does_not_matter(rng):
    """Turning single faces around changes nothing: each is turned the way that the eye sees it."""
    points, faces = random_soup(rng, faces=20)
    turned = faces.copy()
    turned[::3] = turned[::3, ::-1]
    a, b = outline_of(points, faces), outline_of(points, turned)
    for x, y in rng.uniform(-1.5, 1.5, (100, 2)):
        assert winding(*a, x, y) == winding(*b, x, y)


def test_faces_behind_or_edge_on_have_no_outline():
    points = np.array([[0, 1, 0.0], [0, 0, 1], [-0.1, -0.2, -0.3]])
    assert outline_of(points, np.array([[0, 1, 2]]))[2].size == 0
    edge_on = np.array([[0, 0, 0.0], [0, 1, 1], [-1, -1, -2]])
    turn, _, _ = face_turns(edge_on, np.array([[0, 1, 2]]), parallel=False)
    assert turn.tolist() == [0]
    turn, _, _ = face_turns(np.array([[0, 1, 0.5], [0, 0, 0], [-1, -1, -2.0]]), np.array([[0, 1, 2]]), parallel=True)
    assert turn.tolist() == [0]


def test_turns_follow_the_screen():
    points = np.array([[0, 1, 0.0], [0, 0, 1], [-2, -2, -2.0]])
    for parallel in (False, True):
        turn, normal, offset = face_turns(points, np.array([[0, 1, 2], [2, 1, 0]]), parallel=parallel)
        assert turn.tolist() == [1, -1]
        assert normal[:, 0].tolist() == [0, 0, 1]
        assert offset[0] == -2


def test_not_a_number_does_not_turn():
    points = np.array([[0, 1, np.nan], [0, 0, 1], [-2, -2, -2.0]])
    turn, _, _ = face_turns(points, np.array([[0, 1, 2]]), parallel=False)
    assert turn.tolist() == [0]


def test_mesh_edges_know_their_faces():
    edges, face_edges, signs = mesh_edges(np.array([[0, 1, 2], [2, 1, 3]]))
    assert edges.tolist() == [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]]
    assert face_edges.tolist() == [[0, 2, 1], [2, 3, 4]]
    assert signs.tolist() == [[1, 1, -1], [-1, 1, -1]]
    nothing = mesh_edges(np.zeros((0, 3), int))
    assert [a.shape for a in nothing] == [(0, 2), (0, 3), (0, 3)]
