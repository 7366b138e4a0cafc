"""Occluders fitted into meshes: always inside, and the reason where there are none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import scenegraph as sg
from mesh_proofs import assert_hidden, assert_within_convex, hull, prism, rotation, torus, turned, without
from scenegraph import Mesh, SceneError
from scenegraph.meshes import FittedOccluders, fit_occluders
from scenegraph.meshes.winding import winding_numbers

CUBE = Mesh.box((0, 0, 0), (1, 1, 1))
FAST = {"cells": 16, "cache": None, "max_occluders": 4}


def star(rng: np.random.Generator, count: int) -> np.ndarray:  # type: ignore[type-arg]
    """Outline of a star-shaped polygon about the origin, counterclockwise."""
    angle = 2 * np.pi * (np.arange(count) + rng.uniform(0, 0.8, count)) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1) * rng.uniform(0.4, 1, size=(count, 1))


def floor_less(height: float = 1.0) -> Mesh:
    """A block without a floor."""
    return without(Mesh.box((0, 0, 0), (1, 2, height)), (0, 0, -1))


def assert_same(a: FittedOccluders, b: FittedOccluders, scale: float = 1.0, shift: float = 0.0) -> None:
    assert [o.kind for o in a.occluders] == [o.kind for o in b.occluders]
    assert a.coverage == b.coverage
    for first, second in zip(a.occluders, b.occluders, strict=True):
        size = np.abs(first.points * scale).max() + np.abs(shift)
        assert np.allclose(first.points * scale + shift, second.points, rtol=0, atol=1e-14 * size)


# What is found lies inside


@pytest.mark.parametrize("shape", ["box", "polytope"])
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(4, 60))
def test_occluders_of_convex_hulls_lie_inside(shape: str, seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = hull(rng.normal(size=(count, 3)) * rng.uniform(0.1, 1, 3))
    fitted = fit_occluders(mesh, shape=shape, **FAST)
    assert_within_convex(mesh, fitted)
    assert_hidden(mesh, fitted, rng)


@pytest.mark.parametrize("shape", ["box", "polytope"])
@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(3, 12), height=st.sampled_from([0.01, 0.5, 5.0]))
def test_occluders_of_extruded_outlines_lie_inside(shape: str, seed: int, count: int, height: float) -> None:
    rng = np.random.default_rng(seed)
    mesh = turned(prism(star(rng, max(count, 4)), height), rotation(rng), rng.normal(size=3))
    fitted = fit_occluders(mesh, shape=shape, **FAST)
    assert fitted.closed_shells == 1
    assert_hidden(mesh, fitted, rng)


@pytest.mark.parametrize("shape", ["box", "polytope"])
@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1), tube=st.floats(0.3, 0.9))
def test_occluders_of_rings_leave_the_hole_free(shape: str, seed: int, tube: float) -> None:
    rng = np.random.default_rng(seed)
    mesh = turned(torus(1, tube), rotation(rng))
    fitted = fit_occluders(mesh, shape=shape, **FAST)
    assert fitted.solids
    assert_hidden(mesh, fitted, rng)
    assert (winding_numbers(np.concatenate([o.points for o in fitted.solids]), mesh.vertices[mesh.faces]) == 1).all()


@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1))
def test_shells_that_overlap_each_other(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = [turned(hull(rng.normal(size=(12, 3))), np.eye(3), rng.uniform(-1, 1, 3)) for _ in range(3)]
    mesh = Mesh.merge(parts)
    fitted = fit_occluders(mesh, **FAST)
    assert fitted.closed_shells == 3
    assert fitted.solids
    assert_hidden(mesh, fitted, rng)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 40), openings=st.sampled_from(["none", "outward", "any"]))
def test_any_soup(seed: int, count: int, openings: str) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.uniform(0, 1, size=(3 * count, 3))
    if seed % 2:
        vertices = np.round(4 * vertices) / 4  # many equal vertices, flat triangles, shared edges
    mesh = Mesh(vertices, rng.integers(0, 3 * count, size=(count, 3)))
    assert_hidden(mesh, fit_occluders(mesh, openings=openings, **FAST), rng)


@settings(max_examples=6)
@given(seed=st.integers(0, 2**32 - 1))
def test_openings_at_any_place_are_kept_out_of_the_way(seed: int) -> None:
    """Holes torn into a ball at random: with covers, each line is blocked at one side at least."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3))
    ball = hull(points / np.linalg.norm(points, axis=1)[:, None])
    holes = rng.normal(size=(rng.integers(1, 5), 3))
    holes /= np.linalg.norm(holes, axis=1)[:, None]
    middle = ball.vertices[ball.faces].mean(axis=1)
    mesh = Mesh(ball.vertices, ball.faces[(middle @ holes.T < rng.uniform(0.8, 0.97)).all(axis=1)])
    fitted = fit_occluders(mesh, openings="outward", **FAST)
    assert not fitted.closed_shells
    assert_hidden(mesh, fitted, rng, 100)


