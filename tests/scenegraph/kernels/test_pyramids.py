"""Sums, minima and pyramids over rectangles, held against a look at every texel."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from scenegraph.kernels import rectangles
from scenegraph.kernels.pyramids import (
    map_cell_texels,
    map_count_pyramid,
    map_maximum_pyramid,
    map_minimum_pyramid,
    map_sums,
)
from scenegraph.kernels.rectangles import (
    rect_area,
    rect_cells_pass,
    rect_count_above,
    rect_level,
    rect_minimum,
    rect_sums,
    rect_texels,
)

SHAPES = st.one_of(
    st.just((1, 1)),
    st.tuples(st.just(1), st.integers(1, 40)),
    st.tuples(st.integers(1, 40), st.just(1)),
    st.tuples(st.integers(1, 24), st.integers(1, 24)),
)


@st.composite
def maps_and_rects(draw, values):
    """A map of any shape and some rectangles on it, not empty."""
    height, width = shape = draw(SHAPES)
    dtype = bool if values is None else np.uint16
    content = draw(hnp.arrays(dtype, shape, elements=st.booleans() if values is None else values))
    rects = []
    for _ in range(draw(st.integers(1, 6))):
        x0, y0 = draw(st.integers(0, width - 1)), draw(st.integers(0, height - 1))
        rects.append((x0, y0, draw(st.integers(x0 + 1, width)), draw(st.integers(y0 + 1, height))))
    return content, np.array(rects, np.int64).T


def cut(content, rect):
    x0, y0, x1, y1 = rect
    return content[y0:y1, x0:x1]


@given(maps_and_rects(None))
def test_sums_count_every_texel(case):
    covered, rects = case
    sums = map_sums(covered)
    assert sums.dtype == np.int32
    assert rect_sums(sums, rects).tolist() == [int(cut(covered, r).sum()) for r in rects.T]
    assert rect_area(rects).tolist() == [cut(covered, r).size for r in rects.T]


def test_sums_of_large_values_do_not_overflow():
    values = np.full((300, 300), 65535, np.uint16)
    sums = map_sums(values)
    assert sums.dtype == np.int64
    assert rect_sums(sums, np.array([[0], [0], [300], [300]])).tolist() == [65535 * 90_000]


@given(maps_and_rects(st.integers(0, 65535)), st.sampled_from([-1, 0, 1, 9]))
def test_minimum_is_that_of_every_texel(case, rare):
    values, rects = case
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rectangles, "RARE", rare)
        assert rect_minimum(values, rects).tolist() == [int(cut(values, r).min()) for r in rects.T]


def test_minimum_over_many_rectangles_at_once(rng):
    values = rng.integers(0, 65536, (61, 103)).astype(np.uint16)
    x = np.sort(rng.integers(0, 104, (2, 4000)), axis=0)
    y = np.sort(rng.integers(0, 62, (2, 4000)), axis=0)
    kept = (x[0] < x[1]) & (y[0] < y[1])
    rects = np.stack([x[0], y[0], x[1], y[1]])[:, kept]
    assert rect_minimum(values, rects).tolist() == [int(cut(values, r).min()) for r in rects.T]
    assert not len(rect_minimum(values, rects[:, :0]))


@given(maps_and_rects(None))
def test_pyramid_counts_every_texel_under_a_cell(case):
    covered, _ = case
    height, width = covered.shape
    levels = map_count_pyramid(covered)
    assert levels[-1].shape == (1, 1)
    for k, level in enumerate(levels):
        full = map_cell_texels((width, height), k)
        assert level.shape == full.shape == (-(-height >> k), -(-width >> k))
        for y, x in np.ndindex(level.shape):
            under = covered[y << k : (y + 1) << k, x << k : (x + 1) << k]
            assert level[y, x] == under.sum()
            assert full[y, x] == under.size


@given(maps_and_rects(st.integers(0, 65535)))
def test_pyramids_of_extremes(case):
    values, _ = case
    for made, extreme in ((map_minimum_pyramid(values), np.min), (map_maximum_pyramid(values), np.max)):
        for k, level in enumerate(made):
            for y, x in np.ndindex(level.shape):
                assert level[y, x] == extreme(values[y << k : (y + 1) << k, x << k : (x + 1) << k])


@given(maps_and_rects(st.integers(0, 9)), st.lists(st.integers(0, 9), min_size=6, max_size=6), st.integers(1, 50))
def test_counting_above_a_code_of_its_own_for_each_rectangle(case, codes, at_once):
    values, rects = case
    codes = np.array(codes[: rects.shape[1]], np.uint16)
    found = rect_count_above(values, rects, codes, at_once=at_once)
    assert found.tolist() == [int((cut(values, r) > c).sum()) for r, c in zip(rects.T, codes, strict=True)]
    assert rect_count_above(values, rects[:, :0], codes[:0]).shape == (0,)


def passes_of(covered):
    size = covered.shape[::-1]
    return [count == map_cell_texels(size, k) for k, count in enumerate(map_count_pyramid(covered))]


@given(maps_and_rects(None), st.integers(0, 3))
def test_cells_that_pass_prove_that_all_texels_do(case, descents):
    covered, rects = case
    exact = [bool(cut(covered, r).all()) for r in rects.T]
    hopeless = [count == 0 for count in map_count_pyramid(covered)]
    found = rect_cells_pass(passes_of(covered), rects, descents=descents, hopeless=hopeless)
    assert not any(f and not e for f, e in zip(found, exact, strict=True))
    assert found.tolist() == rect_cells_pass(passes_of(covered), rects, descents=descents).tolist()


@given(maps_and_rects(None))
def test_enough_descents_are_exact(case):
    covered, rects = case
    found = rect_cells_pass(passes_of(covered), rects, descents=16)
    assert found.tolist() == [bool(cut(covered, r).all()) for r in rects.T]


@given(maps_and_rects(st.integers(1, 5)), st.integers(0, 6))
def test_cells_compare_depths_as_well(case, limit):
    values, rects = case
    codes = np.full(rects.shape[1], limit, np.uint16)
    least = map_minimum_pyramid(values)
    every = [np.ones(level.shape, bool) for level in least]
    found = rect_cells_pass(every, rects, descents=16, least=least, codes=codes)
    assert found.tolist() == [bool((cut(values, r) > limit).all()) for r in rects.T]


def test_at_the_level_of_a_rectangle_it_meets_at_most_four_cells(rng):
    """Eq. 3.1, in whole numbers: ⌈log₂ of the longer side⌉."""
    for longest in range(1, 300):
        x0, y0 = rng.integers(0, 500, 2)
        rect = np.array([[x0], [y0], [x0 + longest], [y0 + rng.integers(1, longest + 1)]])
        level = int(rect_level(rect)[0])
        assert 2.0 ** (level - 1) < longest <= 2.0**level
        assert ((x0 + longest - 1) >> level) - (x0 >> level) <= 1


def test_texels_of_rectangles():
    rects = np.array(
        [
            (0.0, 0.0, 7.0, 5.0),
            (0.2, 0.9, 0.3, 1.0),
            (2.0, 2.0, 2.0, 2.0),
            (-9.0, -9.0, 99.0, 99.0),
            (-9.0, 1.0, -1.0, 2.0),
            (7.0, 1.0, 9.0, 2.0),
            (np.nan, np.nan, np.nan, np.nan),
            (-np.inf, 1.5, np.inf, 1.5),
        ]
    ).T
    found = rect_texels(rects, size=(7, 5)).T.tolist()
    assert found[:4] == [[0, 0, 7, 5], [0, 0, 1, 1], [2, 2, 3, 3], [0, 0, 7, 5]]
    assert rect_area(rect_texels(rects, size=(7, 5))).tolist() == [35, 1, 1, 35, 0, 0, 35, 7]


@given(st.tuples(*[st.floats(-3, 12)] * 4))
def test_every_point_of_a_rectangle_on_the_map_lies_in_its_texels(numbers):
    x0, x1 = sorted(numbers[:2])
    y0, y1 = sorted(numbers[2:])
    (a,), (b,), (c,), (d,) = rect_texels(np.array([[x0], [y0], [x1], [y1]]), size=(7, 5)).tolist()
    for x, y in ((x0, y0), (x1, y1), ((x0 + x1) / 2, (y0 + y1) / 2)):
        if 0 < x < 7 and 0 < y < 5:
            assert a <= x <= c
            assert b <= y <= d


@pytest.mark.parametrize("shape", [(8192, 8192), (4097, 8191), (1, 8192), (8192, 1)])
def test_one_open_texel_is_never_lost(shape, rng):
    """Section 3.3 of Kristmann 2022: averages lose it to rounding."""
    height, width = shape
    y, x = int(rng.integers(height)), int(rng.integers(width))
    covered = np.ones(shape, bool)
    covered[y, x] = False
    whole = np.array([[0], [0], [width], [height]])
    assert rect_sums(map_sums(covered), whole).tolist() == [height * width - 1]
    levels = map_count_pyramid(covered)
    full = [map_cell_texels((width, height), k) for k in range(len(levels))]
    for k, (level, texels) in enumerate(zip(levels, full, strict=True)):
        assert level.sum(dtype=np.int64) == height * width - 1
        assert level[y >> k, x >> k] == texels[y >> k, x >> k] - 1
    passes = [level == texels for level, texels in zip(levels, full, strict=True)]
    assert not rect_cells_pass(passes, whole, descents=2)[0]
    del levels, full, passes
    codes = covered.astype(np.uint16)
    assert rect_minimum(codes, whole).tolist() == [0]
    # and a rectangle beside it knows nothing of it
    beside = np.array([[0], [0], [width], [y]]) if y else np.array([[x + 1], [0], [width], [1]])
    if rect_area(beside)[0]:
        assert rect_minimum(codes, beside).tolist() == [1]


def test_what_an_average_makes_of_it():
    """The same hole in single precision: after 13 levels of a map of 8192 × 8192 it is gone."""
    average = np.float32(0)
    for _ in range(13):
        average = np.float32((average + 3) / 4)
    assert average == 1.0
