"""Boxes in shadow frusta: single precision agrees with float64 or leaves it undecided; rounding hides nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from convex_shapes import exact, half_spaces, shadow_rows, solid_hides, table_of
from scenegraph import Occluder
from scenegraph.kernels import shadow_frusta
from scenegraph.kernels.boxes import box_packed
from scenegraph.kernels.shadow_frusta import (
    UNUSED,
    box_depth_in_frusta,
    box_depth_in_frusta_exact,
    box_hidden_from_region,
    box_touches_frusta,
    cone_rows_packed,
)

PLACES = [(1.0, 0.0), (1e-6, 0.0), (1e6, 0.0), (1.0, 1e7), (1e-3, 1e3), (1e3, 1e11)]


def case(rng, scale=1.0, shift=0.0, count=400):
    """Three solids around a point, an eye, and boxes behind them."""
    solids = [Occluder.solid((rng.standard_normal((8, 3)) + (4 * i - 4, 0, 0)) * scale + shift) for i in range(3)]
    eye = np.array([rng.uniform(-4, 4), -9.0, rng.uniform(-2, 2)]) * scale + shift
    center = (rng.uniform(-8, 8, (3, count)) + np.array([[0], [6], [0]])) * scale + shift
    boxes = np.concatenate([center, rng.uniform(0, 0.4, (3, count)) * scale])
    rows, good = shadow_rows(table_of(*solids), eye)
    assert good.all()
    return rows, boxes, eye


def packed(rows, boxes, eye):
    origin = boxes[:3].mean(axis=1)
    radius = float(np.linalg.norm(boxes[:3] - origin[:, None], axis=0).max() + np.linalg.norm(boxes[3:], axis=0).max())
    single, margin = cone_rows_packed(rows, eye=eye, origin=origin, radius=radius)
    return box_packed(boxes, origin), single, margin


@pytest.mark.parametrize(("scale", "shift"), PLACES)
def test_single_precision_never_contradicts_double(rng, scale, shift):
    undecided = hidden = 0
    for _ in range(10):
        rows, boxes, eye = case(rng, scale, shift)
        small, single, margin = packed(rows, boxes, eye)
        depth = box_depth_in_frusta(small, single)
        truth = box_depth_in_frusta_exact(boxes, rows, eye=eye) > 0
        assert truth[depth > 0].all()
        assert not truth[depth < -2 * margin].any()
        undecided += int((np.abs(depth + margin) <= margin).sum())
        hidden += int(truth.sum())
    assert hidden > 200
    assert undecided < 0.01 * 10 * depth.size


@pytest.mark.parametrize(("scale", "shift"), PLACES[1:])
def test_scale_and_shift_change_nothing(scale, shift):
    """Boxes within rounding of a plane may change sides toward visible; there are none among these."""
    answers = []
    for s, t in ((1.0, 0.0), (scale, shift)):
        rows, boxes, eye = case(np.random.default_rng(5), s, t)
        answers.append(box_depth_in_frusta_exact(boxes, rows, eye=eye) > 0)
    assert np.array_equal(*answers)


def test_blocks_of_the_product_do_not_show(rng, monkeypatch):
    rows, boxes, eye = case(rng, count=1000)
    small, single, _ = packed(rows, boxes, eye)
    answers = []
    for size in (4096, 999, 1000, 7):
        monkeypatch.setattr(shadow_frusta, "BLOCK", size)
        answers.append([box_depth_in_frusta(small, single, any_plane=a) for a in (False, True)])
    for other in answers[1:]:
        assert np.allclose(other[0], answers[0][0], rtol=0, atol=1e-4)
        assert np.allclose(other[1], answers[0][1], rtol=0, atol=1e-4)


def test_not_a_number_is_visible_and_touches(rng):
    rows, boxes, eye = case(rng, count=3)
    small, single, margin = packed(rows, boxes, eye)
    boxes[1, 1] = boxes[4, 2] = np.nan
    small[1:] = box_packed(boxes[:, 1:], np.zeros(3))
    depth = box_depth_in_frusta(small, single)
    assert not (depth[:, 1:] > 0).any()
    assert not (depth[:, 1:] >= -2 * margin).any()
    assert not (box_depth_in_frusta_exact(boxes, rows, eye=eye)[:, 1:] > 0).any()
    assert box_touches_frusta(small, single)[:, 1:].all()


def test_an_endless_scene_decides_nothing_in_single_precision(rng):
    rows, boxes, eye = case(rng)
    single, margin = cone_rows_packed(rows, eye=eye, origin=np.zeros(3), radius=np.inf)
    depth = box_depth_in_frusta(box_packed(boxes, np.zeros(3)), single)
    assert not (depth > 0).any()
    assert margin == np.inf


@given(st.integers(0, 2**32 - 1))
def test_what_does_not_touch_holds_nothing_hidden(seed):
    """A box apart from a frustum has no part inside it: so for all small boxes in it."""
    rng = np.random.default_rng(seed)
    rows, boxes, eye = case(rng, count=50)
    parts = np.repeat(boxes, 20, axis=1)
    parts[3:] *= 0.1
    parts[:3] += rng.uniform(-0.9, 0.9, (3, 1000)) * parts[3:] * 10
    small, single, _ = packed(rows, boxes, eye)
    apart = ~box_touches_frusta(small, single)
    inside = box_depth_in_frusta_exact(parts, rows, eye=eye) > 0
    assert not (inside & np.repeat(apart, 20, axis=1)).any()


def test_unused_rows(rng):
    """Of a frustum without planes everything is inside; of a hole without planes nothing is beyond it."""
    rows = np.zeros((2, 3, 8))
    rows[0, :, 6], rows[1, :, 6] = UNUSED, -UNUSED
    boxes = np.concatenate([rng.uniform(-1e6, 1e6, (3, 50)), rng.uniform(0, 1e3, (3, 50))])
    small, single, margin = packed(rows, boxes, np.full(3, 1e5))
    assert 0 < margin < 10
    for any_plane in (False, True):
        for depth in (
            box_depth_in_frusta(small, single, any_plane=any_plane),
            box_depth_in_frusta_exact(boxes, rows, eye=np.full(3, 1e5), any_plane=any_plane),
        ):
            assert (depth[0] > 0).all()
            assert (depth[1] < -2 * margin).all()


# -- from a region -----------------------------------------------------------------------------------------------------


@given(st.integers(0, 2**32 - 1))
def test_hidden_from_all_corners_is_hidden_from_all_of_the_cell(seed):
    rng = np.random.default_rng(seed)
    occluder = Occluder.solid(rng.standard_normal((10, 3)) * (3, 0.6, 2))
    table = table_of(occluder)
    corners = rng.uniform(-2, 2, (6, 3)) + (0, -6, 0)
    each = [shadow_rows(table, corner) for corner in corners]
    most = max(r.shape[1] for r, _ in each)
    rows = np.zeros((len(corners), 1, most, 8))
    rows[..., 6] = UNUSED
    for target, (given_rows, good) in zip(rows, each, strict=True):
        assert good[0]
        target[:, : given_rows.shape[1]] = given_rows
    boxes = np.concatenate([rng.uniform(-2, 2, (3, 60)) + np.array([[0], [5], [0]]), rng.uniform(0, 0.5, (3, 60))])
    hidden = box_hidden_from_region(boxes, rows, corners)[0]
    planes = half_spaces(occluder.vertices, occluder.faces)
    weights = rng.dirichlet(np.ones(len(corners)), 5)
    signs = rng.uniform(-1, 1, (5, 3))
    for eye in weights @ corners:
        for box in boxes.T[hidden][:5]:
            for sign in signs:
                assert solid_hides(planes, exact(eye), exact(box[:3] + sign * box[3:]))


def test_region_hides_what_a_wall_hides_and_no_more():
    """From a cell three wide before a wall ten wide: the shadows of its corners meet behind the wall."""
    table = table_of(Occluder.box((-5, -0.5, -5), (5, 0.5, 5)))
    eyes = np.array([(x, -6.0, z) for x in (-1.5, 1.5) for z in (-1.5, 1.5)])
    rows = [shadow_rows(table, eye)[0] for eye in eyes]
    most = max(r.shape[1] for r in rows)
    rows = np.stack(
        [np.concatenate([r, np.tile([0, 0, 0, 0, 0, 0, UNUSED, 0], (1, most - r.shape[1], 1))], axis=1) for r in rows]
    )
    x = np.array([0, 4.0, 8.0, 8.9, 9.2, 0, 0])
    y = np.array([2.0, 2.0, 6.0, 6.0, 6.0, -2.0, 0.0])
    boxes = np.stack([x, y, 0 * x, *np.full((3, 7), 0.1)])
    assert box_hidden_from_region(boxes, rows, eyes)[0].tolist() == [True, True, True, True, False, False, True]
