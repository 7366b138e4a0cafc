"""View: matrices, planes, rectangles and sizes, against independent computations."""

from __future__ import annotations

import json
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import scenegraph as sg
from scenegraph.kernels.projection import REDONE_PIXELS
from scenegraph.testing import random_views

seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds)
def test_points_inside_the_planes_are_the_points_inside_clip_space(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for view in random_views(rng, 4, 10.0):
        points = rng.uniform(-30, 30, (500, 3))
        clip = np.column_stack([points, np.ones(500)]) @ (view.projection() @ view.view_matrix()).T
        inside_clip = (np.abs(clip[:, :3]) <= clip[:, 3:]).all(axis=1)
        distance = points @ view.planes()[:, :3].T + view.planes()[:, 3]
        clear = np.abs(distance).min(axis=1) > 1e-9
        assert np.array_equal(inside_clip[clear], (distance >= 0).all(axis=1)[clear])
        assert np.allclose(np.linalg.norm(view.planes()[:, :3], axis=1), 1)


@given(seed=seeds)
def test_corners_lie_on_the_planes(seed: int) -> None:
    for view in random_views(np.random.default_rng(seed), 4, 10.0):
        distance = view.corners() @ view.planes()[:, :3].T + view.planes()[:, 3]
        assert (distance > -1e-9 * view.far).all()
        assert ((np.abs(distance) < 1e-9 * view.far).sum(axis=0) == 4).all()


@given(seed=seeds)
def test_bounds_hold_the_corners_and_no_more(seed: int) -> None:
    for view in random_views(np.random.default_rng(seed), 4, 10.0):
        origin = np.array([3.0, -2.0, 0.5])
        corners = view.corners() - origin
        low, high = view.bounds(origin)
        close = 1e-12 * np.abs(corners).max()
        assert np.abs(low - corners.min(axis=0)).max() <= close
        assert np.abs(high - corners.max(axis=0)).max() <= close


def test_side_planes_pass_through_the_eye_exactly() -> None:
    view = sg.View((1e7, 2e7, 3e7), (1e7 + 1, 2e7, 3e7), fov=0.01)
    assert (view.eye_planes[:4, 3] == 0).all()


def test_matrices_do_not_cancel_far_from_the_origin() -> None:
    origin = np.array((4.5e6, 1.2e6, 3.1e11))
    near = sg.View((1.0, 2.0, 3.0), (2.0, 5.0, 3.5))
    far = sg.View(origin + near.eye, origin + near.target)
    moved = np.array(far.eye) - origin
    expected = near.moved(eye=moved, target=np.array(far.target) - origin)
    assert np.allclose(far.view_matrix(origin), expected.view_matrix(), rtol=0, atol=1e-12)


@given(seed=seeds)
def test_rectangles_hold_all_corners_and_flag_crossings(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes = np.concatenate([rng.uniform(-12, 12, (3, 200)), rng.uniform(0, 2, (3, 200))])
    for view in random_views(rng, 4, 10.0):
        rects, depth, crossing = view.box_rects(boxes)
        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(8, 3, 1)
        corners = boxes[:3] + signs * boxes[3:]
        eye_z = np.einsum("i,cin->cn", view.forward, corners - np.reshape(view.eye, (1, 3, 1)))
        if not view.is_parallel:
            assert np.array_equal(crossing, eye_z.min(axis=0) <= view.near)
        assert (depth <= eye_z.min(axis=0) + 1e-9).all()
        homogeneous = np.concatenate([corners, np.ones((8, 1, 200))], axis=1)
        clip = np.einsum("ij,cjn->cin", view.projection() @ view.view_matrix(), homogeneous)
        size = np.array([view.width, view.height])[None, :, None]
        pixel = (clip[:, :2] / clip[:, 3:] + 1) / 2 * size
        pixel = np.clip(pixel, 0, size)[..., ~crossing]
        assert (rects[:2, ~crossing] <= pixel.min(axis=0) + 1e-9).all()
        assert (rects[2:, ~crossing] >= pixel.max(axis=0) - 1e-9).all()
        # and not much larger than needed: rounding costs a small part of a pixel
        assert (rects[:2, ~crossing] >= pixel.min(axis=0) - 3 * REDONE_PIXELS).all()


def test_rectangle_of_a_box_holds_its_image_in_rational_arithmetic() -> None:
    view = sg.View((0, 0, 0), (0, 1, 0), fov=90, width=1000, height=1000, near=0.5, far=100)
    boxes = np.array([[0.125, 7.0, -0.25, 0.5, 0.75, 0.25]]).T
    rects, _, _ = view.box_rects(boxes)
    x1 = (Fraction(5, 8) / Fraction(25, 4) + 1) * 500
    y0 = (Fraction(-1, 2) / Fraction(25, 4) + 1) * 500
    assert rects[2, 0] >= x1
    assert rects[1, 0] <= y0
    assert abs(Fraction(rects[2, 0]) - x1) < Fraction(1, 100)


def test_nan_boxes_cross() -> None:
    view = sg.View((0, -5, 0), (0, 0, 0))
    boxes = np.array([[0, 0, 0, 1, 1, np.nan], [np.nan, 0, 0, 1, 1, 1]]).T
    rects, _, crossing = view.box_rects(boxes)
    assert crossing.all()
    assert np.array_equal(rects[:, 0], [0, 0, view.width, view.height])
    assert np.isinf(view.box_pixels(boxes)).all()


@given(seed=seeds, pixels=st.floats(1e-3, 1e3))
def test_error_in_pixels_and_back(seed: int, pixels: float) -> None:
    rng = np.random.default_rng(seed)
    boxes = np.concatenate([rng.uniform(-12, 12, (3, 50)), rng.uniform(0, 2, (3, 50))])
    for view in random_views(rng, 4, 10.0):
        assert np.allclose(view.error_pixels(view.pixels_error(pixels, boxes), boxes), pixels)


def test_error_in_pixels_follows_field_of_view_viewport_and_scene_scale() -> None:
    box = np.array([[0.0, 100, 0, 1, 1, 1]]).T
    view = sg.View((0, 0, 0), (0, 1, 0), fov=60, width=800, height=600)
    base = view.error_pixels(1.0, box)[0]
    assert np.isclose(view.resized(1600, 1200).error_pixels(1.0, box)[0], 2 * base)
    assert np.isclose(base, 600 / (2 * np.tan(np.radians(30))) / 99)
    assert np.isclose(view.error_pixels(10.0, box * 10)[0], base)
    assert np.isclose(sg.View((0, 0, 0), (0, 1, 0), parallel_scale=3, height=600).error_pixels(1.0, box)[0], 100)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"target": (0, 0, 0)}, "same point"),
        ({"up": (0, 0, 0)}, "zero vector"),
        ({"eye": (0, np.nan, 0)}, "three finite numbers"),
        ({"fov": 180}, "0 < fov < 180"),
        ({"fov": float("nan")}, "0 < fov < 180"),
        ({"near": 0}, "near > 0"),
        ({"near": 5, "far": 5}, "near < far"),
        ({"width": 0}, "at least 1"),
        ({"parallel_scale": -1}, "must be positive"),
    ],
)
def test_bad_values_get_one_sentence(options: dict[str, object], message: str) -> None:
    values: dict[str, object] = {"eye": (0, 0, 0), "target": (0, 1, 0)}
    with pytest.raises(sg.SceneError, match=message):
        sg.View(**(values | options))  # type: ignore[arg-type]


