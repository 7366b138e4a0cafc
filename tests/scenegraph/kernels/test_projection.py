"""Screen rectangles enclose the images of boxes, held against exact rational arithmetic."""

from __future__ import annotations

import itertools
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegraph import View
from scenegraph.kernels import projection
from scenegraph.kernels.projection import CHUNK, box_screen_rectangles

SIGNS = list(itertools.product((-1, 1), repeat=3))


def project(view, boxes, size=None, **options):
    return box_screen_rectangles(
        np.asarray(boxes, float).reshape(6, -1),
        axes=view.axes,
        eye=np.asarray(view.eye),
        window=view.window,
        size=size or (view.width, view.height),
        near=view.near,
        parallel=view.is_parallel,
        **options,
    )


def exact_corners(view, box, size):
    """Pixel x, y and depth of the eight corners, for the numbers as given, without rounding."""
    axes = [[Fraction(float(a)) for a in row] for row in view.axes]
    left, right, bottom, top = (Fraction(float(w)) for w in view.window)
    center, half = [Fraction(float(b)) for b in box[:3]], [Fraction(float(b)) for b in box[3:]]
    eye = [Fraction(e) for e in view.eye]
    out = []
    for signs in SIGNS:
        relative = [c + s * h - e for c, s, h, e in zip(center, signs, half, eye, strict=True)]
        x, y, z = (sum(a * r for a, r in zip(axis, relative, strict=True)) for axis in axes)
        if not view.is_parallel:
            x, y = (x / -z, y / -z) if z else (None, None)
        if x is not None:
            x, y = (x - left) * size[0] / (right - left), (y - bottom) * size[1] / (top - bottom)
        out.append((x, y, -z))
    return out


def assert_encloses(view, box, size=None, *, slack=None):
    """Never smaller than the exact image; with `slack`, no more than that many pixels larger."""
    size = size or (view.width, view.height)
    rects, depth, crossing = project(view, box, size, clip=False)
    corners = exact_corners(view, box, size)
    nearest = min(c[2] for c in corners)
    assert Fraction(float(depth[0])) <= nearest
    if crossing[0]:
        assert rects[:, 0].tolist() == [0, 0, *size]
        return
    if not view.is_parallel:
        assert nearest > Fraction(view.near)
    x0, y0, x1, y1 = (Fraction(float(r)) for r in rects[:, 0])
    xs, ys = [c[0] for c in corners], [c[1] for c in corners]
    assert x0 <= min(xs)
    assert y0 <= min(ys)
    assert x1 >= max(xs)
    assert y1 >= max(ys)
    if slack is not None:
        for given_, exact in ((x0, min(xs)), (x1, max(xs)), (y0, min(ys)), (y1, max(ys))):
            assert abs(float(given_ - exact)) <= slack * (1 + abs(float(exact)) / max(size))


VIEWS = {
    "ordinary": View((1, 2, 3), (4, -5, 6)),
    "map of another aspect": View((1, 2, 3), (4, -5, 6), width=1000, height=300),
    "narrow": View((0, 0, 0), (1, 1, 1), fov=0.01, far=1e9),
    "wide": View((0, 0, 0), (0, 1, 0), fov=179.9),
    "shifted": View((0, 0, 0), (0, 1, 0), shift=(0.5, -0.25)),
    "near to far 1:1e9": View((0, 0, 0), (0, 1, 0), near=1e-6, far=1e3),
    "orthographic": View((1, 2, 3), (4, -5, 6), parallel_scale=7.0),
    "one pixel": View((1, 2, 3), (4, -5, 6), width=1, height=1),
    "8k": View((1, 2, 3), (4, -5, 6), width=7680, height=4320),
}
coordinate = st.floats(-50, 50)
extent = st.one_of(st.just(0.0), st.floats(1e-6, 20))


@pytest.mark.parametrize("name", VIEWS)
@given(center=st.tuples(*[coordinate] * 3), half=st.tuples(*[extent] * 3))
def test_encloses_the_exact_image(name, center, half):
    assert_encloses(VIEWS[name], (*center, *half))


@pytest.mark.parametrize("name", [n for n in VIEWS if n not in ("narrow", "wide")])
def test_is_not_much_larger_than_the_exact_image(name, rng):
    view = VIEWS[name]
    ahead = np.asarray(view.eye) + view.forward * rng.uniform(20, 40, (40, 1)) + rng.uniform(-8, 8, (40, 3))
    for center in ahead:
        assert_encloses(view, (*center, *rng.uniform(0.1, 3, 3)), slack=0.13)