# How much is found


def test_a_block_is_its_own_occluder() -> None:
    for mesh in (CUBE, turned(CUBE, rotation(np.random.default_rng(1)) * [3, 1, 0.1])):
        fitted = fit_occluders(mesh, cache=None)
        assert [o.kind for o in fitted.occluders] == ["box"]
        assert fitted.coverage == pytest.approx(1, abs=1e-3)
        assert fitted.volume_share == pytest.approx(1)


def test_a_turned_block_gets_a_turned_box() -> None:
    turn = rotation(np.random.default_rng(5))
    (box,) = fit_occluders(turned(CUBE, turn), cache=None).occluders
    assert np.abs(np.sort(np.abs(box.points @ turn - 0.5), axis=0) - 0.5).max() < 1e-3


def test_two_wings_get_two_boxes() -> None:
    outline = np.array([[-1, -1], [2, -1], [2, 0.2], [0.2, 0.2], [0.2, 2], [-1, 2]])
    fitted = fit_occluders(prism(outline, 1.0), shape="box", cache=None)
    assert len(fitted.solids) == 2
    assert fitted.coverage > 0.97


def test_polytopes_cover_more_of_a_ball_than_boxes() -> None:
    rng = np.random.default_rng(2)
    points = rng.normal(size=(400, 3))
    ball = hull(points / np.linalg.norm(points, axis=1)[:, None])
    box = fit_occluders(ball, shape="box", max_occluders=1, cache=None)
    # a cube in a ball covers 2/π of it
    assert 0.55 < box.coverage <= 0.65
    for planes, least in ((12, 0.7), (24, 0.85)):
        assert fit_occluders(ball, planes=planes, max_occluders=1, cache=None).coverage > least


@pytest.mark.parametrize("thickness", [1e-3, 1e-4])
def test_plates_have_boxes(thickness: float) -> None:
    plate = Mesh.box((0, 0, 0), (1, 1, thickness))
    fitted = fit_occluders(plate, cache=None)
    assert fitted.coverage > 0.95
    assert_within_convex(plate, fitted)


def test_what_is_thinner_than_the_clearance_has_no_solid_but_faces() -> None:
    fitted = fit_occluders(Mesh.box((0, 0, 0), (1, 1, 1e-6)), cache=None)
    assert not fitted.solids
    assert fitted.polygons
    assert fitted.notes == ("no solids: no room inside at this resolution",)


def test_a_wall_with_a_door_has_polygons_beside_it() -> None:
    wall = [[0, 0], [4, 0], [4, 3], [0, 3], [1, 0], [2, 0], [2, 2], [1, 2]]
    faces = [[0, 4, 7], [0, 7, 3], [3, 7, 6], [3, 6, 2], [2, 6, 5], [2, 5, 1]]
    mesh = Mesh(np.insert(np.array(wall, float), 1, 0.0, axis=1), faces)
    fitted = fit_occluders(mesh, cache=None)
    assert not fitted.solids
    assert all(o.two_sided for o in fitted.polygons)
    assert fitted.coverage > 0.95
    assert_hidden(mesh, fitted, np.random.default_rng(0), 200)


