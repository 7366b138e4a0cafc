"""The stage `shadow`: occluders and eyes at their worst, and holes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import scenegraph as sg
from scenegraph.testing import box_at
from scenegraph_shadow import Shadow, ShadowFrusta
from shadow_scenes import counts, names, run

# -- faults ------------------------------------------------------------------------------------------------------------


def single(occluder: sg.Occluder, eye: Any, target: Any = (0, 0, 0), **options: Any) -> dict[str, float]:
    scene = sg.Scene().add(occluder, box_at((0, 0, 0), 0.2))
    # by the size of the image: then those that face away are looked at, too
    (frame,) = run(Shadow(ranking="solid_angle"), scene.snapshot(), sg.View(eye, target, **options))
    assert frame.visible.all()
    return {k: v for k, v in counts(frame).items() if v and k != "scored"}


BOX = ((-1, -1, -1), (1, 1, 1))


def test_eye_in_on_and_near_an_occluder() -> None:
    for eye in ((0.5, 0.2, 0.1), (1, 0, 0), (1, 1, 1), (1 + 1e-9, 0, 0), (1.05, 0, 0)):
        assert single(sg.Occluder.box(*BOX), eye, near=0.1) == {"at_eye": 1}
    scene = sg.Scene().add(sg.Group(sg.Occluder.box(*BOX)), box_at((-5, 0, 0), 0.2))
    (frame,) = run(Shadow(), scene.snapshot(), sg.View((1 + 1e-9, 0, 0), (0, 0, 0), near=1e-12, far=10))
    assert frame.visible_count == 0


def test_occluder_across_the_near_plane_is_used_only_if_it_stays_away_from_the_view() -> None:
    """A street wall beside the eye reaches behind it: its plane keeps it clear. A box cut by the near plane is out."""
    wall = sg.Occluder.box((1, -50, -5), (2, 50, 5))
    scene = sg.Scene().add(sg.Group(wall), box_at((6, 20, 0), 0.5))
    (frame,) = run(Shadow(), scene.snapshot(), sg.View((0, 0, 0), (0.3, 1, 0), near=0.1))
    assert frame.visible_count == 0
    assert single(sg.Occluder.box((-1, 5, -1), (1, 7, 1)), (0, 0, 0), (0, 1, 0), near=6.0) == {"at_eye": 1}


def test_occluders_elsewhere() -> None:
    assert single(sg.Occluder.box((-1, 9, -1), (1, 10, 1)), (0, 5, 0), (0, 0, 0)) == {}
    assert single(sg.Occluder.box((90, -1, -1), (92, 1, 1)), (0, -9, 0), (0, 0, 0)) == {}
    assert single(sg.Occluder.box((-9, 50, -9), (9, 60, 9)), (0, -9, 0), (0, 0, 0), far=30.0) == {}


def test_polygon_edge_on_or_seen_from_behind() -> None:
    square = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    assert single(sg.Occluder.planar(square), (-5, 0, 0)) == {"facing_away": 1}
    assert single(sg.Occluder.planar(square, two_sided=False), (0, 0.1, -5)) == {"facing_away": 1}
    assert single(sg.Occluder.planar([(1, 0, 0), (3, 0, 0), (3, 0, 1)]), (-9, 0, 0)) == {"facing_away": 1}


def test_occluder_larger_than_the_scene() -> None:
    scene = sg.Scene().add(
        sg.Group(sg.Occluder.box((-1e7, 5, -1e7), (1e7, 6e6, 1e7))), box_at((0, 0, 0), name="before")
    )
    scene.add(box_at((3, 9e6, 0), name="behind"), box_at((0, 5.5, 0), 0.1, name="inside"))
    (frame,) = run(Shadow(), scene.snapshot(), sg.View((0, -5, 0), (0, 1, 0), far=1e8))
    assert names(frame, visible=True) == {"before"}


def test_unusable_occluders_are_counted() -> None:
    """Flattened by a singular transform, or not finite: never used, never an error."""
    scene = sg.Scene().add(box_at((0, 9, 0)))
    for matrix in (
        np.diag([1.0, 0, 1, 1]),
        np.diag([np.inf, 1, 1, 1]),
        np.diag([np.nan, 1, 1, 1]),
        np.diag([0.0, 0, 0, 1]),
    ):
        scene.add(
            sg.Transform(sg.Occluder.box(*BOX), sg.Occluder.planar([(-3, 0, -3), (3, 0, -3), (3, 1, 3)]), matrix=matrix)
        )
    (frame,) = run(Shadow(), scene.snapshot(), sg.View((0, -9, 0), (0, 0, 0)))
    assert frame.visible.all()
    # the polygon is not flattened by the loss of its thinnest direction
    assert counts(frame)["unusable"] == 7


def test_mirrored_occluders_hide_like_others() -> None:
    scene = sg.Scene().add(
        sg.Transform(sg.Occluder.box((1, 0, -2), (5, 1, 2)), scale=(-1, 1, 1)), box_at((-3, 5, 0)), box_at((3, 5, 0))
    )
    (frame,) = run(Shadow(), scene.snapshot(), sg.View((0, -12, 0), (0, 0, 0)))
    assert frame.visible.sum() == 1


@pytest.mark.parametrize(
    "make",
    [
        lambda: sg.Occluder.solid([(0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)]),
        lambda: sg.Occluder.box((0, 0, 0), (1, 1, 0)),
        lambda: sg.Occluder.solid([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, np.nan)]),
        lambda: sg.Occluder.planar([(0, 0, 0), (1, 0, 0), (0.2, 0.2, 0), (0, 1, 0)]),
        lambda: sg.Occluder.planar([(0, 0, 0), (1, 0, 0), (2, 0, 0)]),
    ],
)
def test_impossible_occluders_are_refused_with_a_sentence(make: Any) -> None:
    with pytest.raises(sg.SceneError, match=r"volume|finite|convex|area"):
        make()


def test_repeated_vertices_do_no_harm() -> None:
    corners = [(x, y, z) for x in (-2, 2) for y in (0, 1) for z in (-2, 2)]
    scene = sg.Scene().add(sg.Group(sg.Occluder.solid(corners + corners)), box_at((0, 5, 0)))
    scene.add(sg.Group(sg.Occluder.planar([(-4, 0, -2), (-3, 0, -2), (-3, 0, -2), (-3, 0, 2), (-4, 0, 2)])))
    (frame,) = run(Shadow(), scene.snapshot(), sg.View((0, -12, 0), (0, 0, 0)))
    assert frame.visible_count == 0
    assert counts(frame)["active"] == 2


def test_fitted_occluders_promise_nothing_to_eyes_in_their_mesh() -> None:
    """A shell with a wall inside: from outside the wall hides what is behind it, from within it is not used."""
    shell = box_at((0, 0, 0), 20, name="shell")
    wall = sg.Occluder.box((-4, -0.5, -4), (4, 0.5, 4))
    wall.outside_only = True
    snapshot = (
        sg.Scene().add(shell, box_at((0, 5, 0), name="behind"), sg.Occluder.box((90, 0, 0), (91, 1, 1))).snapshot()
    )
    snapshot.adopt_occluders({shell: [wall]})
    for y, hidden in ((-12, {"behind"}), (-9, set())):
        (frame,) = run(Shadow(), snapshot, sg.View((0, y, 0), (0, 0, 0), fov=80.0))
        assert names(frame, visible=False) == hidden


def test_skips_without_occluders() -> None:
    """Before the host has fitted any to the meshes."""
    view = sg.View((0, -9, 0), (0, 0, 0))
    for occluders, nodes, reason in (
        ("both", [], "the scene has no occluders"),
        ("planar", [sg.Occluder.box(*BOX)], "the scene has no planar occluders"),
        ("solid", [sg.Occluder.box(*BOX)], None),
    ):
        snapshot = sg.Scene().add(box_at((0, 0, 0)), *nodes).snapshot()
        stage = Shadow(occluders=occluders)
        stage.open(snapshot, None)
        assert stage.skip(sg.Frame(snapshot, view)) == reason
    assert Shadow(active=0).skip(sg.Frame(snapshot, view)) == "active = 0"


def test_occluders_that_come_later_are_used() -> None:
    """Another pipeline may fit occluders to the snapshot while this one is open."""
    wall = box_at((0, 0, 0), (8, 1, 8), name="wall")
    scene = sg.Scene().add(wall, box_at((0, 5, 0), name="behind"), sg.Occluder.box((90, 0, 0), (91, 1, 1)))
    snapshot = scene.snapshot()
    view = sg.View((0, -12, 0), (0, 0, 0))
    with sg.Pipeline([Shadow()]).open(snapshot) as pipeline:
        assert pipeline.run(view).visible.all()
        snapshot.adopt_occluders({wall: [sg.Occluder.box((-4, -0.5, -4), (4, 0.5, 4))]})
        assert names(pipeline.run(view), visible=False) == {"behind"}


# -- holes -------------------------------------------------------------------------------------------------------------


def gate(*, holes: Any = (), extra: Any = ()) -> sg.Scene:
    """A wall in the plane y = 0 with holes, and boxes behind it at x = -4 … 4."""
    square = [(-6, 0, -3), (6, 0, -3), (6, 0, 3), (-6, 0, 3)]
    scene = sg.Scene().add(sg.Group(sg.Occluder.planar(square, holes=holes)), *extra)
    return scene.add(*(box_at((x, 2, 0), 0.4, name=str(x)) for x in range(-4, 5)))


WINDOW = [(-1, 0, -1), (1, 0, -1), (1, 0, 1), (-1, 0, 1)]


@pytest.mark.parametrize("flip", [False, True])
@pytest.mark.parametrize("parallel", [None, 8.0])
def test_what_a_hole_shows_is_visible(flip: bool, parallel: float | None) -> None:
    view = sg.View((0, -12, 0), (0, 0, 0), parallel_scale=parallel)
    (frame,) = run(Shadow(), gate(holes=[WINDOW[::-1] if flip else WINDOW]).snapshot(), view)
    assert names(frame, visible=True) == {"-1", "0", "1"}
    (frame,) = run(Shadow(), gate().snapshot(), view)
    assert frame.visible_count == 0


def test_several_holes() -> None:
    shift = np.array([3, 0, 0])
    holes = [np.array(WINDOW) * (0.3, 0, 1) - shift, np.array(WINDOW) * (0.3, 0, 1) + shift]
    (frame,) = run(Shadow(), gate(holes=holes).snapshot(), sg.View((0, -12, 0), (0, 0, 0)))
    assert names(frame, visible=True) == {"-4", "-3", "3", "4"} - ({"-4", "4"} - names(frame, visible=True))
    assert {"-2", "-1", "0", "1", "2"} <= names(frame, visible=False)


def test_a_hole_behind_a_nearer_occluder_is_no_hole() -> None:
    shutter = sg.Group(sg.Occluder.box((-1.2, -2, -1.2), (1.2, -1.9, 1.2)))
    (frame,) = run(Shadow(), gate(holes=[WINDOW], extra=[shutter]).snapshot(), sg.View((0, -12, 0), (0, 0, 0)))
    assert frame.visible_count == 0
    assert not len(frame.get(ShadowFrusta).holes)


def test_a_hole_out_of_the_view_is_no_hole() -> None:
    view = sg.View((0, -12, 0), (4, 2, 0), fov=10.0, width=100, height=100)
    (frame,) = run(Shadow(), gate(holes=[WINDOW]).snapshot(), view)
    assert not len(frame.get(ShadowFrusta).holes)
    assert {"3", "4"} <= names(frame, visible=False)


def test_an_occluder_with_a_hole_does_not_drop_what_is_seen_through_it() -> None:
    far = sg.Group(sg.Occluder.box((-1, 3, -1), (1, 4, 1)), name="far")
    (frame,) = run(Shadow(), gate(holes=[WINDOW], extra=[far]).snapshot(), sg.View((0, -12, 0), (0, 0, 0)))
    assert set(frame.get(ShadowFrusta).ids.tolist()) == {0, 1}


@given(st.integers(0, 2**32 - 1))
def test_no_ray_through_a_hole_meets_a_hidden_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    hole = np.array(WINDOW) * rng.uniform(0.2, 1.2) + (rng.uniform(-3, 3), 0, rng.uniform(-1, 1))
    snapshot = gate(
        holes=[hole], extra=[box_at(p, 0.5) for p in rng.uniform((-9, 0.5, -3), (9, 20, 3), (80, 3))]
    ).snapshot()
    eye = np.array([rng.uniform(-4, 4), -rng.uniform(0.5, 20), rng.uniform(-2, 2)])
    view = sg.View(eye, (rng.uniform(-3, 3), 1, 0), fov=120.0)
    planes = view.planes(eye)
    (frame,) = run(Shadow(), snapshot, view)
    for row in np.flatnonzero(~frame.visible):
        points = snapshot.boxes[:3, row] + rng.uniform(-1, 1, (40, 3)) * snapshot.boxes[3:, row]
        met = eye + (points - eye) * (-eye[1] / (points[:, 1] - eye[1]))[:, None]
        low, high = hole.min(axis=0), hole.max(axis=0)
        through = ((met > low) | (low == high)).all(axis=1) & ((met < high) | (low == high)).all(axis=1)
        seen = ((points - eye) @ planes[:, :3].T + planes[:, 3] >= 0).all(axis=1)
        assert not (through & seen).any()
