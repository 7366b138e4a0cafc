"""Shadow frusta of convex shapes: never larger than the exact shadow, and hardly smaller."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from convex_shapes import (
    corners_of,
    exact,
    half_spaces,
    polygon_hides,
    shadow_arrays,
    shadow_rows,
    solid_hides,
    table_of,
)
from scenegraph import Occluder, SceneError
from scenegraph.kernels.shadow_frusta import box_depth_in_frusta_exact
from scenegraph.kernels.silhouettes import UNUSED, cone_depth_caps, cone_outline, cone_side_planes, cone_turns_are_even

#: Small integers make all the coincidences: faces edge-on, boxes that touch, edges that point at the eye.
NUMBERS = st.one_of(st.integers(-4, 4).map(float), st.floats(-4, 4, width=32), st.floats(-4, 4))
POINTS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
SIZES = st.one_of(st.integers(0, 3).map(float), st.floats(0, 3))
CAPS = st.sampled_from([0, 99])


@st.composite
def boxes(draw):
    """Center and half extent, flat ones too."""
    return np.array([*draw(POINTS), *draw(st.tuples(SIZES, SIZES, SIZES))])


def hidden(rows, boxes, eye):
    return box_depth_in_frusta_exact(np.asarray(boxes, float).reshape(-1, 6).T, rows, eye=np.asarray(eye, float)) > 0


def truth(occluder, eye, box, grow=Fraction(0)):
    """Whether the occluder hides every corner of a box, and so all of it, in exact arithmetic."""
    e, corners = exact(eye), corners_of(box, grow)
    if occluder.kind == "planar":
        polygon = [exact(v) for v in occluder.vertices]
        return all(polygon_hides(polygon, e, c) for c in corners)
    planes = half_spaces(occluder.vertices, occluder.faces)
    return all(solid_hides(planes, e, c) for c in corners)


def check(occluder, eye, box, most_faces):
    """Hidden only if truly hidden; and hidden if a box larger by a millionth is, unless the cap is the simple one."""
    rows, good = shadow_rows(table_of(occluder), eye, most_faces=most_faces)
    found = bool(hidden(rows, box, eye)[0, 0]) and bool(good[0])
    if found:
        assert truth(occluder, eye, box)
    elif good[0] and (most_faces or occluder.kind == "planar"):
        assert not truth(occluder, eye, box, Fraction(1, 10**6)) or not box[3:].all()
    return found


@given(POINTS, st.tuples(*[st.sampled_from([0.5, 1.0, 2.0])] * 3), POINTS, boxes(), CAPS)
def test_boxes_hide_no_more_than_the_exact_shadow(low, size, eye, box, most_faces):
    check(Occluder.box(low, np.add(low, size)), eye, box, most_faces)


@given(st.lists(POINTS, min_size=4, max_size=4), POINTS, boxes(), CAPS)
def test_tetrahedra_hide_no_more_than_the_exact_shadow(corners, eye, box, most_faces):
    try:
        occluder = Occluder.solid(corners)
    except SceneError:
        assume(False)
    check(occluder, eye, box, most_faces)


@given(st.lists(POINTS, min_size=3, max_size=3), POINTS, boxes())
def test_triangles_hide_no_more_than_the_exact_shadow(corners, eye, box):
    try:
        occluder = Occluder.planar(corners)
    except SceneError:
        assume(False)
    check(occluder, eye, box, 0)


@given(st.integers(0, 2**32 - 1), CAPS)
def test_hulls_hide_no_more_than_the_exact_shadow(seed, most_faces):
    """Ten points on a ball, seen from all over; boxes behind it, so that many are hidden."""
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((10, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    occluder = Occluder.solid(points)
    eye = rng.standard_normal(3) * rng.choice([1.5, 3.0, 30.0])
    counts = [0, 0]
    for _ in range(6):
        center = eye + (rng.standard_normal(3) * 0.3 - eye) * rng.uniform(0.8, 4.0)
        box = np.concatenate([center, rng.uniform(0, 0.2, 3)])
        counts[check(occluder, eye, box, most_faces)] += 1
    assert sum(counts) == 6


def test_something_is_hidden(rng):
    """The sentinel against a kernel that hides nothing: most of what the exact shadow holds, even with a simple cap."""
    occluder = Occluder.solid(rng.standard_normal((12, 3)))
    for most_faces, share in ((0, 0.8), (99, 1.0)):
        found = expected = 0
        for _ in range(300):
            eye = rng.standard_normal(3)
            eye *= 6 / np.linalg.norm(eye)
            box = np.concatenate([-eye * rng.uniform(0.1, 2) + rng.standard_normal(3) * 0.5, rng.uniform(0.01, 0.3, 3)])
            expected += truth(occluder, eye, box)
            found += check(occluder, eye, box, most_faces)
        assert expected > 50
        assert share * expected <= found <= expected


@pytest.mark.parametrize("most_faces", [0, 99])
@pytest.mark.parametrize("scale", [1e-6, 1e-9, 1e6, 2.0**40])
def test_units_do_not_matter(rng, scale, most_faces):
    for _ in range(40):
        corners, eye = rng.standard_normal((8, 3)), rng.standard_normal(3) * 4
        many = np.concatenate([rng.standard_normal((50, 3)) * 3 - eye, rng.uniform(0.01, 0.5, (50, 3))], axis=1)
        answers = []
        for s in (1.0, scale):
            rows, good = shadow_rows(table_of(Occluder.solid(corners * s)), eye * s, most_faces=most_faces)
            answers.append(hidden(rows, many * s, eye * s) & good[:, None])
        assert np.array_equal(*answers)


def test_cap_lies_behind_everything_that_looks_at_the_eye(rng):
    """Figure 4: the cap of equation (2) at the largest depth; at the largest distance it would cut off too little."""
    for _ in range(200):
        points = rng.standard_normal((9, 3)) * rng.uniform(0.2, 3, 3)
        occluder = Occluder.solid(points)
        eye = points.mean(axis=0) + rng.standard_normal(3) * 8
        table = table_of(occluder)
        rows, good = shadow_rows(table, eye, most_faces=0)
        assert good[0]
        cap = rows[0][np.flatnonzero(rows[0, :, 6] < 0)]
        assert len(cap) == 1
        vertices = table.vertices - eye
        front = [f for f, n in zip(occluder.faces, table.normals, strict=True) if n @ vertices[f[0]] < -1e-9]
        for face in front:
            assert (vertices[list(face)] @ cap[0, :3] + cap[0, 6] <= 1e-12).all()


def test_faces_end_a_shadow_nearer_than_the_cap(rng):
    """What the simple cap hides, the faces hide as well."""
    for _ in range(50):
        table = table_of(Occluder.solid(rng.standard_normal((8, 3))))
        eye = rng.standard_normal(3) * 6
        many = np.concatenate([-eye * rng.uniform(0, 1, (200, 1)), rng.uniform(0, 0.2, (200, 3))], axis=1)
        simple, exactly = (hidden(shadow_rows(table, eye, most_faces=n)[0], many, eye) for n in (0, 99))
        assert not (simple & ~exactly).any()


# -- eyes at awkward places ------------------------------------------------------------------------------------------

BOX = Occluder.box((-1, -1, -1), (1, 1, 1))


@pytest.mark.parametrize(
    ("eye", "usable"),
    [
        ((0, 0, 0), False),
        ((1, 0, 0), False),
        ((1, 1, 1), False),
        ((1 - 1e-9, 0, 0), False),
        ((1 + 1e-9, 0, 0), True),
        ((1 + 1e-17, 0, 0), False),
        ((1, 1, 5), True),
        ((0, 1, 5), True),
        ((1, 1, 1 + 1e-9), True),
    ],
)
def test_eye_in_on_and_near_a_face(eye, usable):
    """Inside or on it: not used. On the line of an edge: that edge is no silhouette, because its faces are edge-on."""
    rows, good = shadow_rows(table_of(BOX), eye)
    assert bool(good[0]) == usable
    if usable:
        behind = np.concatenate([-2.5 * np.asarray(eye), np.full(3, 0.05)])
        assert hidden(rows, behind, eye)[0, 0] == truth(BOX, eye, behind)


def test_guard_keeps_occluders_away_from_the_eye():
    table = table_of(BOX)
    assert shadow_rows(table, (3, 0, 0), guard=1.9)[1][0]
    assert not shadow_rows(table, (3, 0, 0), guard=2.0)[1][0]
    assert shadow_rows(table, (3, 0, 0), guard=2.0, beyond=np.array([True]))[1][0]


def test_silhouette_edge_that_points_at_the_eye():
    """A face that reaches the eye's own line: either it is no silhouette edge, or the occluder is not used."""
    occluder = Occluder.solid([(1, 0, 0), (3, 0, 0), (2, 1, 0.5), (2, -0.3, 1)])
    rows, good = shadow_rows(table_of(occluder), (0, 0, 0))
    if good[0]:
        assert np.isfinite(rows).all()
    nearly = shadow_rows(table_of(Occluder.planar([(1, 0, 0), (3, 0, 0), (3, 1e-17, 1)])), (0, 0, 0))[1]
    assert not nearly[0]


