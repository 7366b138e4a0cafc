"""Pixels of boxes: against counting samples, against a closed form, and at the extremes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegraph import View
from scenegraph.kernels.areas import box_cube_area, box_pixel_area

SIZE = (64, 48)


def areas(view: View, boxes: np.ndarray) -> np.ndarray:
    return box_pixel_area(
        boxes,
        axes=view.axes,
        eye=np.asarray(view.eye),
        window=view.window,
        size=(view.width, view.height),
        near=view.near,
        parallel=view.is_parallel,
    )


def counted(view: View, box: np.ndarray, per_pixel: int = 6) -> float:
    """Pixels whose line of sight meets the box, by asking several in each."""
    left, right, bottom, top = view.window
    x = left + (np.arange(view.width * per_pixel) + 0.5) / (view.width * per_pixel) * (right - left)
    y = bottom + (np.arange(view.height * per_pixel) + 0.5) / (view.height * per_pixel) * (top - bottom)
    gx, gy = (g.ravel() for g in np.meshgrid(x, y))
    one = np.ones_like(gx)
    if view.is_parallel:
        start = np.stack([gx, gy, 0 * one], 1) @ view.axes + view.eye
        ray = np.broadcast_to(view.forward, start.shape)
    else:
        start = np.broadcast_to(np.asarray(view.eye), (len(gx), 3))
        ray = np.stack([gx, gy, -one], 1) @ view.axes
    with np.errstate(divide="ignore", invalid="ignore"):
        low, high = (box[:3] - box[3:] - start) / ray, (box[:3] + box[3:] - start) / ray
    enter, leave = np.fmin(low, high).max(1), np.fmax(low, high).min(1)
    return np.count_nonzero(leave >= enter) / per_pixel**2


coordinates = st.floats(-6, 6)
extents = st.floats(0.05, 2.0)


@given(
    st.tuples(coordinates, coordinates, coordinates),
    st.tuples(extents, extents, extents),
    st.sampled_from([None, 5.0]),
    st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5)),
)
def test_area_is_what_counting_samples_finds(center, half, scale, shift):
    view = View(
        (1, -14, 2), (0, 0, 0), fov=50, width=64, height=48, near=0.5, far=60, parallel_scale=scale, shift=shift
    )
    box = np.array([*center, *half])
    (area,) = areas(view, box[:, None])
    assert area == pytest.approx(counted(view, box), abs=3 + 0.03 * area)


def test_a_square_seen_from_the_front_is_exact():
    view = View((0, -10, 0), (0, 0, 0), fov=90, width=200, height=200, near=1, far=100)
    # the front face at distance 9 of a window of half width 9: 100 pixels for 9 units
    box = np.array([[0, 0, 0, 1, 1, 1]], float).T
    assert areas(view, box)[0] == pytest.approx((200 / 9) ** 2)
    # a flat box seen from the front counts, edge-on it does not
    assert areas(view, np.array([[0, 0, 0, 1, 0, 1]], float).T)[0] == pytest.approx(400)
    assert areas(view, np.array([[0, 0, 0, 0, 1, 1]], float).T)[0] == pytest.approx(0, abs=1e-9)


def test_only_what_is_on_the_screen_counts():
    view = View((0, -10, 0), (0, 0, 0), fov=90, width=200, height=100, near=1, far=1e4)
    for huge in (10.0, 1e4, 1e9):
        wall = np.array([[0, 5, 0, huge, 0.1, huge]]).T
        expected = min(huge / 14.9 * 50, 50) * 2 * min(huge / 14.9 * 50, 100) * 2
        assert areas(view, wall)[0] == pytest.approx(expected, rel=1e-6)
    assert areas(view, np.array([[500, 0, 0, 1, 1, 1]], float).T)[0] == pytest.approx(0, abs=1e-6)


def test_unknown_boxes_are_not_a_number():
    view = View((0, -10, 0), (0, 0, 0), near=1, far=100)
    boxes = np.array(
        [[0, -10, 0, 1, 1, 1], [0, -9, 0, 1, 1, 1], [0, np.nan, 0, 1, 1, 1], [0, -30, 0, 1, 1, 1]], float
    ).T
    assert np.isnan(areas(view, boxes)).all()
    assert areas(view, np.zeros((6, 0))).shape == (0,)
    assert np.isnan(box_cube_area(boxes[:, [2]], eye=np.zeros(3), pixels_at_one=1, parallel=False)).all()


@pytest.mark.parametrize(("scale", "offset"), [(1e-9, 0.0), (1e6, 0.0), (1.0, 1e7), (1e3, 1e11)])
def test_areas_do_not_depend_on_units_or_place(scale, offset):
    rng = np.random.default_rng(0)
    boxes = np.concatenate([rng.uniform(-4, 4, (3, 50)), rng.uniform(0.5, 2, (3, 50))])
    view = View((0, -20, 3), (0, 0, 0), near=0.1, far=100)
    place = boxes * scale + np.array([offset] * 3 + [0] * 3)[:, None]
    moved = View(np.asarray(view.eye) * scale + offset, np.full(3, offset), near=0.1 * scale, far=100 * scale)
    assert np.allclose(areas(view, boxes), areas(moved, place), rtol=1e-4 if offset > 1e9 else 1e-6)


def test_the_cube_of_the_paper_is_nothing_for_a_flat_box_and_less_than_the_truth_from_the_front():
    view = View((0, -10, 0), (0, 0, 0), fov=90, width=200, height=200, near=1, far=100)
    at_one = float(view.pixels_per_unit(1.0))
    boxes = np.array([[0, 0, 0, 1, 1, 1], [0, 0, 0, 1, 0, 1], [0, 0, 0, 2, 1, 2]], float).T
    cube = box_cube_area(boxes, eye=np.asarray(view.eye), pixels_at_one=at_one, parallel=False)
    assert cube[0] == pytest.approx(400)
    assert cube[1] == 0
    assert (cube < areas(view, boxes)).all()