def test_polygons_of_a_closed_mesh_are_seen_from_outside_only() -> None:
    roof = prism(np.array([[-1, -1], [1, -1], [0, 1]]), 3.0)
    fitted = fit_occluders(roof, max_occluders=20, min_gain=0.0, shape="box", cache=None)
    assert fitted.polygons
    for polygon in fitted.polygons:
        assert not polygon.two_sided
        p = polygon.points
        normal = np.cross(p - p[0], np.roll(p - p[0], -1, axis=0)).sum(axis=0)
        assert normal @ (p[0] - roof.vertices.mean(axis=0)) > 0


# What must not be found


@pytest.mark.parametrize("openings", ["none", "outward", "any"])
def test_a_bottle_with_a_narrow_neck_is_not_filled(openings: str) -> None:
    """Closed, as glass is; the neck is far thinner than a cell, so that no flood through cells gets in."""
    radius = np.array([0, 1, 1, 1e-4, 1e-4, 0.9, 0.9, 0])
    height = np.array([0, 0, 2, 2.2, 2.3, 1.9, 0.1, 0.1])
    # the outer wall up to the lip, and the inner wall down again
    profile = np.stack([np.append(radius[:4] + 2e-4, radius[4:]), height], axis=1)
    profile[0, 0] = profile[-1, 0] = 0
    k = 24
    turn = 2 * np.pi * np.arange(k) / k
    rings = [np.stack([r * np.cos(turn), r * np.sin(turn), np.full(k, z)], axis=1) for r, z in profile]
    vertices = np.concatenate(rings)
    a = np.arange(k)
    faces = []
    for i in range(len(profile) - 1):
        here, there = i * k + a, (i + 1) * k + a
        after, beyond = i * k + (a + 1) % k, (i + 1) * k + (a + 1) % k
        faces += [np.stack([here, after, beyond], axis=1), np.stack([here, beyond, there], axis=1)]
    mesh = Mesh(vertices, np.concatenate(faces))
    fitted = fit_occluders(mesh, openings=openings, cells=40, cache=None)
    assert (fitted.closed_shells, fitted.open_shells) == (1, 0)
    assert fitted.solids
    rng = np.random.default_rng(0)
    assert_hidden(mesh, fitted, rng, 300)
    for solid in fitted.solids:
        inner = rng.dirichlet(np.full(len(solid.points), 0.3), 300) @ solid.points
        r = np.hypot(inner[:, 0], inner[:, 1])
        assert not ((r < 0.85) & (inner[:, 2] > 0.15) & (inner[:, 2] < 1.85)).any()


def slit_cube(width: float) -> Mesh:
    """A cube whose top is two plates with a slit between them."""
    left = Mesh([[0, 0, 1], [0.5 - width, 0, 1], [0.5 - width, 1, 1], [0, 1, 1]], [[0, 1, 2], [0, 2, 3]])
    right = Mesh([[0.5 + width, 0, 1], [1, 0, 1], [1, 1, 1], [0.5 + width, 1, 1]], [[0, 1, 2], [0, 2, 3]])
    return Mesh.merge([without(CUBE, (0, 0, 1)), left, right])


@pytest.mark.parametrize("width", [1e-3, 1e-6, 1e-12])
def test_a_slit_thinner_than_a_cell_opens_the_cube(width: float) -> None:
    fitted = fit_occluders(slit_cube(width), cache=None)
    assert not fitted.solids
    assert fitted.notes[0].startswith("no solids: open (")
    assert fitted.polygons


@pytest.mark.parametrize("width", [1e-3, 1e-6])
def test_covered_slits_block_every_line_at_one_side(width: float) -> None:
    mesh = slit_cube(width)
    fitted = fit_occluders(mesh, openings="outward", cache=None)
    assert fitted.is_covered
    assert_hidden(mesh, fitted, np.random.default_rng(0), 500)


def test_a_cavity_is_hidden_by_its_shell() -> None:
    inner = Mesh.box((0.3, 0.3, 0.3), (0.7, 0.7, 0.7))
    hollow = Mesh(
        np.concatenate([CUBE.vertices, inner.vertices]), np.concatenate([CUBE.faces, inner.faces[:, ::-1] + 8])
    )
    fitted = fit_occluders(hollow, cache=None)
    assert fitted.closed_shells == 2
    assert fitted.coverage == pytest.approx(1, abs=1e-3)
    assert_hidden(hollow, fitted, np.random.default_rng(0))


