"""Codes of depth never say "behind" where depths do not; spans of planes are never taken to be nearer than they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegraph.kernels import nearness
from scenegraph.kernels.nearness import (
    FARTHEST,
    NEAREST,
    nearness_codes,
    nearness_depth,
    nearness_of,
    nearness_scale,
    plane_nearness,
    span_nearness,
)

depths = st.floats(1e-12, 1e12)


def code(depth, scale, *, occludee):
    return int(nearness_codes(nearness_of(np.array([depth]), parallel=scale.parallel), scale, occludee=occludee)[0])


@given(st.tuples(depths, depths), depths, depths, st.booleans())
def test_a_comparison_of_codes_never_hides_what_depths_would_not(span, occluder, occludee, parallel):
    scale = nearness_scale(min(span), max(span), parallel=parallel, tolerance=1e-8 * (max(span) if parallel else 1))
    if code(occluder, scale, occludee=False) > code(occludee, scale, occludee=True):
        assert occluder < occludee


@given(depths, st.booleans())
def test_nothing_is_behind_itself(depth, parallel):
    scale = nearness_scale(0.5 * depth, 2 * depth, parallel=parallel)
    assert code(depth, scale, occludee=False) < code(depth, scale, occludee=True)


@pytest.mark.parametrize(("low", "high"), [(0.1, 5000.0), (1e-6, 1e3), (1e-9, 1e-8), (1e11, 1.1e11)])
def test_resolution(low, high):
    """Two depths that differ by three steps of the scale are told apart."""
    scale = nearness_scale(low, high, parallel=False)
    step = np.log(high / low) / (NEAREST - FARTHEST)
    depth = np.geomspace(low * 1.01, high / 1.01, 500)
    behind = depth * np.exp(3 * step + 3e-8)
    front = nearness_codes(nearness_of(depth, parallel=False), scale)
    back = nearness_codes(nearness_of(behind, parallel=False), scale, occludee=True)
    assert (front > back).all()


def test_extremes_are_safe():
    """Not a number, zero, infinity and negative depths: an occluder is as far, an occludee as near as can be."""
    scale = nearness_scale(1.0, 100.0, parallel=False)
    odd = np.array([np.nan, 0.0, -1.0, np.inf, -np.inf])
    # the occluder's nearness can only be infinite by mistake; it then hides what is behind everything else
    assert nearness_codes(odd, scale).tolist() == [FARTHEST, FARTHEST, FARTHEST, NEAREST + 1, FARTHEST]
    assert nearness_codes(np.array([np.nan, np.inf, -1.0]), scale, occludee=True).tolist() == [NEAREST + 1] * 3
    assert code(0.5, scale, occludee=True) == NEAREST + 1
    assert code(0.5, scale, occludee=False) == NEAREST + 1
    assert code(1e9, scale, occludee=False) == FARTHEST
    assert code(1e9, scale, occludee=True) == FARTHEST


@pytest.mark.parametrize("parallel", [False, True])
def test_one_depth_only_and_depths_of_codes(parallel):
    scale = nearness_scale(7.0, 7.0, parallel=parallel)
    assert code(7.0, scale, occludee=False) <= code(7.0, scale, occludee=True)
    scale = nearness_scale(2.0, 50.0, parallel=parallel)
    depth = np.linspace(2.0, 50.0, 100)
    back = nearness_depth(nearness_codes(nearness_of(depth, parallel=parallel), scale), scale)
    assert (back >= depth * (1 - 1e-12)).all()
    assert back[:-1] == pytest.approx(depth[:-1], rel=1e-3)
    assert (nearness_depth(np.array([0, FARTHEST], np.uint16), scale) == np.inf).all()


@pytest.mark.parametrize("parallel", [False, True])
def test_nearness_of_a_plane_is_linear_over_the_map(parallel, rng):
    window, size = (-0.7, 1.1, -0.4, 0.6), (64, 48)
    normal, point = rng.standard_normal((3, 20)), rng.uniform(-1, 1, (3, 20))
    point[2] = -rng.uniform(1, 9, 20)
    offset = (normal * point).sum(axis=0)
    a, b, c = plane_nearness(normal, offset, window=window, size=size, parallel=parallel)
    x, y = rng.uniform(0, 64, 20), rng.uniform(0, 48, 20)
    u, v = window[0] + x / 64 * 1.8, window[2] + y / 48 * 1.0
    if parallel:
        # the point (u, v, -d) lies on the plane
        d = (normal[0] * u + normal[1] * v - offset) / normal[2]
        assert a * x + b * y + c == pytest.approx(-d)
    else:
        d = offset / (normal[0] * u + normal[1] * v - normal[2])
        assert a * x + b * y + c == pytest.approx(1 / d)


def random_spans(rng, count=60, groups=4):
    group = np.sort(rng.integers(0, groups, count))
    first = rng.integers(0, 40, count)
    return group, rng.integers(0, 48, count), first, first + rng.integers(1, 25, count)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("step", [1e-9, 0.02, 0.3, 1e9])
def test_pieces_tile_their_span_and_are_never_taken_for_nearer(count, step, rng):
    spans = random_spans(rng)
    planes = rng.uniform(-1e-3, 1e-3, (count, 3, 4))
    planes[:, 2] += 0.2
    piece, first, end, nearness = span_nearness(*spans, planes, step=step, relative=True)
    group, row, start, stop = spans
    tiles = np.zeros((len(group), 80), int)
    for s, a, b, n in zip(piece, first, end, nearness, strict=True):
        tiles[s, a:b] += 1
        # the farthest plane at 25 points of the piece's area, its corners among them
        x, y = np.meshgrid(np.linspace(a, b, 5), np.linspace(row[s], row[s] + 1, 5))
        p = planes[:, :, group[s]]
        surface = (p[:, 0, None, None] * x + p[:, 1, None, None] * y + p[:, 2, None, None]).min(axis=0)
        assert n <= surface.min() + 1e-15
        if count == 1:
            assert n == pytest.approx(surface.min())
    for s in range(len(group)):
        assert (tiles[s, start[s] : stop[s]] == 1).all()
        assert tiles[s].sum() == stop[s] - start[s]
    if step == 1e-9:
        assert (end - first == 1).all()
    if step == 1e9:
        assert len(piece) == len(group)


def test_a_step_bounds_what_is_lost_along_a_piece(rng):
    spans = random_spans(rng)
    slope = 2e-3
    planes = np.array([[[slope] * 4, [0.0] * 4, [0.1] * 4]])
    for relative, step in ((True, 0.03), (False, 0.004)):
        piece, _, end, nearness = span_nearness(*spans, planes, step=step, relative=relative)
        limit = step * (slope * spans[2] + 0.1)[piece] if relative else step
        # pieces are whole texels
        assert (slope * end + 0.1 - nearness <= limit + slope).all()


def test_unused_planes_do_not_count():
    spans = tuple(np.array([v]) for v in (0, 3, 2, 9))
    planes = np.array([[[1e-3], [0.0], [0.5]], [[0.0], [0.0], [np.inf]]])
    both = span_nearness(*spans, planes, step=0.001, relative=True)
    one = span_nearness(*spans, planes[:1], step=0.001, relative=True)
    assert all(np.array_equal(a, b) for a, b in zip(both, one, strict=True))


def test_spans_in_parts(monkeypatch, rng):
    spans = random_spans(rng)
    planes = rng.uniform(1e-3, 2e-3, (2, 3, 4))
    whole = span_nearness(*spans, planes, step=0.1, relative=True)
    monkeypatch.setattr(nearness, "SPANS_AT_ONCE", 7)
    parts = span_nearness(*spans, planes, step=0.1, relative=True)
    order, other = (np.lexsort((p[1], p[0])) for p in (whole, parts))
    assert all(np.array_equal(a[order], b[other]) for a, b in zip(whole, parts, strict=True))
    nothing = span_nearness(*(np.zeros(0, np.int64),) * 4, planes, step=0.1, relative=True)
    assert [len(n) for n in nothing] == [0] * 4
