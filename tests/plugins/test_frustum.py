"""The stages `frustum` and `contribution`."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import scenegraph as sg
from scenegraph.testing import StageContract, box_at, grid_scene, random_views, wall_scene, wall_views
from scenegraph_frustum import Contribution, Frustum


class TestFrustum(StageContract):
    stages = (Frustum(),)


class TestContribution(StageContract):
    stages = (Contribution(), Contribution(pixels=3.0))


def run(stage: sg.Stage, snapshot: sg.Snapshot, view: sg.View) -> sg.Frame:
    with sg.Pipeline([stage]).open(snapshot) as pipeline:
        return pipeline.run(view)


def corners_outside_one_plane(snapshot: sg.Snapshot, view: sg.View) -> np.ndarray:
    """All eight corners on the outer side of one plane, straight from the definition."""
    planes = view.planes()
    signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1]), -1).reshape(8, 3, 1)
    corners = snapshot.boxes[:3] + signs * snapshot.boxes[3:]
    distance = np.einsum("pi,cin->pcn", planes[:, :3], corners) + planes[:, 3][:, None, None]
    return np.asarray((distance < 0).all(axis=1).any(axis=0))


@pytest.mark.parametrize("flat_limit", [0, 10**9], ids=["hierarchical", "flat"])
def test_hides_what_is_outside_a_plane_and_little_else(monkeypatch: pytest.MonkeyPatch, flat_limit: int) -> None:
    monkeypatch.setattr("scenegraph.traversal.FLAT_LIMIT", flat_limit)
    snapshot = grid_scene(9).snapshot()
    for view in random_views(np.random.default_rng(0), 40, 14.0):
        outside = corners_outside_one_plane(snapshot, view)
        visible = run(Frustum(), snapshot, view).visible
        assert not (visible & outside).any()
        corners = view.corners()
        low, high = snapshot.boxes[:3] - snapshot.boxes[3:], snapshot.boxes[:3] + snapshot.boxes[3:]
        beside = ((corners.max(0) < low.T) | (corners.min(0) > high.T)).any(axis=1)
        assert np.array_equal(visible, ~(outside | beside))


@given(seed=st.integers(0, 2**32 - 1), rows=st.integers(1, 400))
def test_hierarchical_equals_flat(seed: int, rows: int) -> None:
    rng = np.random.default_rng(seed)
    groups = [sg.Group(name=str(i)) for i in range(int(rng.integers(1, 12)))]
    for group in groups[1:]:
        groups[int(rng.integers(0, groups.index(group)))].add(group)
    for center in rng.uniform(-20, 20, (rows, 3)):
        groups[int(rng.integers(0, len(groups)))].add(box_at(center, rng.uniform(0.01, 9, 3)))
    snapshot = sg.Scene(groups[0]).snapshot()
    stage = Frustum()
    for view in random_views(rng, 4, 20.0):
        results = []
        for flat in (True, False):
            frame = sg.Frame(snapshot, view)
            walk = frame.traverse
            frame.traverse = lambda classify, walk=walk, flat=flat: walk(classify, flat=flat)  # type: ignore[method-assign]
            stage.run(frame)
            results.append(frame.visible)
        assert np.array_equal(*results)


@given(seed=st.integers(0, 2**32 - 1))
def test_moving_scene_and_camera_together_changes_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centers, sizes = rng.uniform(-20, 20, (60, 3)), rng.uniform(0.1, 5, (60, 3))
    shift = rng.uniform(-1e6, 1e6, 3)
    view = random_views(rng, 1, 20.0)[0]

    def visible(offset: np.ndarray, view: sg.View) -> set[str]:
        nodes = [box_at(c, s, name=str(i)) for i, (c, s) in enumerate(zip(centers, sizes, strict=True))]
        snapshot = sg.Scene(sg.Group(sg.Transform(*nodes, translation=offset))).snapshot()
        frame = run(Frustum(), snapshot, view)
        return {snapshot.geodes[r].name for r in frame.candidates()}

    here = visible(np.zeros(3), view)
    there = visible(shift, view.moved(eye=np.add(view.eye, shift), target=np.add(view.target, shift)))
    assert here == there


@given(seed=st.integers(0, 2**32 - 1))
def test_permuting_rows_permutes_the_answer_and_widening_never_hides_more(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centers, sizes = rng.uniform(-20, 20, (80, 3)), rng.uniform(0.1, 5, (80, 3))
    view = random_views(rng, 1, 20.0)[0]

    def visible(order: np.ndarray, view: sg.View) -> set[str]:
        scene = sg.Scene().add(*(box_at(centers[i], sizes[i], name=str(i)) for i in order))
        snapshot = scene.snapshot()
        return {snapshot.geodes[r].name for r in run(Frustum(), snapshot, view).candidates()}

    plain = visible(np.arange(80), view)
    assert plain == visible(rng.permutation(80), view)
    wider = dataclasses.replace(
        view,
        fov=min(view.fov * 1.3, 175.0),
        far=view.far * 1.2,
        parallel_scale=view.parallel_scale and view.parallel_scale * 1.3,
    )
    assert plain <= visible(np.arange(80), wider)


def test_a_large_box_beside_a_corner_of_the_frustum_is_hidden() -> None:
    # outside no single plane, but beyond the frustum's own bounding box
    view = sg.View((0, 0, 0), (0, 1, 0), fov=90, width=100, height=100, near=1, far=10)
    scene = sg.Scene().add(box_at((30, 9, 30), 38.0, name="corner"), box_at((0, 5, 0), 1.0, name="seen"))
    snapshot = scene.snapshot()
    kept = [snapshot.geodes[r].name for r in run(Frustum(), snapshot, view).candidates()]
    assert kept == ["seen"]
    assert not corners_outside_one_plane(snapshot, view).any()


def test_contribution_hides_by_size_on_the_screen() -> None:
    view = sg.View((0, -100, 0), (0, 0, 0), fov=60, width=800, height=600)
    per_pixel = 2 * 100 * np.tan(np.radians(30)) / 600
    scene = sg.Scene().add(*(box_at((x, 0, 0), per_pixel * s, name=str(s)) for x, s in ((0, 1), (5, 4), (-5, 16))))
    snapshot = scene.snapshot()
    for pixels, left in ((0, {"1", "4", "16"}), (3, {"4", "16"}), (9, {"16"}), (40, set())):
        frame = run(Contribution(pixels=pixels), snapshot, view)
        assert {snapshot.geodes[r].name for r in frame.candidates()} == left
    assert frame.record.stages[0].tested == 3


def test_contribution_in_an_orthographic_view_does_not_depend_on_distance() -> None:
    near, far = box_at((0, 0, 0), 0.1, name="near"), box_at((3, 900, 0), 0.1, name="far")
    snapshot = sg.Scene().add(near, far).snapshot()
    view = sg.View((0, -5, 0), (0, 0, 0), parallel_scale=10, width=100, height=100, far=2000)
    assert run(Contribution(pixels=0.5), snapshot, view).visible.all()
    assert not run(Contribution(pixels=3), snapshot, view).visible.any()


def test_contribution_keeps_what_reaches_the_near_plane() -> None:
    view = wall_views()[0]
    snapshot = wall_scene().add(box_at(view.eye, 1e-6, name="at the eye")).snapshot()
    with sg.Pipeline([Frustum(), Contribution(pixels=10_000)]).open(snapshot) as pipeline:
        frame = pipeline.run(view)
    assert [snapshot.geodes[r].name for r in frame.candidates()] == []
    before, frame = frame, run(Contribution(pixels=10_000), snapshot, view)
    # behind the eye there is no image to measure: without `frustum` such rows are kept as well
    assert {snapshot.geodes[r].name for r in frame.candidates()} == {"at the eye", "out of view"}
    assert before.record.stages[0].hidden == 2


def test_contribution_is_aggressive_only_when_on() -> None:
    assert Contribution().guarantee is sg.Guarantee.CONSERVATIVE
    assert Contribution(pixels=1).guarantee is sg.Guarantee.AGGRESSIVE
    with pytest.raises(sg.PipelineError, match="below its minimum 0 px"):
        Contribution(pixels=-1)