def test_polygon_edge_on_and_one_sided():
    square = [(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1)]
    both, front = Occluder.planar(square), Occluder.planar(square, two_sided=False)
    table = table_of(both, front)
    for eye, usable in (((3, 0, 0), [True, True]), ((-3, 0, 0), [True, False]), ((0, 3, 0), [False] * 2)):
        rows, good = shadow_rows(table, eye)
        assert good.tolist() == usable
        behind = np.concatenate([-np.asarray(eye, float), [0.1, 0.1, 0.1]])
        assert (hidden(rows, behind, eye)[:, 0] & good).tolist() == usable


@pytest.mark.parametrize("most_faces", [0, 99])
def test_parallel_view(rng, most_faces):
    """Whatever is shifted along the line of sight stays hidden as long as it is behind."""
    table = table_of(BOX)
    eye = np.array([50.0, 0.3, 0.2])
    rows, good = shadow_rows(
        table, eye, direction=np.array([-1.0, 0, 0]), beyond=np.array([True]), most_faces=most_faces
    )
    assert good[0]
    assert not shadow_rows(table, eye, direction=np.array([-1.0, 0, 0]), most_faces=most_faces)[1][0]
    for x, expected in ((3.0, False), (1.0, False), (-1.5, True), (-1e6, True)):
        for y, inside in ((0.0, True), (0.89, True), (0.91, False), (3.0, False)):
            box = (x, y, 0, 0.1, 0.1, 0.1)
            assert hidden(rows, box, eye)[0, 0] == (expected and inside)