@pytest.mark.parametrize(
    ("unit", "place"), [(1e-9, 0.0), (1e-6, 1e-3), (1.0, 1e7), (1e6, 0.0), (1e3, 1e11), (1e150, 0.0)]
)
@pytest.mark.parametrize("parallel", [False, True])
def test_coordinates_of_any_size(unit, place, parallel, rng):
    at = np.full(3, place)
    scale = 5 * unit if parallel else None
    view = View(at, at + unit * np.array([3.0, 4, 1]), near=0.1 * unit, far=1e4 * unit, parallel_scale=scale)
    for _ in range(20):
        center = at + unit * (10 * view.forward + rng.uniform(-5, 5, 3))
        assert_encloses(view, (*center, *unit * rng.uniform(0.01, 2, 3)))


def test_a_box_at_the_near_plane_is_crossing_and_has_the_whole_viewport():
    view = View((0, 0, 0), (0, 1, 0), near=1.0)
    boxes = np.array([[0, 1.5, 0, 1, 0.5, 1], [0, 1.4, 0, 1, 0.5, 1], [0, 0, 0, 9, 9, 9], [0, -5, 0, 1, 1, 1]], float).T
    rects, _, crossing = project(view, boxes)
    assert crossing.all()
    assert rects.T.tolist() == [[0, 0, view.width, view.height]] * 4


@given(gap=st.floats(1e-5, 10), half=st.floats(1e-3, 100))
def test_a_box_clearly_behind_the_near_plane_is_not_crossing(gap, half):
    view = View((0, 0, 0), (0, 1, 0), near=1.0)
    _, depth, crossing = project(view, [0, 1.0 + half + gap * (1 + half), 0, half, half, half])
    assert not crossing[0]
    assert depth[0] > view.near


def test_parallel_views_have_no_crossing_boxes():
    view = View((0, 0, 0), (0, 1, 0), parallel_scale=3.0, near=1.0)
    rects, depth, crossing = project(view, [0, -5, 0, 1, 1, 1])
    assert not crossing[0]
    assert depth[0] == pytest.approx(-6)
    half = 360 / 3
    assert rects[:, 0] == pytest.approx([640 - half, 360 - half, 640 + half, 360 + half])


def test_not_a_number_is_crossing():
    boxes = np.array([[0, 9, 0, 1, 1, 1.0]] * 8).T.copy()
    for i in range(6):
        boxes[i, i] = np.nan
    boxes[1, 6] = np.inf
    rects, _, crossing = project(VIEWS["shifted"], boxes)
    assert crossing.tolist() == [True] * 7 + [False]
    assert np.isfinite(rects).all()


def test_clipping_keeps_rectangles_in_the_viewport(rng):
    view = VIEWS["ordinary"]
    boxes = np.concatenate([rng.uniform(-50, 50, (3, 500)), rng.uniform(0, 5, (3, 500))])
    free, _, _ = project(view, boxes, clip=False)
    rects, _, _ = project(view, boxes)
    limit = np.array([view.width, view.height, view.width, view.height])[:, None]
    assert np.array_equal(rects, np.clip(free, 0, limit))


def test_an_inverted_box_has_the_image_of_its_corners():
    view = VIEWS["ordinary"]
    box = np.array([8, -9, 10, 1.0, 2.0, 0.5])
    upright, _, _ = project(view, box, clip=False)
    inverted, _, _ = project(view, box * [1, 1, 1, -1, -1, -1], clip=False)
    assert inverted == pytest.approx(upright)


@pytest.mark.parametrize("count", [0, 1, CHUNK - 1, CHUNK, 2 * CHUNK + 1])
def test_chunks_do_not_show(count, rng):
    view = VIEWS["ordinary"]
    boxes = np.concatenate([rng.uniform(-50, 50, (3, count)), rng.uniform(0, 5, (3, count))])
    rects, depth, crossing = project(view, boxes)
    assert rects.shape == (4, count)
    for i in {0, count // 2, count - 1} & set(range(count)):
        alone = project(view, boxes[:, i])
        # products of other shapes may round differently
        assert rects[:, i] == pytest.approx(alone[0][:, 0], abs=1e-2)
        assert depth[i] == pytest.approx(alone[1][0], rel=1e-5, abs=1e-5)
        assert crossing[i] == alone[2][0]


def test_double_precision_takes_over_where_single_would_be_coarse(monkeypatch, rng):
    """A long wall beside the eye: single precision alone would grow it by much of a pixel."""
    view = View((0, 0, 0), (1, 0, 0), width=7680, height=4320)
    box = [500.2, 3.0, 0.0, 500.0, 0.5, 4.0]
    assert_encloses(view, box, slack=0.01)
    monkeypatch.setattr(projection, "REDONE_PIXELS", np.inf)
    with pytest.raises(AssertionError):
        assert_encloses(view, box, slack=0.01)