def test_looking_along_up_takes_another_axis() -> None:
    view = sg.View((0, 0, 10), (0, 0, 0))
    assert np.allclose(view.axes @ view.axes.T, np.eye(3))


def test_json_round_trip_and_unknown_keys() -> None:
    view = sg.View((1, 2, 3), (4, 5, 6), fov=33, shift=(0.25, 0), parallel_scale=2)
    assert sg.View.from_dict(json.loads(json.dumps(view.to_dict()))) == view
    with pytest.raises(sg.SceneError, match=r"unknown keys \['fovy'\], missing keys \['target'\]"):
        sg.View.from_dict({"eye": (0, 0, 0), "fovy": 3})


@pytest.mark.parametrize("parallel_scale", [None, 4.0])
def test_vtk_cameras_there_and_back_give_the_same_matrices(parallel_scale: float | None) -> None:
    pyvista = pytest.importorskip("pyvista")
    view = sg.View((1, 2, 3), (4, 4, 6), up=(0, 1, 1), fov=40, near=0.5, far=80, width=640, height=360,
                   parallel_scale=parallel_scale, shift=(0.1, -0.2))  # fmt: skip
    camera = view.to_pyvista()
    assert isinstance(camera, pyvista.Camera)
    back = sg.View.from_pyvista(camera, 640, 360)
    assert np.allclose(back.view_matrix(), view.view_matrix())
    assert np.allclose(back.projection(), view.projection())
    vtk = camera.GetCompositeProjectionTransformMatrix(640 / 360, -1, 1)
    expected = [[vtk.GetElement(i, j) for j in range(4)] for i in range(4)]
    assert np.allclose(view.projection() @ view.view_matrix(), expected)
