"""The four lowest coefficients are SciPy's; the level of visibility has the ends and the order that it should."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.fft import dctn

from scenegraph.kernels import frequency
from scenegraph.kernels.frequency import (
    BLOCK,
    block_basis,
    block_coefficients,
    block_visibility,
    rect_blocks,
    rect_visibility,
)
from scenegraph.kernels.pyramids import (
    map_count_pyramid,
    map_maximum_pyramid,
    map_minimum_pyramid,
)
from scenegraph.kernels.rectangles import (
    rect_level,
)

SIDES = [(n, m) for n in range(1, BLOCK + 1) for m in range(1, BLOCK + 1)]


def reference(block):
    """F(0,0), F(1,0), F(0,1), F(1,1) by SciPy; what a block is too small for is 0."""
    f = dctn(block, norm="ortho")
    wide, tall = block.shape[1] > 1, block.shape[0] > 1
    return [f[0, 0], f[0, 1] if wide else 0, f[1, 0] if tall else 0, f[1, 1] if wide and tall else 0]


@pytest.mark.parametrize("at_once", [1, 7, 512])
def test_coefficients_of_blocks_of_every_size(at_once, rng, monkeypatch):
    monkeypatch.setattr(frequency, "BLOCKS_AT_ONCE", at_once)
    image = rng.uniform(-0.5, 0.5, (40, 50))
    corners = [(rng.integers(0, 51 - n), rng.integers(0, 41 - m)) for n, m in SIDES]
    cells = np.array([(x, y, x + n, y + m) for (x, y), (n, m) in zip(corners, SIDES, strict=True)]).T
    order = rng.permutation(cells.shape[1])
    found, total = block_coefficients(image, cells[:, order])
    for i, (x0, y0, x1, y1) in enumerate(cells[:, order].T):
        block = image[y0:y1, x0:x1]
        assert found[:, i] == pytest.approx(reference(block), abs=1e-12)
        assert total[i] == pytest.approx(block.sum(), abs=1e-12)


def test_no_blocks():
    coefficients, total = block_coefficients(np.zeros((3, 3)), np.zeros((4, 0), np.int64))
    assert coefficients.shape == (4, 0)
    assert total.shape == (0,)


def test_basis_is_orthonormal():
    for n in range(2, BLOCK + 1):
        basis = block_basis(n)
        assert basis @ basis.T == pytest.approx(np.eye(2), abs=1e-12)
        assert not basis[:, n:].any()


def visibility(opacity):
    image = np.asarray(opacity, float) - 0.5
    cells = np.array([[0], [0], [image.shape[1]], [image.shape[0]]])
    return float(block_visibility(*block_coefficients(image, cells), cells)[0])


@pytest.mark.parametrize(("n", "m"), SIDES)
def test_covered_is_one_and_empty_is_minus_one_exactly(n, m):
    assert visibility(np.ones((m, n))) == 1.0
    assert visibility(np.zeros((m, n))) == -1.0


def test_scale_of_the_printed_form():
    """Figure 3.4: in 8 bits, LV of a covered 8 × 8 block is 1024, that of an empty one -1024."""
    cells = np.array([[0], [0], [8], [8]])
    (f00, f10, f01, f11), _ = block_coefficients(np.full((8, 8), 128.0), cells)
    assert f00 - abs(f10) - abs(f01) - abs(f11) == pytest.approx(1024)


@given(st.integers(0, 2**32 - 1), st.integers(1, 16), st.integers(1, 16))
def test_visibility_stays_within_its_ends(seed, n, m):
    rng = np.random.default_rng(seed)
    value = visibility(rng.random((m, n)) < rng.random())
    assert -1.0 <= value <= 1.0


def test_a_quarter_covered_block_would_fall_below_minus_one():
    """What the clamp is for: the printed value reaches about -1.8 times its scale."""
    block = np.zeros((16, 16))
    block[:8, :8] = 1
    f00, f10, f01, f11 = reference(block - 0.5)
    assert (f00 - abs(f10) - abs(f01) - abs(f11)) / 8 < -1.7
    assert visibility(block) == -1.0


def test_small_holes_show_less_than_one_large_hole_of_the_same_area():
    """Figure 3.1: the reason for all this."""
    large, small = np.ones((16, 16)), np.ones((16, 16))
    large[:8, 4:12] = 0
    small[::2, ::2] = 0
    assert large.sum() == small.sum()
    assert visibility(small) > visibility(large) + 0.35


def test_blocks_have_eight_to_sixteen_cells_on_their_longer_side(rng):
    corner = rng.integers(0, 300, (2, 3000))
    size = rng.integers(1, 700, (2, 3000))
    rects = np.concatenate([corner, corner + size])
    level, cells = rect_blocks(rects, levels=11)
    sides = cells[2:] - cells[:2]
    assert (sides >= 1).all()
    assert (sides <= BLOCK).all()
    assert np.array_equal(level, np.maximum(rect_level(rects) - 4, 0))
    assert (sides.max(axis=0)[level > 0] >= 8).all()
    # at the finest level the block is the rectangle
    assert np.array_equal(cells[:, level == 0], rects[:, level == 0])


@pytest.mark.parametrize("size", [(1, 1), (33, 1), (1, 9), (97, 61)])
def test_visibility_over_a_pyramid(size, rng):
    """Every level gives 1 and -1 exactly, cells at odd borders included; in between, blocks are cut out by hand."""
    width, height = size
    x = np.sort(rng.integers(0, width + 1, (2, 300)), axis=0)
    y = np.sort(rng.integers(0, height + 1, (2, 300)), axis=0)
    x[1], y[1] = np.maximum(x[1], x[0] + 1), np.maximum(y[1], y[0] + 1)
    kept = (x[1] <= width) & (y[1] <= height)
    rects = np.stack([x[0], y[0], x[1], y[1]])[:, kept]
    assert (rect_visibility(map_count_pyramid(np.ones((height, width), bool)), rects) == 1.0).all()
    assert (rect_visibility(map_count_pyramid(np.zeros((height, width), bool)), rects) == -1.0).all()
    covered = rng.random((height, width)) < 0.6
    found = rect_visibility(map_count_pyramid(covered), rects)
    level, cells = rect_blocks(rects, levels=len(map_count_pyramid(covered)))
    for i, (x0, y0, x1, y1) in enumerate(cells.T):
        k = int(level[i])
        opacity = [
            [covered[v << k : (v + 1) << k, u << k : (u + 1) << k].mean() for u in range(x0, x1)] for v in range(y0, y1)
        ]
        assert found[i] == pytest.approx(visibility(opacity), abs=1e-12)


def test_only_what_is_in_front_counts():
    """Codes grow toward the eye: an occludee nearer than all occluders is seen in full, one behind all is covered."""
    codes = np.full((32, 32), 100, np.uint16)
    codes[:, 16:] = 300
    counts = map_count_pyramid(codes > 0)
    least, most = map_minimum_pyramid(codes), map_maximum_pyramid(codes)
    rects = np.array([[0, 0, 16, 16], [16, 0, 32, 16], [0, 0, 32, 32], [8, 0, 24, 32]]).T

    def at(code):
        return rect_visibility(counts, rects, depths=(least, most, np.full(4, code, np.uint16)))

    assert at(300).tolist() == [-1.0] * 4
    assert at(99).tolist() == [1.0] * 4
    between = at(200)
    assert between[:2].tolist() == [-1.0, 1.0]
    # blocks of 16 × 16 and 8 × 16 cells
    half = np.arange(16)[:, None] * 0 + (np.arange(16) >= 8)
    assert between[2:] == pytest.approx([visibility(half), visibility(half[:, 4:12])])


def test_a_cell_partly_in_front_counts_by_half():
    codes = np.full((32, 32), 100, np.uint16)
    codes[::2] = 300
    counts, least, most = map_count_pyramid(codes > 0), map_minimum_pyramid(codes), map_maximum_pyramid(codes)
    whole = np.array([[0], [0], [32], [32]])
    found = rect_visibility(counts, whole, depths=(least, most, np.array([200], np.uint16)))
    assert found[0] == pytest.approx(visibility(np.full((16, 16), 0.5)), abs=1e-12)


@pytest.mark.parametrize("shape", [(64, 64), (61, 83), (7, 200)])
def test_cells_partly_in_front_are_counted_texel_by_texel_if_there_are_texels(shape, rng):
    codes = rng.choice(np.array([0, 100, 200, 300], np.uint16), shape)
    counts, least, most = map_count_pyramid(codes > 0), map_minimum_pyramid(codes), map_maximum_pyramid(codes)
    least = map_minimum_pyramid(np.where(codes > 0, codes, np.uint16(65535)))
    corner = rng.integers(0, [[shape[1] - 3], [shape[0] - 3]], (2, 60))
    rects = np.concatenate([corner, np.minimum(corner + rng.integers(1, 64, (2, 60)), [[shape[1]], [shape[0]]])])
    own = rng.choice(np.array([50, 150, 250, 350], np.uint16), 60)
    found = rect_visibility(counts, rects, depths=(least, most, own), texels=codes)
    for i in range(60):
        in_front = map_count_pyramid(codes > own[i])
        assert found[i] == pytest.approx(rect_visibility(in_front, rects[:, [i]])[0], abs=1e-12)


def test_with_no_texels_to_look_at_it_is_half_again(rng):
    codes = rng.choice(np.array([100, 300], np.uint16), (64, 64))
    counts, least, most = map_count_pyramid(codes > 0), map_minimum_pyramid(codes), map_maximum_pyramid(codes)
    cells = np.array([[0], [0], [16], [16]])
    image = counts[2] / 16 - 0.5
    depths = least[2], most[2], np.array([200], np.uint16)
    by_half = block_coefficients(image, cells, depths=depths)
    assert np.array_equal(
        by_half[0], block_coefficients(image, cells, depths=depths, texels=(codes, 2), most_texels=0)[0]
    )
    assert not np.array_equal(by_half[0], block_coefficients(image, cells, depths=depths, texels=(codes, 2))[0])