def test_rows_of_a_pool_do_not_depend_on_one_another(rng):
    """Shapes of different build, padded to the largest, give what each gives alone."""
    angle = np.arange(16) * 2 * np.pi / 16
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    cylinder = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (0.0, 2.0)])
    many = [
        BOX,
        Occluder.solid(cylinder + (3, 0, 0)),
        Occluder.planar([(-3, 1, 3), (3, 1, 3), (0, 1, 7)]),
        Occluder.solid(rng.standard_normal((12, 3)) - (4, 0, 0)),
    ]
    eye = np.array([0.5, -9.0, 1.0])
    boxes = np.concatenate([rng.uniform(-8, 8, (600, 3)) + (0, 6, 0), rng.uniform(0, 0.3, (600, 3))], axis=1)
    for most_faces in (0, 4, 99):
        together, good = shadow_rows(table_of(*many), eye, most_faces=most_faces)
        assert (together[..., 6] == UNUSED).any()
        both = hidden(together, boxes, eye) & good[:, None]
        alone = [shadow_rows(table_of(one), eye, most_faces=most_faces) for one in many]
        assert np.array_equal(both, np.concatenate([hidden(r, boxes, eye) & g[:, None] for r, g in alone]))
        assert both.any(axis=1).all()


# -- parts -------------------------------------------------------------------------------------------------------------


def test_outline_is_the_hull_of_the_image(rng):
    """The silhouette's vertices are the corners of the image's convex hull."""
    for _ in range(100):
        table = table_of(Occluder.solid(rng.standard_normal((12, 3))))
        eye = np.array([0.0, 0.0, 20.0])
        arrays = shadow_arrays(table, eye)
        front = (arrays["normals"] * arrays["points"].reshape(3, -1)[:, arrays["corners"]]).sum(axis=0) < 0
        edges = cone_outline(front, arrays["edge_faces"])[:, 0]
        image = arrays["points"][:2, :, 0] / -arrays["points"][2, :, 0]
        assert set(arrays["ends"][:, edges, 0].ravel()) == set(ConvexHull(image.T).vertices)


def test_no_faces_in_front_no_outline():
    arrays = shadow_arrays(table_of(BOX), (5, 0, 0))
    assert not cone_outline(np.zeros((6, 1), bool), arrays["edge_faces"]).any()
    assert not cone_outline(np.ones((6, 1), bool), arrays["edge_faces"]).any()


def test_side_planes_pass_through_the_eye_and_both_ends(rng):
    start, end = rng.standard_normal((2, 3, 50)) * 10
    center = start + end + rng.standard_normal((3, 50))
    normal, offset, slack, turn = cone_side_planes(start, end, center, reach=np.full(50, 60.0), error=np.zeros(50))
    assert not offset.any()
    assert np.abs((normal * start).sum(axis=0)).max() < 1e-13
    assert np.abs((normal * end).sum(axis=0)).max() < 1e-13
    assert ((normal * center).sum(axis=0) >= 0).all()
    assert np.allclose((normal * normal).sum(axis=0), 1)
    assert (np.sign(turn) == np.sign((np.cross(start.T, end.T) * center.T).sum(axis=1))).all()
    assert (slack > 0).all()


def test_slack_grows_as_an_edge_turns_toward_the_eye():
    start = np.array([[1.0, 1.0, 1.0], [0, 0, 0], [0, 0, 0]])
    end = np.array([[2.0, 2.0, 2.0], [1.0, 1e-6, 0], [0, 0, 0]])
    center = np.array([[1.5] * 3, [0.1] * 3, [1.0] * 3])
    slack = cone_side_planes(start, end, center, reach=np.full(3, 3.0), error=np.zeros(3))[2]
    assert slack[0] < 1e-13 < slack[1] < 1e-7
    assert not slack[2] < np.inf


def test_turns_tell_a_closed_curve_from_an_open_one():
    first, last = np.array([0, 1, 2]), np.array([1, 2, 0])
    assert cone_turns_are_even(first, last, np.ones(3), vertices=3).all()
    assert not cone_turns_are_even(first[:2], last[:2], np.ones(2), vertices=3).all()
    # there and back again: closed, but not about anything
    assert not cone_turns_are_even(np.array([0, 0]), np.array([1, 1]), np.array([1.0, 1.0]), vertices=2).all()


def test_no_cap_without_anything_in_front():
    start = np.array([[1.0], [0], [0]])
    normal, offset = cone_depth_caps(start, -start, np.zeros(1, int), reach=np.ones(1), error=np.zeros(1))
    assert offset[0] == -np.inf
    assert normal.shape == (3, 1)