def test_a_tunnel_is_not_filled() -> None:
    """Two openings opposite each other: one can look through, and only the walls would hide something."""
    tunnel = without(without(Mesh.box((0, 0, 0), (1, 3, 1)), (0, 1, 0)), (0, -1, 0))
    fitted = fit_occluders(tunnel, openings="any", cache=None)
    assert not fitted.solids
    assert fitted.polygons


def test_a_building_without_a_floor_is_filled_on_request_and_a_room_without_a_wall_is_not() -> None:
    building = floor_less()
    assert not fit_occluders(building, cache=None).solids
    fitted = fit_occluders(building, openings="outward", cache=None)
    assert fitted.is_covered
    assert fitted.solid_coverage > 0.95
    room = Mesh(building.vertices, building.faces[:, ::-1])
    fitted = fit_occluders(room, openings="outward", cache=None)
    assert not fitted.solids
    assert "no solids: open, and faces inward like a room" in fitted.notes
    assert fit_occluders(room, openings="any", cache=None).solids


def test_a_flat_sheet_and_a_valley_are_not_filled() -> None:
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0), indexing="ij")
    z = np.where((x % 5 > 0) & (y % 5 > 0), -2.0, 0.0)  # a pit
    k = np.arange(36).reshape(6, 6)
    quads = np.stack([k[:-1, :-1], k[1:, :-1], k[1:, 1:], k[:-1, 1:]], axis=2).reshape(-1, 4)
    pit = Mesh(np.stack([x, y, z], axis=2).reshape(-1, 3), quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3))
    assert not fit_occluders(pit, openings="outward", cache=None).solids
    hill = Mesh(pit.vertices * (1, 1, -1), pit.faces[:, ::-1])
    hill = Mesh(hill.vertices, hill.faces[:, ::-1])
    assert fit_occluders(hill, openings="outward", cache=None).solids


@pytest.mark.parametrize(
    ("mesh", "reason"),
    [
        (Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), "it has no triangles"),
        (Mesh(CUBE.vertices * np.nan, CUBE.faces), "some of its vertices are not finite"),
        (Mesh(np.vstack([CUBE.vertices[:-1], [[np.inf, 0, 0]]]), CUBE.faces), "some of its vertices are not finite"),
        (Mesh(CUBE.vertices * 1e200, CUBE.faces), "its coordinates are too large to compute with"),
        (Mesh(CUBE.vertices * 1e308 - 1e308 / 2, CUBE.faces), "its coordinates are too large to compute with"),
        (Mesh(CUBE.vertices * 1e-200, CUBE.faces), "it has no extent"),
        (Mesh(np.ones((3, 3)), [[0, 1, 2]]), "it has no extent"),
        (Mesh(CUBE.vertices * 1e-9 + 1e4, CUBE.faces), "it lies so far from its origin"),
        (Mesh([[0, 0, 0], [1, 0, 0], [0, 0, 0]], [[0, 1, 2], [0, 1, 1]]), "none of its triangles has an area"),
        (Mesh([[0, 0, 0], [1, 0, 0], [3, 0, 0]], [[0, 1, 2]]), "no solids"),
        (Mesh(CUBE.vertices, CUBE.faces, color=(1, 1, 1, 0.5)), "it lets light through"),
        (Mesh(CUBE.vertices, CUBE.faces, vertex_colors=np.full((8, 4), 254)), "it lets light through"),
        (Mesh(CUBE.vertices, CUBE.faces, texture=np.zeros((2, 2, 4)), uv=np.zeros((8, 2))), "it lets light through"),
    ],
)
def test_hopeless_meshes_give_the_reason(mesh: Mesh, reason: str) -> None:
    fitted = fit_occluders(mesh, cache=None)
    assert fitted.occluders == ()
    assert fitted.coverage == 0
    assert fitted.reason.startswith(reason)


def test_vertices_that_no_face_uses_do_not_matter() -> None:
    stray = Mesh(np.vstack([CUBE.vertices, [[np.nan] * 3, [1e300] * 3]]), CUBE.faces)
    assert_same(fit_occluders(CUBE, cache=None), fit_occluders(stray, cache=None))


