"""Spans of covered texels, held against exact rational geometry and against texel-by-texel evaluation."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegraph.kernels import coverage
from scenegraph.kernels.coverage import edge_extents, edge_spans
from scenegraph.kernels.spans import span_maximum, span_power


def ring(points):
    """(4, n) directed edges of a closed polygon."""
    p = np.asarray(points, float)
    return np.concatenate([p, np.roll(p, -1, axis=0)], axis=1).T


def outlines(*rings):
    """Edges of several polygons, one outline each."""
    ends = np.concatenate([np.zeros((4, 0)), *map(ring, rings)], axis=1)
    group = np.repeat(np.arange(len(rings)), [len(r) for r in rings])
    return ends, np.ones(len(group), int), group


def texels(spans, size, group=None):
    """(h, w) how many spans cover each texel."""
    out = np.zeros(size[::-1], int)
    for g, row, first, end in zip(*spans, strict=True):
        if group is None or g == group:
            assert 0 <= first < end <= size[0]
            out[row, first:end] += 1
    return out


def touches(edge, x, y, grow=Fraction(0)):
    """Whether a segment meets the closed square [x, x+1] × [y, y+1], grown; exact (Liang-Barsky)."""
    x0, y0, x1, y1 = (Fraction(float(v)) for v in edge)
    low, high = Fraction(0), Fraction(1)
    for start, step, a, b in ((x0, x1 - x0, x, x + 1), (y0, y1 - y0, y, y + 1)):
        a, b = a - grow, b + grow
        if step == 0:
            if not a <= start <= b:
                return False
            continue
        t0, t1 = sorted(((a - start) / step, (b - start) / step))
        low, high = max(low, t0), min(high, t1)
    return low <= high


def winding(ends, weight, x, y):
    """Winding number of a point that lies on no edge; exact."""
    total = 0
    for (x0, y0, x1, y1), w in zip(ends.T, weight, strict=True):
        x0, y0, x1, y1 = (Fraction(float(v)) for v in (x0, y0, x1, y1))
        if (y0 <= y) != (y1 <= y):
            cut = x0 + (x1 - x0) * (y - y0) / (y1 - y0)
            if cut < x:
                # upward edges have the inside at their left
                total += int(w) * (1 if y1 < y0 else -1)
    return total


#: A polygon holds its border: an edge along the border of a texel does not open it.
OPEN = Fraction(-1, 10**12)


def inside(ends, weight, size, grow=OPEN):
    """(h, w) texels whose interior, shrunk or grown, no edge touches and whose center is wound around."""
    out = np.zeros(size[::-1], bool)
    for y, x in np.ndindex(out.shape):
        if not any(touches(edge, x, y, grow) for edge in ends.T):
            out[y, x] = winding(ends, weight, x + Fraction(1, 2), y + Fraction(1, 2)) > 0
    return out


SIZE = (7, 5)
free = st.floats(-3, 10, allow_subnormal=False)
# quarters hit texel borders, corners and centers
lattice = st.integers(-12, 40).map(lambda k: k / 4)
polygons = st.lists(st.tuples(free, free), min_size=3, max_size=7) | st.lists(
    st.tuples(lattice, lattice), min_size=3, max_size=7
)


@given(polygons)
def test_strict_spans_are_what_lies_wholly_inside(points):
    """Any closed polygon, crossing itself as it likes: nothing outside is covered, nothing clearly inside is lost."""
    ends, weight, group = outlines(points)
    covered = texels(edge_spans(ends, weight, group, size=SIZE), SIZE) > 0
    assert not (covered & ~inside(ends, weight, SIZE)).any()
    # edges count as a billionth of a texel thick, flat ones as thick as they rise
    assert not (inside(ends, weight, SIZE, Fraction(1, 5000)) & ~covered).any()


@given(polygons, st.floats(0, 0.49))
def test_slack_makes_edges_thicker(points, slack):
    ends, weight, group = outlines(points)
    covered = texels(edge_spans(ends, weight, group, size=SIZE, slack=slack), SIZE) > 0
    assert not (covered & ~inside(ends, weight, SIZE, Fraction(slack) + OPEN)).any()


@given(st.lists(st.tuples(free, free), min_size=3, max_size=7))
def test_center_spans_are_what_has_its_center_inside(points):
    ends, weight, group = outlines(points)
    covered = texels(edge_spans(ends, weight, group, size=SIZE, strict=False), SIZE) > 0
    half = Fraction(1, 2)
    for y, x in np.ndindex(covered.shape):
        near = any(touches(edge, x + half, y + half, Fraction(-1, 2) + Fraction(1, 10**9)) for edge in ends.T)
        if not near:
            assert covered[y, x] == (winding(ends, weight, x + half, y + half) > 0)


def test_centers_on_edges_belong_to_one_of_two_neighbors():
    """The rule of rasterizers: a partition of the plane covers each center once."""
    quads = [[(x, y), (x + 2, y), (x + 2, y + 2), (x, y + 2)] for x in (0.5, 2.5, 4.5) for y in (0.5, 2.5)]
    covered = texels(edge_spans(*outlines(*quads), size=SIZE, strict=False), SIZE)
    assert covered.max() == 1
    assert covered.sum() == 24


def test_convex_polygons_shrink_by_half_a_texel_in_the_l1_norm(rng):
    """The same set as edge functions a·x + b·y + c moved inward by (|a| + |b|) / 2, by another way."""
    size = (40, 30)
    x, y = np.meshgrid(np.arange(40) + 0.5, np.arange(30) + 0.5)
    for _ in range(50):
        angle = np.sort(rng.uniform(0, 2 * np.pi, 6))
        points = rng.uniform(5, 30, 2) + rng.uniform(3, 20) * np.column_stack([np.cos(angle), np.sin(angle)])
        if np.ptp(np.append(angle, angle[0] + 2 * np.pi)) == 0:
            continue
        expected = np.ones((30, 40), bool)
        for x0, y0, x1, y1 in ring(points).T:
            a, b = y0 - y1, x1 - x0
            expected &= a * (x - x0) + b * (y - y0) >= (abs(a) + abs(b)) / 2
        covered = texels(edge_spans(*outlines(points), size=size), size) > 0
        assert np.array_equal(covered, expected)


def test_holes_and_islands():
    square = [(0, 0), (7, 0), (7, 5), (0, 5)]
    hole = [(2, 1), (2, 4), (5, 4), (5, 1)]
    ends = np.concatenate([ring(square), ring(hole)], axis=1)
    spans = edge_spans(ends, np.ones(8, int), np.zeros(8, int), size=SIZE, strict=False)
    expected = np.ones((5, 7), int)
    expected[1:4, 2:5] = 0
    assert np.array_equal(texels(spans, SIZE), expected)
    outer = [(-1, -1), (8, -1), (8, 6), (-1, 6)]
    ends = np.concatenate([ring(outer), ring(hole)], axis=1)
    strict = texels(edge_spans(ends, np.ones(8, int), np.zeros(8, int), size=SIZE), SIZE)
    # the row at whose lower border the hole ends is taken to be touched
    assert not ((strict > 0) & ~inside(ends, np.ones(8), SIZE)).any()
    assert not (inside(ends, np.ones(8), SIZE, Fraction(1, 5000)) & (strict == 0)).any()
    assert strict.sum() > 0


def test_outlines_do_not_disturb_each_other(rng):
    """Each alone and all together; two halves of a square do not close the texels that they share."""
    rings = [rng.uniform(-2, 9, (5, 2)) for _ in range(12)]
    together = edge_spans(*outlines(*rings), size=SIZE)
    for i, points in enumerate(rings):
        assert np.array_equal(texels(together, SIZE, i), texels(edge_spans(*outlines(points), size=SIZE), SIZE))
    halves = [[(-1, -1), (3.5, -1), (3.5, 6), (-1, 6)], [(3.5, -1), (8, -1), (8, 6), (3.5, 6)]]
    assert (texels(edge_spans(*outlines(*halves), size=SIZE), SIZE)[:, 3] == 0).all()
    # as one outline the seam is gone
    ends, weight, _ = outlines(*halves)
    seam = (ends[0] == 3.5) & (ends[2] == 3.5)
    merged = edge_spans(ends[:, ~seam], weight[~seam], np.zeros(6, int), size=SIZE)
    assert (texels(merged, SIZE) == 1).all()


def test_weights_wind_and_unwind():
    square = ring([(-1, -1), (8, -1), (8, 6), (-1, 6)])
    none = np.zeros(4, int)
    assert (texels(edge_spans(square, np.full(4, 3), none, size=SIZE), SIZE) == 1).all()
    assert not len(edge_spans(square, np.full(4, -1), none, size=SIZE)[0])
    both = np.concatenate([square, square[[2, 3, 0, 1]]], axis=1)
    assert not len(edge_spans(both, np.ones(8, int), np.zeros(8, int), size=SIZE)[0])


@pytest.mark.parametrize(
    "spoil",
    [
        lambda ends, weight, slack: ends.__setitem__((0, 0), np.nan),
        lambda ends, weight, slack: ends.__setitem__((2, 1), np.inf),
        lambda ends, weight, slack: weight.__setitem__(slice(0, 4), 64),
        lambda ends, weight, slack: slack.__setitem__(2, 0.5),
        lambda ends, weight, slack: slack.__setitem__(2, np.nan),
        lambda ends, weight, slack: weight.__setitem__(0, 0),
    ],
    ids=["nan", "infinite", "wound too often", "too uncertain", "unknown slack", "not closed"],
)
def test_what_cannot_be_drawn_is_left_out_and_nothing_else(spoil):
    square = [(-1, -1), (8, -1), (8, 6), (-1, 6)]
    ends, weight, group = outlines(square, square, square)
    slack = np.zeros(12)
    # the edge that is spoiled first crosses every row
    ends[:, :4] = ends[:, [1, 2, 3, 0]]
    spoil(ends, weight, slack)
    spans = edge_spans(ends, weight, group, size=SIZE, slack=slack)
    assert sorted(set(spans[0].tolist())) == [1, 2]
    assert (texels(spans, SIZE) == 2).all()


def test_coordinates_far_off_the_map():
    """Edges from -1e12 to 1e12 lose their last digits: coverage gets smaller by that, not wrong."""
    triangle = [(-1e12, -1e12), (1e12, -1e12), (3.0, 1e12)]
    assert (texels(edge_spans(*outlines(triangle), size=SIZE), SIZE) == 1).all()
    sliver = [(-1e9, 1.9), (1e9, 1.9), (1e9, 4.1), (-1e9, 4.1)]
    assert np.flatnonzero(texels(edge_spans(*outlines(sliver), size=SIZE), SIZE).sum(axis=1)).tolist() == [2, 3]


@pytest.mark.parametrize(("name", "value"), [("CROSSINGS_AT_ONCE", 1), ("CROSSINGS_AT_ONCE", 40), ("_TURN_BITS", 53)])
def test_many_outlines_are_drawn_in_parts(monkeypatch, rng, name, value):
    """For the cache, or because 2 · 3 bits for x and 53 for the turn leave 4 for 20 · 5 lines."""
    rings = [rng.uniform(-2, 9, (4, 2)) for _ in range(20)]
    ends, weight, group = outlines(*rings)
    order = rng.permutation(len(group))
    whole = edge_spans(ends, weight, group, size=SIZE)
    monkeypatch.setattr(coverage, name, value)
    parts = edge_spans(ends[:, order], weight[order], group[order], size=SIZE)
    assert all(np.array_equal(a, b) for a, b in zip(whole, parts, strict=True))


@pytest.mark.parametrize("size", [(1, 1), (1, 9), (9, 1), (3, 5)])
def test_small_and_odd_maps(size, rng):
    for _ in range(20):
        points = rng.uniform(-3, 12, (4, 2))
        ends, weight, group = outlines(points)
        assert np.array_equal(texels(edge_spans(ends, weight, group, size=size), size) > 0, inside(ends, weight, size))


def test_no_edges():
    nothing = edge_spans(np.zeros((4, 0)), np.zeros(0, int), np.zeros(0, int), size=SIZE)
    assert [len(a) for a in nothing] == [0, 0, 0, 0]
    assert not span_maximum(*nothing[1:], np.zeros(0, np.uint16), size=SIZE).any()


@given(polygons, polygons)
def test_extents_hold_all_that_edges_touch(first, second):
    ends, _, group = outlines(first, second)
    spans = edge_extents(ends, group, groups=2, size=SIZE)
    for g, points in enumerate((first, second)):
        covered = texels(spans, SIZE, g)
        assert covered.max(initial=0) <= 1
        for row in range(SIZE[1]):
            touched = [x for x in range(SIZE[0]) if any(touches(e, x, row, OPEN) for e in ring(points).T)]
            if touched:
                assert covered[row, min(touched) : max(touched) + 1].all()


@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 6), st.integers(1, 7), st.integers(0, 65535)), max_size=20))
def test_span_maximum_is_the_highest_value_over_each_texel(spans):
    row, first, length, value = np.array(spans, np.int64).reshape(-1, 4).T
    end = np.minimum(first + length, SIZE[0])
    expected = np.zeros(SIZE[::-1], np.uint16)
    for r, a, b, v in zip(row, first, end, value, strict=True):
        expected[r, a:b] = np.maximum(expected[r, a:b], v)
    assert np.array_equal(span_maximum(row, first, end, value.astype(np.uint16), size=SIZE), expected)


def test_span_power_is_exact_at_powers_of_two():
    length = np.arange(1, 70_000)
    assert span_power(length, 70_000).tolist() == [int(n).bit_length() - 1 for n in length]
