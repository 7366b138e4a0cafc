"""Camera paths: smooth walks, orbits that fit, flights that arrive; and paths for scenes that came without any."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from scenegraph import Geode, Group, Mesh, Scene, Transform
from scenegraph.scenes import city, olympia, scatter
from scenegraph.scenes.anywhere import anywhere
from scenegraph.scenes.ground import find_ground
from scenegraph.scenes.paths import (
    Moment,
    closest,
    default_paths,
    distance_to_line,
    enter,
    orbit,
    upright_axes,
    walk,
)
from scenegraph.scenes.shapes import icosphere

CORNER = np.array([(0, 0, 0), (60, 0, 0), (60, 40, 0)], float)
UPS = [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, -2.0, 0.0), (0.3, -0.2, 0.9)]

directions = arrays(float, 3, elements=st.floats(-1, 1)).filter(lambda v: np.linalg.norm(v) > 0.1)


@given(up=directions)
def test_upright_axes_are_a_right_handed_frame(up: np.ndarray) -> None:
    axes = upright_axes(up)
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert np.linalg.det(axes) > 0
    assert np.allclose(axes[2], up / np.linalg.norm(up))


def test_upright_axes_of_z_are_the_identity() -> None:
    assert np.array_equal(upright_axes((0, 0, 3)), np.eye(3))


# -- walk ------------------------------------------------------------------------------------------------------------


def test_a_walk_keeps_to_its_line_and_cuts_corners_a_little() -> None:
    views = walk(CORNER, count=80)
    eyes = np.array([v.eye for v in views])
    assert len(views) == 80
    assert np.allclose(eyes[:, 2], 1.7)
    assert np.allclose(eyes[0], (0, 0, 1.7), atol=0.3)
    assert np.allclose(eyes[-1], (60, 40, 1.7), atol=0.3)
    off = distance_to_line(eyes - (0, 0, 1.7), CORNER)
    assert off.max() < 2.0
    assert (off[np.linalg.norm(eyes[:, :2] - CORNER[1, :2], axis=1) > 12] < 0.05).all()


@pytest.mark.parametrize("swing", [0.0, 25.0])
def test_a_walk_turns_smoothly_and_swings_its_head(swing: float) -> None:
    views = walk(CORNER, count=200, swing=swing)
    forward = np.array([v.forward for v in views])
    turn = np.degrees(np.arccos(np.clip((forward[1:] * forward[:-1]).sum(axis=1), -1, 1)))
    assert turn.max() < 8 + swing
    yaw = np.degrees(np.unwrap(np.arctan2(forward[:, 1], forward[:, 0])))
    eyes = np.array([v.eye for v in views])
    straight = (eyes[:, 0] < 45) & (eyes[:, 1] < 0.1)
    assert np.abs(yaw[straight]).max() == pytest.approx(swing, abs=1.0)


def test_a_walk_looks_at_its_moments_and_lingers() -> None:
    moment = Moment("A", (30.0, 0.0, 1.7), (30.0, 8.0, 3.0))
    views = walk(CORNER, count=100, moments=[moment])
    view = closest(views, moment.at)
    wanted = np.subtract(moment.target, view.eye)
    assert view.forward @ wanted / np.linalg.norm(wanted) > np.cos(np.radians(8))
    eyes = np.array([v.eye for v in views])
    step = np.linalg.norm(np.diff(eyes, axis=0), axis=1)
    at = int(np.argmin(np.abs(eyes[:, 0] - 30) + eyes[:, 1]))
    assert step[at] < 0.5 * step[5]


@pytest.mark.parametrize("up", UPS)
def test_a_walk_is_the_same_with_another_up(up: tuple[float, float, float]) -> None:
    axes = upright_axes(up)
    usual, other = walk(CORNER, count=20), walk(CORNER @ axes, count=20, up=up)
    for a, b in zip(usual, other, strict=True):
        assert np.allclose(np.array(a.eye) @ axes, b.eye)
        assert np.allclose(a.forward @ axes, b.forward)
        assert np.allclose(a.axes[1] @ axes, b.axes[1])


@given(
    points=arrays(float, (5, 2), elements=st.floats(-1e3, 1e3)).filter(
        lambda p: np.linalg.norm(np.diff(p, axis=0), axis=1).min() > 1
    ),
    count=st.integers(2, 40),
)
def test_any_walk_is_finite(points: np.ndarray, count: int) -> None:
    views = walk(np.insert(points, 2, 0.0, axis=1), count=count)
    assert len(views) == count
    assert np.isfinite([v.axes for v in views]).all()


# -- orbit and enter -------------------------------------------------------------------------------------------------


@given(
    low=arrays(float, 3, elements=st.floats(-1e4, 1e4)),
    size=arrays(float, 3, elements=st.floats(0.1, 1e3)),
    elevation=st.floats(-60, 80),
    fov=st.floats(5, 120),
    up=st.sampled_from(UPS),
)
def test_an_orbit_holds_the_bounds_in_every_view(
    low: np.ndarray, size: np.ndarray, elevation: float, fov: float, up: tuple[float, float, float]
) -> None:
    bounds = np.array([low, low + size])
    views = orbit(bounds, count=7, elevation=elevation, margin=1.001, fov=fov, up=up)
    corners = np.where((np.arange(8)[:, None] >> np.arange(3)) & 1, bounds[1], bounds[0])
    center = bounds.mean(axis=0)
    distance = [np.linalg.norm(np.subtract(v.eye, center)) for v in views]
    assert np.allclose(distance, distance[0])
    for view in views:
        planes = view.planes(center)
        assert ((corners - center) @ planes[:, :3].T + planes[:, 3] >= -1e-9 * np.linalg.norm(size)).all()
        rise = np.subtract(view.eye, center) @ upright_axes(up)[2] / distance[0]
        assert rise == pytest.approx(np.sin(np.radians(elevation)), abs=1e-6)


def test_a_tight_orbit_fits_exactly() -> None:
    bounds = np.array([[-5, -3, 0], [5, 3, 4.0]])
    corners = np.where((np.arange(8)[:, None] >> np.arange(3)) & 1, bounds[1], bounds[0])
    worst = min((corners @ v.planes()[:4, :3].T + v.planes()[:4, 3]).min() for v in orbit(bounds, count=24, margin=1.0))
    assert worst == pytest.approx(0.0, abs=1e-9)


def test_a_single_point_is_orbited_too() -> None:
    views = orbit([(1, 2, 3), (1, 2, 3)])
    assert all(np.linalg.norm(np.subtract(v.eye, (1, 2, 3))) > 0.5 for v in views)


@pytest.mark.parametrize("up", UPS)
def test_a_flight_enters_and_arrives(up: tuple[float, float, float]) -> None:
    bounds = np.array([[-5.0, -6.0, -7.0], [15.0, 14.0, 13.0]])
    views = enter(bounds, count=12, up=up)
    eyes = np.array([v.eye for v in views])
    assert np.allclose(eyes[-1], bounds.mean(axis=0))
    assert ((eyes[0] < bounds[0]) | (eyes[0] > bounds[1])).any()
    outside = np.array([((e < bounds[0]) | (e > bounds[1])).any() for e in eyes])
    assert (np.diff(outside.astype(int)) <= 0).all()


# -- scenes without cameras ------------------------------------------------------------------------------------------


def town(up: tuple[float, float, float] = (0.0, 0.0, 1.0), *, scale: float = 1.0, ground: bool = True) -> Scene:
    """Rows of boxes 8 m apart on a sheet of 100 by 80 m, standing along `up`."""
    rng = np.random.default_rng(5)
    matrix = np.eye(4)
    matrix[:3, :3] = scale * upright_axes(up).T
    nodes: list[Geode] = []
    if ground:
        sheet = [(-50, -40, 0), (50, -40, 0), (50, 40, 0), (-50, 40, 0)]
        nodes.append(Geode(Mesh(sheet, [[0, 1, 2], [0, 2, 3]], name="ground")))
    for x in range(-36, 40, 18):
        for y in range(-30, 34, 15):
            height = float(rng.integers(256, 768)) / 64
            if (x, y) in ((-36, 0), (18, 15), (0, -30)):
                continue
            nodes.append(Geode(Mesh.box((x, y, -0.25), (x + 10, y + 7, height), name="house")))
    return Scene(Group(Transform(*nodes, matrix=matrix)), up=up)


@pytest.mark.parametrize("up", UPS)
def test_a_town_gets_an_orbit_and_a_walk_between_its_houses(up: tuple[float, float, float]) -> None:
    scene = town(up)
    paths = default_paths(scene)
    assert list(paths) == ["orbit", "walk"]
    axes = upright_axes(up)
    eyes = np.array([v.eye for v in paths["walk"]]) @ axes.T
    assert np.allclose(eyes[:, 2], 1.7, atol=0.05)
    assert np.linalg.norm(np.diff(eyes, axis=0), axis=1).sum() > 40
    for node in scene.root.walk():
        if isinstance(node, Geode) and node.mesh.name == "house":
            low, high = node.mesh.bounds
            gap = np.maximum(low - eyes, eyes - high).max(axis=1)
            assert gap.min() > 0.5


def test_the_walk_does_not_depend_on_where_the_town_lies() -> None:
    usual = default_paths(town())["walk"]
    moved, shift = town(), np.array([4.4e5, 5.4e6, 410.0])
    matrix = np.eye(4)
    matrix[:3, 3] = shift
    moved.root.children[0].matrix = matrix  # type: ignore[attr-defined]
    far = default_paths(moved)["walk"]
    gap = np.array([np.subtract(a.eye, b.eye) - shift for a, b in zip(far, usual, strict=True)])
    # what lies on the border of two cells may fall into the other one
    assert np.abs(gap).max() < 1.0


def test_a_toy_town_is_walked_at_its_own_scale() -> None:
    scene = town(scale=1e-3)
    paths = default_paths(scene)
    assert list(paths) == ["orbit", "walk"]
    eyes = np.array([v.eye for v in paths["walk"]])
    assert 0 < eyes[:, 2].max() < 0.004


def test_without_a_ground_there_is_only_an_orbit() -> None:
    assert list(default_paths(town(ground=False))) == ["orbit"]
    points, faces = icosphere(3)
    assert list(default_paths(Scene(Group(Geode(Mesh(40 * points, faces)))))) == ["orbit"]
    assert list(default_paths(Scene(Group(Geode(Mesh.box((0, 0, 0), (30, 30, 5))))))) == ["orbit"]
    assert list(default_paths(scatter.build(count=200))) == ["orbit"]


def test_a_bare_sheet_is_no_place_to_walk() -> None:
    sheet = Mesh([(-50, -40, 0), (50, -40, 0), (50, 40, 0), (-50, 40, 0)], [[0, 1, 2], [0, 2, 3]])
    assert list(default_paths(Scene(Group(Geode(sheet))))) == ["orbit"]


def test_a_ground_that_is_full_has_no_walk() -> None:
    sheet = Mesh([(-50, -40, 0), (50, -40, 0), (50, 40, 0), (-50, 40, 0)], [[0, 1, 2], [0, 2, 3]])
    block = Mesh.box((-50, -40, 0), (50, 40, 10))
    assert list(default_paths(Scene(Group(Geode(sheet), Geode(block))))) == ["orbit"]


def test_nothing_and_nothing_finite_have_no_paths() -> None:
    assert default_paths(Scene()) == {}
    broken = Mesh([[np.nan, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    assert default_paths(Scene(Group(Geode(broken)))) == {}
    scene = town()
    scene.add(Geode(broken))
    assert list(default_paths(scene)) == ["orbit", "walk"]


@pytest.mark.parametrize("build", [lambda: city.build(buildings=60), lambda: olympia.build(trees=50)])
def test_built_in_scenes_have_a_ground_and_free_streets(build: object) -> None:
    scene = build()  # type: ignore[operator]
    snapshot = scene.snapshot()
    ground = find_ground(snapshot, scene.up)
    assert ground is not None
    eyes = np.array([v.eye for v in default_paths(scene, snapshot)["walk"]])
    land = olympia.LAND.height(*eyes[:, :2].T) if scene.name == "olympia" else 0.0
    assert np.allclose(eyes[:, 2] - land, 1.7, atol=0.5)
    solid = {"body", "room", "column", "wall"}
    rows = [row for row, g in enumerate(snapshot.geodes) if g.name in solid]
    for eye in eyes:
        gap = np.abs(snapshot.boxes[:3, rows] - eye[:, None]) - snapshot.boxes[3:, rows]
        assert gap.max(axis=0).min() > 0


@pytest.mark.data
@pytest.mark.parametrize(
    ("file", "names"),
    [
        ("scenes/virtual_city.glb", ["orbit", "walk"]),
        ("city/delft_3dfier.obj", ["orbit", "walk"]),
        ("meshes/bunny_res2.ply", ["orbit"]),
        ("meshes/dragon_res4.ply", ["orbit"]),
    ],
)
def test_real_files_get_the_paths_that_suit_them(data_dir: Path, file: str, names: list[str]) -> None:
    scene = Scene.load(data_dir / file)
    snapshot = scene.snapshot()
    paths = default_paths(scene, snapshot)
    assert list(paths) == names
    low = (snapshot.boxes[:3] - snapshot.boxes[3:]).min(axis=1)
    high = (snapshot.boxes[:3] + snapshot.boxes[3:]).max(axis=1)
    for view in paths.get("walk", []):
        assert (np.array(view.eye) > low - 2).all()
        assert (np.array(view.eye) < high + 2).all()


def test_views_from_anywhere_are_free_and_repeat() -> None:
    snapshot = town().snapshot()
    views = anywhere(snapshot, 40)
    assert views == anywhere(snapshot, 40)
    assert views[:10] == anywhere(snapshot, 10)
    assert views != anywhere(snapshot, 40, seed=1)
    assert 0 < sum(v.is_parallel for v in views) < 20
    eyes = np.array([v.eye for v in views])
    assert len(np.unique(eyes, axis=0)) == 40
    houses = snapshot.boxes[:, snapshot.boxes[5] > 0.5]
    inside = (np.abs(eyes[:, :, None] - houses[:3]) < houses[3:]).all(axis=1)
    assert not inside.any()
    low = snapshot.boxes[2].min() - snapshot.boxes[5].max()
    assert (eyes[:, 2] > low).all()


def test_views_from_anywhere_without_a_ground_or_anything() -> None:
    assert len(anywhere(scatter.build(count=30).snapshot(), 5)) == 5
    assert anywhere(Scene().snapshot(), 5) == []