# The same at any place and size


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), power=st.integers(-60, 60))
def test_powers_of_two_change_nothing(seed: int, power: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = prism(np.round(star(rng, 7) * 64) / 64, 1.0)
    scale, shift = 2.0**power, np.round(rng.uniform(-1000, 1000)) * 2.0**power
    a = fit_occluders(mesh, **FAST)
    assert_same(a, fit_occluders(turned(mesh, scale * np.eye(3), (shift,) * 3), **FAST), scale, shift)


@pytest.mark.parametrize(
    ("scale", "shift"), [(1e-9, 0), (1e-6, 0), (1e6, 0), (1, 1e7), (1e7, 1e11), (1e-9, 1e-3), (1e12, 0)]
)
def test_extreme_sizes_and_places(scale: float, shift: float) -> None:
    rng = np.random.default_rng(7)
    mesh = prism(star(rng, 8), 1.0)
    moved = turned(mesh, scale * rotation(rng), (shift,) * 3)
    a, b = fit_occluders(mesh, cells=32, cache=None), fit_occluders(moved, cells=32, cache=None)
    assert b.coverage == pytest.approx(a.coverage, abs=0.05)
    assert_hidden(moved, b, rng)
    for occluder in b.occluders:
        assert isinstance(occluder.node(), sg.Occluder)


# Around it


def test_nodes_are_what_was_fitted_and_hold_for_eyes_outside() -> None:
    geode = sg.Geode(CUBE)
    fitted = fit_occluders(CUBE, cache=None)
    node = fitted.occluders[0].node(owner=geode, name="a")
    assert (node.kind, node.name, node.owner, node.outside_only) == ("solid", "a", geode, True)
    assert np.array_equal(np.unique(node.vertices, axis=0), np.unique(fitted.occluders[0].points, axis=0))
    wall = Mesh([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]], [[0, 1, 2], [0, 2, 3]])
    node = fit_occluders(wall, cache=None).occluders[0].node()
    assert (node.kind, node.two_sided, node.outside_only) == ("planar", True, False)


def test_settings_out_of_bounds_are_refused() -> None:
    for options in (
        {"cells": 4},
        {"max_occluders": 0},
        {"min_gain": 2.0},
        {"planes": 3},
        {"shape": "ball"},
        {"openings": "x"},
    ):
        with pytest.raises(SceneError, match=next(iter(options))):
            fit_occluders(CUBE, cache=None, **options)  # type: ignore[arg-type]


def test_fewer_are_wanted_and_small_ones_are_not() -> None:
    rng = np.random.default_rng(3)
    mesh = prism(star(rng, 11), 1.0)
    many = fit_occluders(mesh, cache=None, min_gain=0.0, max_occluders=12)
    assert len(fit_occluders(mesh, cache=None, max_occluders=2).occluders) == 2
    assert all(o.gain >= 0.05 for o in fit_occluders(mesh, cache=None, min_gain=0.05).occluders)
    assert many.coverage == pytest.approx(sum(o.gain for o in many.occluders))
    assert many.solid_coverage <= many.coverage + 1e-12 <= 1 + 1e-9
    assert not fit_occluders(mesh, cache=None, polygons=False).polygons


def test_time_and_memory_are_measured_and_progress_is_told() -> None:
    told: list[tuple[str, float]] = []
    fitted = fit_occluders(
        torus(1, 0.4), cache=None, trace_memory=True, progress=lambda what, share: told.append((what, share))
    )
    assert fitted.seconds > 0
    assert fitted.peak_bytes is not None
    assert 1e5 < fitted.peak_bytes < 5e8
    shares = [share for _, share in told]
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    assert fit_occluders(CUBE, cache=None).peak_bytes is None


def test_who_listens_can_cancel() -> None:
    class Enough(Exception):
        pass

    def stop(what: str, share: float) -> None:
        if share > 0.3:
            raise Enough

    with pytest.raises(Enough):
        fit_occluders(torus(1, 0.4), cache=None, progress=stop)
