"""The picture from above: what is in it, where the frustum lies, and lighter meshes for it."""

from __future__ import annotations

import re

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from scenegraph import Geode, Group, Mesh, Scene, Transform, View
from scenegraph.compare.lighter import COARSEST, lighter
from scenegraph.compare.overhead import frustum_overlay, overhead_view, project, telling_bounds

UNIT = np.array([[0.0, 0, 0], [100, 100, 20]])
places = st.tuples(*[st.floats(-500, 500)] * 3)


def boxes_of(*bounds: tuple[tuple[float, ...], tuple[float, ...]]) -> np.ndarray:
    low, high = np.array(bounds, float).transpose(1, 2, 0)
    return np.concatenate([(low + high) / 2, (high - low) / 2])


@given(places, places, st.sampled_from([(0, 0, 1), (0, 1, 0), (1, 2, 3)]))
def test_scene_and_eye_are_in_the_picture(eye, target, up) -> None:
    if np.linalg.norm(np.subtract(eye, target)) < 1e-3:
        return
    above = overhead_view(View(eye, target, up=up), UNIT, up, width=300, height=200)
    corners = UNIT[np.indices((2, 2, 2)).reshape(3, 8), np.arange(3)[:, None]].T
    pixels = project(above, np.vstack([corners, [eye]]))
    assert (pixels >= 0).all()
    assert (pixels <= (300, 200)).all()
    # and the picture is not mostly empty: one direction is filled to nine tenths
    assert (np.ptp(pixels, axis=0) / (300, 200)).max() > 0.9


def test_the_camera_looks_up_in_the_picture() -> None:
    view = View((50, -20, 2), (50, 80, 2))
    above = overhead_view(view, UNIT, (0, 0, 1), width=300, height=200)
    eye, target = project(above, np.array([view.eye, view.target]))
    assert target[1] < eye[1] - 20
    assert target[0] == pytest.approx(eye[0])
    # what stands upright stands upright
    foot, top = project(above, np.array([[50, 50, 0], [50, 50, 20.0]]))
    assert top[1] < foot[1]


def test_a_view_straight_down_has_a_picture() -> None:
    above = overhead_view(View((50, 50, 300), (50, 50, 0)), UNIT, (0, 0, 1), width=30, height=20)
    assert np.isfinite(above.view_matrix()).all()


def test_a_ground_that_reaches_far_is_left_out() -> None:
    houses = [((x, y, 0), (x + 5, y + 5, 10)) for x in range(0, 100, 10) for y in range(0, 100, 10)]
    tiles = [((x, 0, -1), (x + 2000, 2000, 0)) for x in (-4000, -2000, 0, 2000)]
    low, high = telling_bounds(boxes_of(*houses, *tiles))
    assert (low[:2] <= 0).all()
    assert (high[:2] >= 95).all()
    assert np.linalg.norm(high - low) < 250


def test_a_lawn_stays_in_the_picture() -> None:
    houses = [((x, 0, 0), (x + 5, 5, 10)) for x in range(0, 100, 10)]
    lawn = ((-10, -10, -1), (110, 20, 0))
    assert telling_bounds(boxes_of(*houses, lawn)).tolist() == [[-10, -10, -1], [110, 20, 10]]
    assert telling_bounds(boxes_of(lawn)).tolist() == [list(lawn[0]), list(lawn[1])]
    assert telling_bounds(np.zeros((6, 0))).shape == (2, 3)


def test_the_frustum_is_drawn_where_it_is() -> None:
    view = View((50, 0, 2), (50, 1, 2), fov=60, width=100, height=100, near=0.1, far=1e4)
    above = overhead_view(view, UNIT, (0, 0, 1), width=300, height=200)
    overlay = frustum_overlay(view, above, reach=40)
    numbers = re.findall(r"[ML](-?[\d.]+),(-?[\d.]+)", overlay)
    points = {(float(x), float(y)) for x, y in numbers}
    far = project(above, view.corners(far=40)[4:])
    assert {tuple(p) for p in far.round(1).tolist()} <= points
    eye = project(above, np.array([view.eye]))[0].round(1)
    assert tuple(eye) in points
    assert f'cx="{eye[0]:.1f}" cy="{eye[1]:.1f}"' in overlay


def test_a_parallel_view_has_a_box() -> None:
    view = View((50, 0, 2), (50, 1, 2), parallel_scale=10, near=0, far=80)
    overlay = frustum_overlay(view, overhead_view(view, UNIT, (0, 0, 1), width=300, height=200), reach=60)
    assert "nan" not in overlay
    assert overlay.count("<svg") == 2


def heavy_scene() -> Scene:
    ball = trimesh.creation.icosphere(4)  # 5120 triangles
    mesh = Mesh(ball.vertices, ball.faces, color=(1, 0, 0, 1))
    box = Mesh.box((0, 0, 0), (1, 1, 1))
    balls = [Transform(Geode(mesh, name=f"ball {i}"), translation=(0, 5.0 * i, 0)) for i in range(20)]
    return Scene(Group(Transform(Geode(box, name="box"), translation=(9, 9, 9)), *balls))


def test_lighter_keeps_what_is_light() -> None:
    snapshot = heavy_scene().snapshot()
    light, rows = lighter(snapshot, enough=200_000)
    assert light is snapshot
    assert rows.tolist() == list(range(21))


def test_lighter_has_the_same_drawables_with_fewer_triangles() -> None:
    snapshot = heavy_scene().snapshot()
    light, rows = lighter(snapshot, enough=10_000)
    assert sorted(rows) == list(range(21))
    counts = light.triangles[0]
    assert 5_000 < counts.sum() <= 10_000
    boxes = snapshot.mesh_index[rows] == snapshot.mesh_index[[snapshot.geodes[r].name for r in range(21)].index("box")]
    assert counts[boxes].tolist() == [12]
    assert np.abs(light.boxes - snapshot.boxes[:, rows]).max() < 0.15
    assert np.array_equal(light.colors, snapshot.colors[rows])


def test_lighter_stops_before_nothing_is_left() -> None:
    light, _ = lighter(heavy_scene().snapshot(), enough=1)
    assert light.triangles[0].min() == 12
    assert light.triangles[0].max() <= COARSEST
